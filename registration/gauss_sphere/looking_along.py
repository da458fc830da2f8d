"""Where along a shift that planes leave open ends of faces confirm a pose."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from registration.gauss_sphere.matching import Settled, different
from registration.gauss_sphere.open_directions import centre_of, open_directions_of
from registration.gauss_sphere.outlines import Ends
from registration.gauss_sphere.params import GaussSphereParams, OutlineParams
from registration.gauss_sphere.testimony import said_along
from registration.gauss_sphere.verification import compared
from registration.gauss_sphere.view import View
from registration.scan import FloatArray, IntArray


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
    how, along = params.outlines, _open_shift(pose, target, params)
    if along is None:
        return pose
    shifts_mm, worth = _worth_along(pose, along, how.carried_mm, target, source, ends, how)
    if worth.max() < how.worth_starting:
        return pose
    most = shifts_mm[worth == worth.max()]
    t = pose.shift_mm + most[abs(most).argmin()] * along
    areas, score = compared(
        target, source, pose.rotation, t, params.match.tolerances_mm[-1], params.verification
    )
    return pose._replace(shift_mm=t, areas=areas, score=score)


def placed_first(
    poses: list[Settled], target: View, source: View, params: GaussSphereParams
) -> list[Settled]:
    """The poses, of those along one open shift the ones first that leave nothing open."""
    left, ordered = list(range(len(poses))), list[Settled]()
    whole = [not open_directions_of(pose, target, params.decision).size for pose in poses]
    while left:
        pose = poses[left[0]]
        along = _open_shift(pose, target, params)
        before = [k for k in left[1:] if along is not None and whole[k]
                  and _is_along(pose, poses[k], along, source, params)]  # fmt: skip
        now = [*before, left[0]]
        ordered += [poses[k] for k in now]
        left = [k for k in left if k not in now]
    return ordered


def _to_look_along(
    settled: list[Settled], target: View, source: View, params: GaussSphereParams
) -> Iterator[tuple[Settled, FloatArray | None]]:
    """The poses, each with the direction (3,) that it is looked for along, if it is.

    It is not if it lies along there from an earlier one: both are looked for in the same places.
    """
    looked_for = list[Settled]()
    for pose in settled:
        along = _open_shift(pose, target, params)
        if along is None or any(_is_along(pose, o, along, source, params) for o in looked_for):
            yield pose, None
        else:
            looked_for.append(pose)
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
        k = int(worth.argmax())
        found.append((pose.rotation, pose.shift_mm + shifts_mm[k] * along))
        worth[abs(shifts_mm - shifts_mm[k]) <= params.decision.distinct_mm] = 0
    return [*found, *here]


def _open_shift(pose: Settled, target: View, params: GaussSphereParams) -> FloatArray | None:
    """(3,) the direction of the shift that planes leave open, if that is all they leave open."""
    open_directions = open_directions_of(pose, target, params.decision)
    if open_directions.shape[0] != 1:
        return None
    turn, shift = open_directions[0, :3], open_directions[0, 3:]
    along: FloatArray = shift + np.cross(turn, centre_of(pose, target))
    length = np.linalg.norm(along)
    if np.linalg.norm(turn) * params.decision.open_mm > length * params.decision.open_rad:
        return None
    return along / length


def _is_along(
    pose: Settled, other: Settled, along: FloatArray, source: View, params: GaussSphereParams
) -> bool:
    """Whether a pose is another one, shifted along a direction."""
    away = other.shift_mm - pose.shift_mm
    shifted = pose._replace(shift_mm=pose.shift_mm + (away @ along) * along)
    return len(different([shifted, other], source, params.decision)) == 1


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
