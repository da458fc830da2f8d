"""Poses moved along their planes to where ends of faces confirm them."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.outlines.ends import Ends, ends_of
from registration.gauss_sphere.outlines.testimony import off_both_sides, said_of_ends
from registration.gauss_sphere.params import OutlineParams
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

STEPS_MM = np.array([8.0, 4.0, 2.0])


def placed(
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    params: OutlineParams,
) -> tuple[FloatArray, int, int]:
    """Move a pose along two directions to where most ends of faces confirm it, and fewest deny it.

    Support does not tell where along its planes it is.
    r: (3, 3), t: (3,) in mm, p_target = R p_source + t.  ends: of target and source.
    along: (2, 3).
    Returns t there, how many ends confirm the pose, and how many deny it.
    """
    there, how = t.copy(), (params.off_mm, params.on_mm, params.behind_mm)
    confirmed, denied, _ = _placed(target, source, *ends, r, there, along, STEPS_MM, *how)
    return there, confirmed, denied


def placed_by_some(
    target: View,
    source: View,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    params: OutlineParams,
) -> tuple[IntArray, int]:
    """What some ends of faces, which cost little to ask, say of poses that are moved as they like.

    r: (n, 3, 3), t: (n, 3), along: (n, 2, 3), as of `placed`.
    Returns (n, 3) how many of them confirm each pose and deny it where they leave it, and how many
    confirm it at most, of all places that are tried: so few may lead it astray. With these goes how
    many there are.
    """
    how = params.off_mm, params.on_mm, params.behind_mm
    looked = params.missing_pixels, params.every
    words, n_ends = _placed_by_some(target, source, r, t, along, STEPS_MM, *how, *looked)
    return words, n_ends


@compiled
def _placed_by_some(
    target: View,
    source: View,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    steps_mm: FloatArray,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
    missing_pixels: int,
    every: int,
) -> tuple[IntArray, int]:
    of_target = ends_of(target.fan, target.patches, behind_mm, missing_pixels, every)
    of_source = ends_of(source.fan, source.patches, behind_mm, missing_pixels, every)
    words = np.empty((t.shape[0], 3), np.int64)
    for c in range(t.shape[0]):
        words[c, 0], words[c, 1], words[c, 2] = _placed(
            target, source, of_target, of_source, r[c], t[c].copy(), along[c], steps_mm, off_mm,
            on_mm, behind_mm,
        )  # fmt: skip
    return words, of_target.point_mm.shape[0] + of_source.point_mm.shape[0]


@compiled
def _placed(
    target: View,
    source: View,
    of_target: Ends,
    of_source: Ends,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    steps_mm: FloatArray,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
) -> tuple[int, int, int]:
    """As `placed`, for compiled loops: t (3,) is changed in place.

    Last goes how many ends confirm the pose at most, of all places that are tried.
    """
    trial, seen = np.empty(3), (target.seen, source.seen)
    how = off_both_sides(target, source, off_mm), on_mm, behind_mm
    words = said_of_ends(r, t, *seen, of_target, of_source, *how)
    most = words[0]
    in_vain = np.empty((2, 2), np.bool_)  # ways that lead to no better place from here
    for step_mm in steps_mm:
        in_vain[:] = False
        for _ in range(3):
            for axis in range(2):
                for way in range(2):
                    if in_vain[axis, way]:
                        continue
                    for u in range(3):
                        trial[u] = t[u] + (2 * way - 1) * step_mm * along[axis, u]
                    there = said_of_ends(r, trial, *seen, of_target, of_source, *how)
                    in_vain[axis, way], most = True, max(most, there[0])
                    if there[0] - there[1] > words[0] - words[1]:
                        words = there
                        t[:] = trial
                        in_vain[:] = False
                        in_vain[axis, 1 - way] = True  # back to where it was
            if in_vain.all():
                break
    return words[0], words[1], most
