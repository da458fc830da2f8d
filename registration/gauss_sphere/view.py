"""A scan ready to be compared: what it saw, by beam, and points on its planes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from registration.gauss_sphere.fan.beams import Fan
from registration.gauss_sphere.planes.patches import Patches, planes_in_beams
from registration.gauss_sphere.planes.points import GOLDEN_RATIO
from registration.kernels import compiled
from registration.scan import FloatArray, IndexArray, IntArray

DEPTH, NEAREST, PATCH = range(3)  # columns of what a view saw
CELLS_PER_BEAM = 8
MOST_CELLS_PER_BEAM = 64  # where profiles lie far apart
UNSEEN = 1.5  # of the usual gap: what lies farther from every profile was not looked at
OPEN_GAP = 2.0  # of the usual gap: what is free beside a wider one is not known
NOT_KNOWN = np.float32(-np.inf)  # for the least depth: nothing in front of it is free


class Seen(NamedTuple):
    """What a view saw, as comparisons look it up, and what they look up in the other.

    Apart from the view, because a call costs as much as the arrays that it hands over.

    image: (profiles * pixels, 3) depth in mm, least of the nine depths there, -inf where one is
        missing, and patch, -1 for none. Side by side and in single precision, because comparisons
        look up the last two, and ends of faces the first and the last, all over the view.
    pixels: how many of a profile.
    profile_of: (cells,) the profile nearest to each cell along X, -1 where none is near; x_low_mm,
        cells_per_mm: where the cells lie. Profiles need not be evenly spaced.
    pixel_of: (cells,) pixel of each cell of slope; slope_low, cells_per_slope: where they lie.
    apex_y_mm, apex_z_mm, lean_y, lean_z: see Fan.
    normal: (m, 3), offset_mm: (m,) of the patches.
    sample_mm: (3, n) points on the patches; sample_patch: (n,) theirs; sample_area: (n,) mm^2 that
        each stands for. The first one in s of them are spread over the scan, for every stride s
        that parameters name.
    """

    image: NDArray[np.float32]
    pixels: int
    profile_of: IndexArray
    x_low_mm: float
    cells_per_mm: float
    pixel_of: IndexArray
    slope_low: float
    cells_per_slope: float
    apex_y_mm: float
    apex_z_mm: float
    lean_y: float
    lean_z: float
    normal: FloatArray
    offset_mm: FloatArray
    sample_mm: FloatArray
    sample_patch: IntArray
    sample_area: FloatArray


class View(NamedTuple):
    """A scan ready to be compared.

    fan: its beams; patches: the planes that it shows; seen: what comparisons need of both;
    seen_mm2: the surface that its samples stand for.
    """

    fan: Fan
    patches: Patches
    seen: Seen
    seen_mm2: float


@compiled
def places_of_samples(n: int, strides: IntArray) -> IntArray:
    """(n,) the place of each of n samples that follow each other through the scan.

    The first ceil(n / s) places are spread over the scan for each of the strides s, as are
    multiples of the golden ratio. What one stride adds to the next is in the order of the scan, so
    that those that are looked up one after the other lie side by side.
    """
    place = np.empty(n, np.int64)
    place[np.argsort(np.arange(n) * GOLDEN_RATIO % 1.0, kind="mergesort")] = np.arange(n)
    ends = np.sort(-(-n // strides))
    place[np.argsort(np.searchsorted(ends, place, side="right"), kind="mergesort")] = np.arange(n)
    return place


@compiled
def view_of(fan: Fan, patches: Patches, place: IntArray, strides: IntArray, max_gap: int) -> View:
    """Prepare a scan for verification.

    place: places_of_samples, of as many as are wanted, for these strides.
    """
    n_all = patches.n_points.sum()
    if n_all < place.size:
        place = places_of_samples(n_all, strides)
    profile_of, x_low, cells_per_mm = _nearest_profiles(fan)
    pixel_of, slope_low, cells_per_slope = _nearest_pixels(fan.column_slope)
    label, n = patches.label, place.size
    points, patch, area = np.empty((3, n)), np.empty(n, np.int64), np.empty(n)
    sampled = np.zeros(patches.n_points.size)
    planes, x_mm = planes_in_beams(fan, patches), fan.x_mm
    _, apex_y, apex_z = fan.apex_mm
    lean_y, lean_z = fan.lean
    met, j, due = 0, 0, 0  # even steps through the scan
    for p in range(label.shape[0]):
        for u in range(label.shape[1]):
            i = label[p, u]
            if i < 0:
                continue
            if met == due and j < n:
                # Where the beam meets its patch: a point's noise would only blur the comparison.
                x, slope, k = x_mm[p], fan.slope[p, u], place[j]
                depth = (planes[i, 3] - planes[i, 0] * x) / (planes[i, 1] * slope + planes[i, 2])
                points[0, k] = x
                points[1, k] = apex_y + lean_y * x + slope * depth
                points[2, k] = apex_z + lean_z * x + depth
                patch[k] = i
                sampled[i] += 1.0
                j += 1
                due = j * n_all // n
            met += 1
    for j in range(n):
        area[j] = patches.area_mm2[patch[j]] / sampled[patch[j]]
    seen = Seen(
        _image(fan, label, planes, max_gap),
        label.shape[1],
        profile_of,
        x_low,
        cells_per_mm,
        pixel_of,
        slope_low,
        cells_per_slope,
        apex_y,
        apex_z,
        lean_y,
        lean_z,
        patches.normal,
        patches.offset_mm,
        points,
        patch,
        area,
    )
    return View(fan, patches, seen, area.sum())


@compiled
def _image(fan: Fan, label: IndexArray, planes: FloatArray, max_gap: int) -> NDArray[np.float32]:
    rows, columns = label.shape
    image = np.empty((rows, columns, 3), np.float32)
    widest, gap = OPEN_GAP * fan.gap_mm, np.abs(np.diff(fan.x_mm))
    # The least of three depths in a profile, of the three latest profiles.
    depth, beside = np.empty(columns, np.float32), np.full((3, columns), NOT_KNOWN)
    for latest in range(rows + 1):
        if latest < rows:
            _take_profile(fan, latest, label[latest], planes, max_gap, depth, image[latest])
            _take_least(depth, beside[latest % 3])
        if latest == 0:
            continue
        row = image[latest - 1]
        if 1 < latest < rows and max(gap[latest - 2], gap[latest - 1]) <= widest:
            x, y, z = beside[0], beside[1], beside[2]
            for u in range(columns):
                least = x[u] if x[u] < y[u] else y[u]
                row[u, NEAREST] = least if least < z[u] else z[u]
        else:
            row[:, NEAREST] = NOT_KNOWN
    return image.reshape(-1, 3)


@compiled
def _take_profile(
    fan: Fan,
    profile: int,
    label: IndexArray,
    planes: FloatArray,
    max_gap: int,
    depth: NDArray[np.float32],
    row: NDArray[np.float32],
) -> None:
    """Depths (pixels,) of a profile, and its row (pixels, 3) of the image but for NEAREST, out.

    Up to max_gap beams that brought nothing back, between two that met the same patch, are taken
    to have met it as well.
    """
    measured, last = fan.depth_mm[profile], 0
    for u in range(measured.size):
        d = measured[u]
        depth[u] = d
        row[u, DEPTH], row[u, PATCH] = d, label[u]
        if np.isnan(d):
            continue
        if 1 < u - last <= max_gap + 1 and 0 <= label[u] == label[last]:
            i = label[u]
            for v in range(last + 1, u):
                along = planes[i, 1] * fan.column_slope[v] + planes[i, 2]
                depth[v] = (planes[i, 3] - planes[i, 0] * fan.x_mm[profile]) / along
                row[v, DEPTH], row[v, PATCH] = depth[v], i
        last = u


@compiled
def _take_least(depth: NDArray[np.float32], least: NDArray[np.float32]) -> None:
    """The least of three depths (pixels,), out but for both ends, which stay as they are."""
    # Not by min and isfinite: loops with them run on one point at a time.
    for u in range(1, depth.size - 1):
        a, b, c = depth[u - 1], depth[u], depth[u + 1]
        m = a if a < b else b
        m = m if m < c else c
        least[u] = m if abs(a + b + c) < -NOT_KNOWN else NOT_KNOWN


@compiled
def _nearest_profiles(fan: Fan) -> tuple[IndexArray, float, float]:
    """As _nearest, -1 far from all profiles; cells end half a usual gap beyond the outermost."""
    low, high = fan.x_mm.min() - 0.5 * fan.gap_mm, fan.x_mm.max() + 0.5 * fan.gap_mm
    cells, most = 0, MOST_CELLS_PER_BEAM * fan.x_mm.size
    if fan.gap_mm > 0.0:
        cells = min(int(np.rint(CELLS_PER_BEAM * (high - low) / fan.gap_mm)), most)
    return _nearest(fan.x_mm, low, high, cells, UNSEEN * fan.gap_mm)


@compiled
def _nearest_pixels(column_slope: FloatArray) -> tuple[IndexArray, float, float]:
    """As _nearest, of slopes NaN where they are not known."""
    low, high = np.nanmin(column_slope), np.nanmax(column_slope)
    known = np.isfinite(column_slope).sum()
    half = 0.5 * (high - low) / max(known - 1, 1)
    cells = CELLS_PER_BEAM * column_slope.size if high > low else 0
    return _nearest(column_slope, low - half, high + half, cells, np.inf)


@compiled
def _nearest(
    place: FloatArray, low: float, high: float, cells: int, farthest: float
) -> tuple[IndexArray, float, float]:
    """Which of the places is nearest to each of even cells from low to high, -1 if none is near.

    Returns it (cells,), low, and cells per unit; one cell with -1 where there are none.
    """
    nearest = np.full(max(cells, 1), -1, np.int32)
    if cells == 0:
        return nearest, 0.0, 0.0
    known = np.flatnonzero(np.isfinite(place))
    order = known[np.argsort(place[known], kind="mergesort")]
    places, upper = place[order], 1
    for i in range(cells):
        centre = low + (i + 0.5) * (high - low) / cells
        while upper < places.size - 1 and places[upper] < centre:
            upper += 1
        nearer = upper - 1 if centre - places[upper - 1] < places[upper] - centre else upper
        if abs(places[nearer] - centre) <= farthest:
            nearest[i] = order[nearer]
    return nearest, low, cells / (high - low)


@compiled
def beams_at(seen: Seen, points: FloatArray, beam: IntArray) -> None:
    """The beam (n,), out, that passes nearest to each point, -1 for none.

    points: (6, n or more) x, y and z in mm, and, out, the depth as the profile through the point
    sees it; the last two rows are room to work in, as this is called too often to ask for it.
    """
    profile_of, x_low, per_mm = seen.profile_of, seen.x_low_mm, seen.cells_per_mm
    pixel_of, slope_low, per_slope = seen.pixel_of, seen.slope_low, seen.cells_per_slope
    along, across, pixels = profile_of.size, pixel_of.size, seen.pixels
    apex_y, apex_z, lean_y, lean_z = seen.apex_y_mm, seen.apex_z_mm, seen.lean_y, seen.lean_z
    xs, ys, zs, depth, row, column = (
        points[0], points[1], points[2], points[3], points[4], points[5],
    )  # fmt: skip
    # First where, then what is there: the first loop runs on vectors of points.
    for j in range(beam.size):
        x, z = xs[j], zs[j] - lean_z * xs[j] - apex_z
        r, c = (x - x_low) * per_mm, ((ys[j] - lean_y * x - apex_y) / z - slope_low) * per_slope
        inside = (r >= 0.0) & (r < along) & (c >= 0.0) & (c < across) & (z > 1.0)
        depth[j], row[j], column[j] = z, r, c if inside else -1.0
    for j in range(beam.size):
        beam[j] = -1
        if column[j] >= 0.0:
            p, u = profile_of[np.int64(row[j])], pixel_of[np.int64(column[j])]
            if p >= 0 and u >= 0:
                beam[j] = p * pixels + u
