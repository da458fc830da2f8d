"""What is left of a sensor's bias in two scans, from how far their planes are bent.

Without a bias planes are flat to the noise. What a wrong calibration leaves or brings in, and what
no calibration takes out, bends all planes of both views alike. It tilts and moves them, too, and so
the pose, by amounts that planes which agree on the wrong pose do not show.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.candidates.rotation import gauss_sphere
from registration.gauss_sphere.fan.calibrated import Known, look_up, tangent_of
from registration.gauss_sphere.params import BendingParams, GaussSphereParams
from registration.gauss_sphere.planes.patches import Patches, planes_in_beams
from registration.gauss_sphere.refinement.chance import take_chance
from registration.gauss_sphere.refinement.matching import Settled
from registration.gauss_sphere.refinement.refine import likelihood, widened
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

# Columns of the normal equations of a plane: its three parameters, the two shapes of a bias, and
# the depths that are to be explained.
TAKEN_OUT, LATERAL, DEPTHS = 3, 4, 5
PIVOT = 1e-9  # of a diagonal: below it, columns say the same
# Mean square, in units of the noise, of what a bias may leave of a plane that it bends. With a
# calibration, two faces grown to one plane are the likelier explanation of more.
MISFIT = 1.5
PARABOLA_MM, AT_MM = 100.0, 1000.0  # depth by squared slope, at this depth: 5 mm over 13 degrees


class Bending(NamedTuple):
    """A bias that bends planes: in shares of the known one, and of a parabola over the field.

    share: 0 where the bias is gone, -1 where it was taken out of scans without it; lateral: of
    PARABOLA_MM. Each with its standard deviation, inf where no plane tells.
    most_mm: (2,) the largest that the points have of either at a share of 1.
    """

    share: float
    share_deviation: float
    lateral: float
    lateral_deviation: float
    most_mm: FloatArray


def left_bias_mm(target: View, source: View, known: Known, params: BendingParams) -> float:
    """The size of a bias that bends the planes of two views beyond doubt, in mm; else 0."""
    seen = bending(target, source, known, params)
    size_mm = 0.0
    if abs(seen.share) > params.sure * seen.share_deviation:
        size_mm = abs(seen.share) * seen.most_mm[0]
    if abs(seen.lateral) > params.sure * seen.lateral_deviation:
        size_mm = max(size_mm, abs(seen.lateral) * seen.most_mm[1])
    return float(size_mm)


def bending(target: View, source: View, known: Known, params: BendingParams) -> Bending:
    """How far the planes of two views of one sensor are bent, over all pieces of each plane."""
    return _bending(
        target,
        source,
        known,
        params.samples,
        params.close_rad,
        params.close_mm,
        params.least_points,
        params.least_mm,
        max(params.flat_to_mm, known.known_to_mm),
    )


def doubted(
    pose: Settled, target: Patches, source: Patches, bias_mm: float, params: GaussSphereParams
) -> Settled:
    """The pose, no surer than planes with a systematic error of bias_mm make it.

    The pieces of a plane share that error: however many there are, they know no more than one.
    """
    near = params.bending.close_rad, params.bending.close_mm
    planes = _number_of(planes_of_pieces(target, *near), pose)
    shared_mm = bias_mm * np.sqrt(pose.pairs.shape[0] / planes)
    return _under_error(pose, target, source, float(shared_mm), params)


def of_unknown_bias(
    pose: Settled, target: Patches, source: Patches, params: GaussSphereParams
) -> Settled:
    """The pose, no surer than where planes of one direction share the error that they show.

    A bias goes with how beams meet a plane, so planes of one direction are off alike: they agree
    with each other all the same, and however many there are, they know no more than one. The pose
    takes in six of the freedoms of these errors, so the fewer directions, the less of them shows.
    Only what is beyond the noise counts as error: without a bias the pose stays as sure as it was.
    """
    n, likely, unused = pose.pairs.shape[0], likelihood(params.refine), np.empty((6, 6))
    r, t, floor_mm = pose.rotation, pose.shift_mm, pose.floor_mm
    shown_mm = widened(target, source, pose.pairs, likely, floor_mm, r, t, unused, 0.0)
    directions = _number_of(gauss_sphere(target, params.bending.close_rad).member, pose)
    left = max(3 * n - 6, 1) / max(3 * n - 6 * n / directions, 1)
    error_mm = floor_mm + (shown_mm - floor_mm) * np.sqrt(left * n / directions)
    return _under_error(pose, target, source, float(error_mm), params)


def _number_of(group: IntArray, pose: Settled) -> int:
    """How many groups the matched patches of the target belong to; group: (m,) of each patch."""
    return np.unique(group[pose.pairs[:, 0]]).size


def _under_error(
    pose: Settled, target: Patches, source: Patches, error_mm: float, params: GaussSphereParams
) -> Settled:
    """The pose with a systematic error of each plane, or a larger one that the planes show."""
    sure, floor_mm = np.empty((6, 6)), max(error_mm, pose.floor_mm)
    r, t, likely = pose.rotation, pose.shift_mm, likelihood(params.refine)
    wide_mm = widened(target, source, pose.pairs, likely, floor_mm, r, t, sure, 0.0)
    take_chance(target, source, pose.pairs, likely, wide_mm, r, t, sure)
    return pose._replace(sure=sure, floor_mm=floor_mm)


@compiled
def _bending(
    target: View,
    source: View,
    known: Known,
    samples: int,
    close_rad: float,
    close_mm: float,
    least_points: int,
    least_mm: float,
    flat_to_mm: float,
) -> Bending:
    most_mm = np.zeros(2)
    n_a, n_b = target.patches.n_points.size, source.patches.n_points.size
    sums, weight, count = np.zeros((n_a + n_b, 6, 6)), np.zeros(n_a + n_b), np.zeros(n_a + n_b)
    _add_view(
        target, known, samples, close_rad, close_mm, sums[:n_a], weight[:n_a], count[:n_a], most_mm
    )  # fmt: skip
    _add_view(
        source, known, samples, close_rad, close_mm, sums[n_a:], weight[n_a:], count[n_a:], most_mm
    )  # fmt: skip
    told = np.empty(count.size, np.bool_)
    for g in range(count.size):
        told[g] = _without_plane(sums[g])
    found = np.zeros((2, 2))
    for shape in range(2):
        column = TAKEN_OUT + shape
        values, inverses, n = np.empty(count.size), np.empty(count.size), 0
        for g in range(count.size):
            if count[g] < least_points or not told[g]:
                continue
            across, shared = sums[g, column, column], sums[g, DEPTHS, column]
            # Where the shape is not bent, as the bias far off its peak, nothing shows.
            if across <= least_mm * least_mm * weight[g]:
                continue
            left = sums[g, DEPTHS, DEPTHS] - shared * shared / across
            misfit = left / (count[g] - 4.0)
            if known.given and misfit > MISFIT:
                continue
            values[n] = shared / across
            inverses[n] = across / (max(misfit, 1.0) + flat_to_mm * flat_to_mm * weight[g])
            n += 1
        found[shape] = _mean(values[:n], inverses[:n])
    return Bending(found[0, 0], found[0, 1], found[1, 0], found[1, 1], most_mm)


@compiled
def _mean(values: FloatArray, inverses: FloatArray) -> tuple[float, float]:
    """Weighted mean and its standard deviation, which grows as values scatter beyond theirs."""
    if values.size == 0:
        return 0.0, np.inf
    mean, scatter = (values * inverses).sum() / inverses.sum(), 1.0
    if values.size > 1:
        scatter = (inverses * (values - mean) ** 2).sum() / (values.size - 1)
    return mean, float(np.sqrt(max(scatter, 1.0) / inverses.sum()))


@compiled
def _without_plane(sums: FloatArray) -> bool:
    """Eliminate a plane's parameters from its normal equations; False where they are open.

    sums: (6, 6), the lower half is used.
    """
    for k in range(3):
        pivot = sums[k, k]
        if pivot <= 0.0:
            return False
        for i in range(k + 1, 6):
            factor = sums[i, k] / pivot
            before = sums[i, i]
            for j in range(k + 1, i + 1):
                sums[i, j] -= factor * sums[j, k]
            if i < 3 and sums[i, i] < PIVOT * before:
                return False
    return True


@compiled
def planes_of_pieces(patches: Patches, close_rad: float, close_mm: float) -> IntArray:
    """(m,) the largest piece of the bent plane that each patch may be a piece of, itself often."""
    m = patches.n_points.size
    first = np.arange(m)
    for i in range(m):
        for k in range(i):
            if first[k] != k:
                continue
            turn2, near, far = 0.0, -patches.offset_mm[k], -patches.offset_mm[i]
            for u in range(3):
                turn2 += (patches.normal[i, u] - patches.normal[k, u]) ** 2
                near += patches.normal[k, u] * patches.centroid_mm[i, u]
                far += patches.normal[i, u] * patches.centroid_mm[k, u]
            # Pieces are tilted as the bias is: far from a small one its plane tells little.
            if turn2 < close_rad**2 and abs(near) < close_mm and abs(far) < 4.0 * close_mm:
                first[i] = k
                break
    return first


@compiled
def _add_view(
    view: View,
    known: Known,
    samples: int,
    close_rad: float,
    close_mm: float,
    sums: FloatArray,
    weight: FloatArray,
    count: FloatArray,
    most_mm: FloatArray,
) -> None:
    """Add some points to the normal equations (m, 6, 6) of their planes, by its largest piece."""
    fan, patches = view.fan, view.patches
    first = planes_of_pieces(patches, close_rad, close_mm)
    label, slope, depth = patches.label.reshape(-1), fan.slope.reshape(-1), fan.depth_mm.reshape(-1)
    sigma, columns = fan.sigma_mm.reshape(-1), fan.slope.shape[1]
    stride = max(label.size // samples, 1)
    while math.gcd(columns, stride) > 1:
        stride += 1  # or only some pixels would be looked at
    chosen, n = np.empty(label.size // stride + 1, np.int64), 0
    for j in range(stride // 2, label.size, stride):
        if label[j] >= 0:
            chosen[n] = j
            n += 1
    met, tangent, value = np.empty(n), np.empty(n), np.zeros(n)
    for k in range(n):
        j, normal = chosen[k], patches.normal[label[chosen[k]]]
        tangent[k] = tangent_of(slope[j], normal)
        met[k] = depth[j]
    if known.given:
        at = slope[chosen[:n]] if known.lateral else tangent
        look_up(known.bias, met, fan.apex_mm[2], at, value)
    row, planes = np.empty(6), planes_in_beams(fan, patches)
    for k in range(n):
        j = chosen[k]
        i = first[label[j]]
        centre = patches.centroid_mm[i]
        s, x = slope[j], fan.x_mm[j // columns]
        # The beam's foot on the plane of the largest piece: the noise is all in the depth.
        along = planes[i, 1] * s + planes[i, 2]
        foot = (planes[i, 3] - planes[i, 0] * x) / along
        lateral = PARABOLA_MM * s * s * (foot / AT_MM) ** 2
        w = 1.0 / sigma[j]
        row[0] = w / along
        row[1] = row[0] * (x - centre[0])
        row[2] = row[0] * (s * foot + fan.lean[0] * x + fan.apex_mm[1] - centre[1])
        row[TAKEN_OUT], row[LATERAL], row[DEPTHS] = (
            w * value[k], w * lateral, w * (depth[j] - foot),
        )  # fmt: skip
        for u in range(6):
            for v in range(u + 1):
                sums[i, u, v] += row[u] * row[v]
        weight[i] += w * w
        count[i] += 1.0
        most_mm[0] = max(most_mm[0], abs(value[k]))
        most_mm[1] = max(most_mm[1], lateral)
