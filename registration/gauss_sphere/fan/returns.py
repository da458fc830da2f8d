"""Which points of a scan are returns of a scene: no marks of no return, and no wild points."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.fan.spikes import leave_out_spikes
from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray

LEAST_RETURNS = 4  # fewer lie on no line that could be told from noise
SCENE_ROWS = 16  # of profiles and of pixels that tell between which depths most of a scene lies
FAR_OFF = 10.0  # times the usual distance from the middle one
FAR_OFF_MM, FAR_OFF_SHARE = 500.0, 0.5  # and so far, and such a share of the middle depth, besides
BESIDE_MM, BESIDE_SHARE = 20.0, 0.05  # and share of the depth: the next point of a far surface
PROFILE_MM = 20.0  # within which X of a profile's points lies, but for wild ones


@compiled
def profiles_with_returns(usable: BoolArray) -> BoolArray:
    """(profiles,) False for those between others that have next to no usable point (n, pixels)."""
    kept, first, last = np.ones(usable.shape[0], np.bool_), usable.shape[0], -1
    for p in range(usable.shape[0]):
        kept[p] = np.count_nonzero(usable[p]) >= LEAST_RETURNS
        first = p if kept[p] and last < 0 else first
        last = p if kept[p] else last
    kept[:first] = True
    kept[last + 1 :] = True
    return kept


@compiled
def _is_return(y: float, z: float) -> bool:
    """Whether a point is none in the sensor itself: Y = Z = 0 is how many programs mark those."""
    return bool(np.isfinite(z) & ((z != 0.0) | (y != 0.0)))


@compiled
def usable_points(points: FloatArray) -> BoolArray:
    """(profiles, pixels) whether a point may lie where its profile was taken and a scene is."""
    low, high = _usual_depths(points[:, :, 2])
    usable, far, aside = np.empty(points.shape[:2], np.bool_), False, False
    for p in range(points.shape[0]):
        low_x, high_x = np.inf, -np.inf
        for u in range(points.shape[1]):
            x, y, z = points[p, u, 0], points[p, u, 1], points[p, u, 2]
            usable[p, u] = (low <= z) & (z <= high) & _is_return(y, z)
            far |= (z < low) | (z > high)
            low_x = x if x < low_x else low_x
            high_x = x if x > high_x else high_x
        aside |= high_x - low_x > PROFILE_MM
    if far:
        _add_surfaces(points, low, high, usable)
    if aside:
        for p in range(points.shape[0]):
            _leave_out_aside(points[p, :, 0], usable[p])
    leave_out_spikes(points[:, :, 2], usable)
    return usable


@compiled
def _leave_out_aside(x: FloatArray, usable: BoolArray) -> None:
    """Points far from the X of the others of their profile are not usable."""
    if usable.any():
        middle = np.median(x[usable])
        reach = FAR_OFF * np.median(np.abs(x[usable] - middle)) + PROFILE_MM
        usable &= np.abs(x - middle) <= reach


@compiled
def _add_surfaces(points: FloatArray, low: float, high: float, usable: BoolArray) -> None:
    """Surfaces far from most points are usable, too: where the next point lies there as well.

    A wild point is alone. A mark of no return is the least or the largest number.
    """
    depth, least, most = points[:, :, 2], np.inf, -np.inf
    for p in range(depth.shape[0]):
        for z in depth[p]:
            least = z if z < least else least
            most = z if z > most else most
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[p, u]
            if (least < z < low) | (high < z < most):
                usable[p, u] = _is_return(points[p, u, 1], z) and not _is_alone(depth[p], u)


@compiled
def _is_alone(depth: FloatArray, u: int) -> bool:
    near = BESIDE_MM + BESIDE_SHARE * abs(depth[u])
    for v in (u - 1, u + 1):
        if 0 <= v < depth.size and abs(depth[v] - depth[u]) <= near:
            return False
    return True


@compiled
def _usual_depths(depth: FloatArray) -> tuple[float, float]:
    """Between which depths most of a scene lies: about the middle one, as some points have it."""
    along, across = max(depth.shape[0] // SCENE_ROWS, 1), max(depth.shape[1] // SCENE_ROWS, 1)
    sample = depth[along // 2 :: along, across // 2 :: across].flatten()
    # Marks are the extremes, and there may be more of them than of points.
    sample = sample[(sample > np.nanmin(sample)) & (sample < np.nanmax(sample))]
    if sample.size == 0:
        return -np.inf, np.inf
    middle = np.median(sample)
    usual = np.median(np.abs(sample - middle))
    reach = FAR_OFF * usual + FAR_OFF_MM + FAR_OFF_SHARE * abs(middle)
    # Behind the sensor's front there is no scene, where it is not all around.
    return (max(middle - reach, 0.0) if middle > 0.0 else middle - reach), middle + reach
