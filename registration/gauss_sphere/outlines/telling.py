"""The outlines of a view that tell of a pose: not at grooves, and some of each direction."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.outlines.ends import Outlines, chosen, found_outlines
from registration.gauss_sphere.outlines.testimony import off_both_sides
from registration.gauss_sphere.outlines.what_is_seen import ON, what_is_at
from registration.gauss_sphere.params import OutlineParams
from registration.gauss_sphere.view import Seen, View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

ONE_DIRECTION = 0.9  # cosine between ways out of faces
BEYOND = (1.0, 1.5, 2.0)  # of the way to where a like view is asked: a groove may be as wide


def outlines_of(view: View, params: OutlineParams) -> Outlines:
    """The outlines that a view sees of its planes; of very many points, some of each direction."""
    found = found_outlines(view, params)
    off_mm = off_both_sides(view, view, params.off_mm)
    ends = _without_grooves(found, view.seen, off_mm, params.on_mm, params.behind_mm)
    return chosen(ends, _some_of_each_direction(ends.outward, params.most_points))


@compiled
def _without_grooves(
    outlines: Outlines, seen: Seen, off_mm: float, on_mm: float, behind_mm: float
) -> Outlines:
    """The outlines beyond which the view itself does not see the face go on.

    At a groove a face ends and goes on: another view would deny such an end in the right pose.
    """
    n = outlines.line.size
    outside, goes_on = np.empty((6, n)), np.zeros(n, np.bool_)
    for far in BEYOND:
        for j in range(n):
            for u in range(3):
                outside[u, j] = outlines.point_mm[j, u] + far * off_mm * outlines.outward[j, u]
        word = what_is_at(seen, outside, outlines.normal, n, on_mm, behind_mm)
        goes_on |= word == ON
    return chosen(outlines, np.flatnonzero(~goes_on))


@compiled
def _some_of_each_direction(outward: FloatArray, most: int) -> IntArray:
    """Numbers of at most so many of some directions (n, 3): all of the rare ones first.

    Along an edge that all planes share, a few ends of faces may be all that tells of a shift.
    """
    n = outward.shape[0]
    alike, leader, count = np.empty(n, np.int64), np.empty(n, np.int64), np.zeros(n, np.int64)
    n_directions = 0
    for j in range(n):
        k = 0
        while k < n_directions:
            cos = 0.0
            for u in range(3):
                cos += outward[leader[k], u] * outward[j, u]
            if cos > ONE_DIRECTION:
                break
            k += 1
        if k == n_directions:
            leader[k] = j
            n_directions += 1
        alike[j] = k
        count[k] += 1
    share, left = np.empty(n_directions, np.int64), most
    for place, k in enumerate(np.argsort(count[:n_directions], kind="mergesort")):
        share[k] = min(count[k], left // (n_directions - place))
        left -= share[k]
    kept, seen = np.empty(n, np.int64), np.zeros(n_directions, np.int64)
    n_kept = 0
    for j in range(n):
        k = alike[j]
        before, seen[k] = seen[k] * share[k] // count[k], seen[k] + 1
        if seen[k] * share[k] // count[k] > before:
            kept[n_kept] = j
            n_kept += 1
    return kept[:n_kept]
