"""Where along a shift that planes leave open ends of faces confirm a pose."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from registration.gauss_sphere.judging.open_directions import open_shift
from registration.gauss_sphere.outlines.ends import Ends
from registration.gauss_sphere.outlines.testimony import said_along
from registration.gauss_sphere.params import GaussSphereParams, OutlineParams
from registration.gauss_sphere.planes.patches import middle
from registration.gauss_sphere.refinement.matching import Settled, different, scored
from registration.gauss_sphere.view import View
from registration.scan import FloatArray, IntArray

ONE_WAY = 0.95  # cosine between directions that are looked along


def starts_along(
    settled: list[Settled],
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: GaussSphereParams,
) -> tuple[FloatArray, FloatArray]:
    """Rotations (n, 3, 3) and shifts (n, 3) of poses, and of where else ends of faces may put them.

    ends: of target and source.
    """
    starts = [
        start
        for pose, along in _to_look_along(settled, target, source, params)
        for start in _starts(pose, along, target, source, ends, params)
    ]
    return np.array([r for r, _ in starts]), np.array([t for _, t in starts])


def carried_back(
    pose: Settled,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: GaussSphereParams,
) -> Settled:
    """The pose, near by where ends confirm it: planes move it along a shift they hardly know."""
    how, along = params.outlines, open_shift(pose, target, params.decision)
    if along is None:
        return pose
    shifts_mm, worth = _worth_along(pose, along, how.carried_mm, target, source, ends, how)
    if worth.max() < how.worth_starting:
        return pose
    most = np.flatnonzero(worth == worth.max())
    nearest = int(most[abs(shifts_mm[most]).argmin()])
    t = pose.shift_mm + shifts_mm[_middle_of_run(worth, nearest)] * along
    return scored(pose._replace(shift_mm=t), target, source, params)


def _to_look_along(
    settled: list[Settled], target: View, source: View, params: GaussSphereParams
) -> Iterator[tuple[Settled, FloatArray | None]]:
    """The poses, each with the direction (3,) that it is looked for along, if it is.

    It is not if an earlier one is looked for along there, from a place so near that its reach takes
    in what lies around this one.
    """
    looked_for, near_mm = list[tuple[Settled, FloatArray]](), 0.5 * params.outlines.slide_mm
    for pose in settled:
        along, known = open_shift(pose, target, params.decision), False
        for other, other_along in looked_for:
            if along is not None and abs(along @ other_along) > ONE_WAY:
                far_mm = _how_far_along(pose, other, other_along, source, params)
                known = known or (far_mm is not None and abs(far_mm) < near_mm)
        if along is None or known:
            yield pose, None
        else:
            looked_for.append((pose, along))
            yield pose, along


def _starts(
    pose: Settled,
    along: FloatArray | None,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: GaussSphereParams,
) -> list[tuple[FloatArray, FloatArray]]:
    """Where along the one shift that its planes leave open ends confirm it, and the pose."""
    how, here = params.outlines, [(pose.rotation, pose.shift_mm)]
    if along is None:
        return here
    shifts_mm, worth = _worth_along(pose, along, how.slide_mm, target, source, ends, how)
    found: list[tuple[FloatArray, FloatArray]] = []
    most = max(worth.max() * how.peak_share, how.worth_starting)
    while worth.max() >= most and len(found) < params.verification.kept:
        k = _middle_of_run(worth, int(worth.argmax()))
        found.append((pose.rotation, pose.shift_mm + shifts_mm[k] * along))
        worth[abs(shifts_mm - shifts_mm[k]) <= params.decision.distinct_mm] = 0
    return [*found, *here]


def _how_far_along(
    pose: Settled, other: Settled, along: FloatArray, source: View, params: GaussSphereParams
) -> float | None:
    """How far in mm a pose is to be shifted along a direction to be another; None if it never is.

    It is measured where poses are compared: in the middle of the surface.
    """
    there = middle(source.patches)
    away = other.rotation @ there + other.shift_mm - pose.rotation @ there - pose.shift_mm
    far_mm = float(away @ along)
    shifted = pose._replace(shift_mm=pose.shift_mm + far_mm * along)
    return far_mm if len(different([shifted, other], source, params.decision)) == 1 else None


def _middle_of_run(worth: IntArray, k: int) -> int:
    """The middle of the places that are worth as much as place k, from there on to both sides."""
    first = last = k
    while first > 0 and worth[first - 1] == worth[k]:
        first -= 1
    while last + 1 < worth.size and worth[last + 1] == worth[k]:
        last += 1
    return (first + last) // 2


def _worth_along(
    pose: Settled,
    along: FloatArray,
    reach_mm: float,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: OutlineParams,
) -> tuple[FloatArray, IntArray]:
    """Shifts (m,) along a direction, in mm, and how many more ends confirm than deny each."""
    n = int(reach_mm / params.cell_mm)
    shifts_mm = params.cell_mm * np.arange(-n, n + 1, dtype=np.float64)
    words = said_along(pose.rotation, pose.shift_mm, along, shifts_mm, target, source, ends, params)
    return shifts_mm, words[:, 0] - words[:, 1]
