"""Which outlines tell of a pose, and where along an open shift they put it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    ROOM,
    Plates,
    join,
    plates_from,
    pose_error,
    scan_plates,
    stairs,
    stairs_pair,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration import register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.appeal import _surest
from registration.gauss_sphere.judging.looking_along import (
    _how_far_along,
    _middle_of_run,
    _to_look_along,
    starts_along,
)
from registration.gauss_sphere.judging.open_directions import open_directions_of
from registration.gauss_sphere.outlines.ends import Ends, as_ends, found_outlines
from registration.gauss_sphere.outlines.telling import _some_of_each_direction, outlines_of
from registration.gauss_sphere.outlines.testimony import LEAST_SHARE, said, said_along
from registration.gauss_sphere.params import GaussSphereParams, OutlineParams
from registration.gauss_sphere.planes.patches import middle
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.view import View

PARAMS, HOW = GaussSphereParams(), OutlineParams()
ALONG = ROOM.apply([0.0, 1.0, 0.0])  # of the steps


def steps(boards: bool = True) -> Plates:
    """Stairs, and two boards before them, unlike each other, that end across."""
    lower = ([-50.0, -110.0, -90.0], "riser", [20.0, 17.0])
    upper = ([45.0, 95.0, -60.0], "riser", [20.0, 30.0])
    return stairs(*((lower, upper) if boards else ()))


def settled_at(target: View, source: View, T: RigidTransform, off_mm: float = 0.0) -> list[Settled]:
    r, t = T.rotation.as_matrix()[None], np.asarray(T.translation)[None] + off_mm * ALONG
    return settle_best(target, source, r, t, PARAMS, look_again=False)


@pytest.mark.parametrize(("counts", "most"), [((1000, 30, 7), 100), ((40, 40, 41), 60), ((5,), 9)])
def test_rare_directions_are_kept_whole_and_frequent_ones_thinned_evenly(
    counts: tuple[int, ...], most: int
) -> None:
    number = np.repeat(np.arange(len(counts)), counts)
    np.random.default_rng(0).shuffle(number)
    kept = _some_of_each_direction(np.eye(3)[number], most)
    assert len(kept) == min(most, len(number))
    assert (np.diff(kept) > 0).all()
    left = np.bincount(number[kept], minlength=len(counts))
    fair = most // len(counts)
    for n, count in zip(left, counts, strict=True):
        assert n == count if count <= fair else n >= fair
    for k, count in enumerate(counts):
        places = np.flatnonzero(np.isin(np.flatnonzero(number == k), kept))
        gaps = [b - a for a, b in pairwise([-1, *places, count])]
        assert max(gaps) <= -(-count // max(left[k], 1)) + 1


@pytest.mark.parametrize(("gap_mm", "seen"), [(9.0, False), (50.0, True)])
def test_a_groove_between_two_boards_is_no_end_of_them(gap_mm: float, seen: bool) -> None:
    normal, behind = np.array([[0.0, 0.0, -1.0]]), np.array([[150.0, 0.0, 1000.0]])
    left, right = (
        plates_from(
            normal, np.array([[150.0, side * (60.0 + 0.5 * gap_mm), 800.0]]), np.array([[80, 60.0]])
        )
        for side in (-1.0, 1.0)
    )
    plates = join(left, right, plates_from(normal, behind, np.array([[400.0, 400.0]])))
    view = describe(scan_plates(plates, noise=0.3, rng=np.random.default_rng(3)), PARAMS)
    every, telling = found_outlines(view, HOW), outlines_of(view, HOW)

    def of_the_groove(points_mm: np.ndarray) -> int:
        return int((np.abs(np.abs(points_mm[:, 1]) - 0.5 * gap_mm) < 4.0).sum())

    assert of_the_groove(every.point_mm) > 10
    assert (of_the_groove(telling.point_mm) > 10) == seen
    outer = np.abs(telling.point_mm[:, 1]) > 100.0
    assert outer.sum() > 10


def test_ends_say_along_a_direction_what_they_say_at_each_place() -> None:
    *scans, T = stairs_pair(steps(), 0)
    views = tuple(describe(scan, PARAMS) for scan in scans)
    ends = tuple(as_ends(outlines_of(view, HOW)) for view in views)
    r, t = np.ascontiguousarray(T.rotation.as_matrix()), np.asarray(T.translation)
    shifts_mm = np.array([-40.0, -8.0, 0.0, 24.0])
    words = said_along(r, t, ALONG, shifts_mm, *views, ends, HOW)
    # Of the two views' ends those that lead along the direction.
    share = ends[0].outward @ ALONG, ends[1].outward @ (r.T @ ALONG)
    across = tuple(
        Ends(*(each[np.abs(along) >= LEAST_SHARE] for each in all_of_them))
        for all_of_them, along in zip(ends, share, strict=True)
    )
    each = [said(r, t + shift * ALONG, *views, across, HOW) for shift in shifts_mm]
    np.testing.assert_array_equal(words, each)
    assert words[2, 0] > words[2, 1]
    assert words[0, 1] > words[0, 0]


@pytest.mark.parametrize("seed", range(4))
def test_few_ends_among_many_outlines_fix_the_shift_along_these(seed: int) -> None:
    target, source, T = stairs_pair(steps(), seed)
    result = register(target, source)
    assert result.status == "ok", result.reason
    turn_deg, _ = pose_error(result.T_target_source, T)
    at = T.inv().apply(MIDDLE)
    assert turn_deg < 0.5
    assert np.linalg.norm(result.T_target_source.apply(at) - MIDDLE) < 6.0
    open_end = stairs_pair(steps(boards=False), seed)
    assert register(*open_end[:2]).status == "underdetermined"


def test_poses_along_one_open_shift_are_looked_for_once_and_led_to_the_true_one() -> None:
    target_scan, source_scan, T = stairs_pair(steps(), 1)
    target, source = (describe(scan, PARAMS) for scan in (target_scan, source_scan))
    ends = as_ends(outlines_of(target, HOW)), as_ends(outlines_of(source, HOW))
    slid = [settled_at(target, source, T, off_mm)[0] for off_mm in (30.0, -45.0)]
    looked = [along for _, along in _to_look_along(slid, target, source, PARAMS)]
    assert looked[0] is not None
    assert abs(looked[0] @ ALONG) > 0.999
    assert looked[1] is None
    _, shifts = starts_along(slid, target, source, ends, PARAMS)
    nearest = np.linalg.norm(shifts - np.asarray(T.translation), axis=1).min()
    assert nearest < HOW.cell_mm
    for pose in slid:
        assert (np.linalg.norm(shifts - pose.shift_mm, axis=1) == 0.0).any()


def test_poses_far_apart_or_open_in_other_directions_are_looked_along_each() -> None:
    target_scan, source_scan, T = stairs_pair(steps(), 1)
    target, source = (describe(scan, PARAMS) for scan in (target_scan, source_scan))
    there = settled_at(target, source, T)[0]
    near, far, farthest = (
        there._replace(shift_mm=there.shift_mm + off_mm * ALONG)
        for off_mm in (0.4 * HOW.slide_mm, -0.4 * HOW.slide_mm, 0.6 * HOW.slide_mm)
    )
    # Planes fix the shift along the steps, and not the one across them.
    across = ROOM.apply([0.0, 0.0, 1.0])
    other_way = there._replace(sure=there.sure.copy())
    other_way.sure[3:, 3:] = np.eye(3) - np.outer(across, across)
    other_way.sure[:3, :3], other_way.sure[:3, 3:] = 1e9 * np.eye(3), 0.0
    other_way.sure[3:, :3] = 0.0

    def looked(poses: list[Settled]) -> list[bool]:
        return [along is not None for _, along in _to_look_along(poses, target, source, PARAMS)]

    assert looked([near, there, farthest]) == [True, False, False]
    assert looked([near, far, farthest]) == [True, True, False]
    assert looked([other_way, there]) == [True, True]


def test_a_pose_turned_a_little_about_the_surface_still_lies_along_another() -> None:
    target_scan, source_scan, T = stairs_pair(steps(), 1)
    target, source = (describe(scan, PARAMS) for scan in (target_scan, source_scan))
    there = settled_at(target, source, T)[0]
    turn = Rotation.from_rotvec(np.deg2rad([1.5, 0.0, 0.0])).as_matrix()
    centre = there.rotation @ middle(source.patches) + there.shift_mm
    turned = there._replace(
        rotation=turn @ there.rotation,
        shift_mm=turn @ (there.shift_mm - centre) + centre + 100.0 * ALONG,
    )
    far_mm = _how_far_along(there, turned, ALONG, source, PARAMS)
    assert far_mm == pytest.approx(100.0, abs=1e-6)
    aside = turned._replace(shift_mm=turned.shift_mm + 60.0 * ROOM.apply([0.0, 0.0, 1.0]))
    assert _how_far_along(there, aside, ALONG, source, PARAMS) is None


def test_of_poses_alike_the_one_that_leaves_least_open_stands_for_them() -> None:
    target_scan, source_scan, T = stairs_pair(steps(), 1)
    target, source = (describe(scan, PARAMS) for scan in (target_scan, source_scan))
    slid = settled_at(target, source, T)[0]
    known = slid._replace(sure=slid.sure + np.eye(6), score=0.5 * slid.score)
    elsewhere = slid._replace(shift_mm=slid.shift_mm + 200.0 * ALONG, score=0.9 * slid.score)
    assert open_directions_of(slid, target, PARAMS.decision).shape[0] == 1

    def surest(*poses: Settled) -> list[int]:
        return [id(pose) for pose in _surest(list(poses), target, source, PARAMS)]

    assert surest(slid, elsewhere, known) == [id(elsewhere), id(known)]
    assert surest(slid, elsewhere) == [id(slid), id(elsewhere)]
    # One may be like two that are not like each other: it is one pose all the same.
    within_mm = 0.7 * PARAMS.decision.distinct_mm
    between = known._replace(shift_mm=slid.shift_mm + within_mm * ALONG, score=0.8 * slid.score)
    beyond = slid._replace(shift_mm=slid.shift_mm + 2.0 * within_mm * ALONG, score=0.9 * slid.score)
    assert surest(slid, between, beyond) == [id(between)]


def test_a_place_is_the_middle_of_those_that_are_worth_as_much() -> None:
    worth = np.array([5, 5, 0, 7, 7, 7, 7, 5])
    assert [_middle_of_run(worth, k) for k in (0, 2, 3, 6, 7)] == [0, 2, 4, 4, 7]
