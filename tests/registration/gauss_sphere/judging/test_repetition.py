"""Scenes that repeat themselves: poses a period off question the answer, or are denied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    ROOM,
    Pair,
    Plates,
    box_faces,
    clutter_pair,
    join,
    move_plates,
    plates_from,
    pose_error,
    random_view,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration import Scan, register
from registration.gauss_sphere.candidates.translation import search_of, shifts_at
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.appeal import appealed
from registration.gauss_sphere.outlines.telling import outlines_of
from registration.gauss_sphere.outlines.testimony import denied_share, is_doubtful
from registration.gauss_sphere.params import GaussSphereParams, OutlineParams, WideParams
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.view import View

PERIOD_MM = 100.0
ALONG = ROOM.apply([0.0, 1.0, 0.0])
PARAMS = GaussSphereParams()


def room(*things: Plates) -> Plates:
    """Floor and wall, which meet along the room's Y, and what stands in front of them."""
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    places = np.array([[-90.0, 0.0, -100.0], [100.0, 0.0, 170.0]])
    empty = plates_from(ROOM.apply(normals), MIDDLE + ROOM.apply(places), np.full((2, 2), 500.0))
    return join(empty, *things)


def row(cubes: range) -> list[Plates]:
    """Equal cubes on the floor, an edge in front, so that two sides of each are seen."""
    turn = ROOM * Rotation.from_rotvec([np.pi / 4.0, 0.0, 0.0])
    places = [MIDDLE + ROOM.apply([-60.0, PERIOD_MM * k, 60.0]) for k in cubes]
    return [
        box_faces(RigidTransform.from_components(place, turn), np.full(3, 30.0)) for place in places
    ]


def pair_of(plates: Plates, seed: int) -> Pair:
    rng = np.random.default_rng(seed)
    T_source_target = random_view(rng, turn_deg=12.0)
    return Pair(
        scan_plates(plates, noise=1.0, rng=rng),
        scan_plates(move_plates(plates, T_source_target), noise=1.0, rng=rng),
        T_source_target.inv(),
    )


def views_of(pair: Pair) -> tuple[View, View]:
    target, source = (describe(scan, PARAMS) for scan in (pair.target, pair.source))
    return target, source


def off_by(T: RigidTransform, periods: float) -> tuple[np.ndarray, np.ndarray]:
    shift_mm = np.asarray(T.translation) + periods * PERIOD_MM * ALONG
    return np.ascontiguousarray(T.rotation.as_matrix()), shift_mm


def settled_at(target: View, source: View, r: np.ndarray, t: np.ndarray) -> Settled:
    (pose,) = settle_best(target, source, r[None], t[None], PARAMS, look_again=False)
    return pose


@pytest.mark.parametrize("seed", range(4))
def test_shifts_a_period_off_are_found(seed: int) -> None:
    pair = pair_of(room(*row(range(-6, 7))), seed)
    target, source = views_of(pair)
    for periods in (-2, -1, 0, 1, 2):
        r, t = off_by(pair.T_target_source, periods)
        found = shifts_at(target.patches, source.patches, r, search_of(PARAMS.wide, 50))
        assert np.linalg.norm(found - t, axis=1).min() < 8.0


@pytest.mark.parametrize("seed", range(4))
def test_a_settled_pose_brings_those_a_period_off_along(seed: int) -> None:
    pair = pair_of(room(*row(range(-6, 7))), seed)
    target, source = views_of(pair)
    r, t = off_by(pair.T_target_source, 0)
    found = settle_best(target, source, r[None], t[None], PARAMS)
    assert len(found) >= 3
    assert [pose.score for pose in found] == sorted((pose.score for pose in found), reverse=True)
    beside = np.array([(pose.shift_mm - t) @ ALONG / PERIOD_MM for pose in found])
    for periods in (-1, 0, 1):
        assert np.abs(beside - periods).min() < 0.02


@pytest.mark.parametrize("seed", range(4))
def test_a_row_that_never_ends_is_ambiguous(seed: int) -> None:
    pair = pair_of(room(*row(range(-6, 7))), seed)
    result = register(pair.target, pair.source)
    assert result.status == "ambiguous", result.reason


@pytest.mark.parametrize("turn_deg", [50.0, 60.0, 70.0])
def test_a_cube_is_not_taken_for_its_next_sides(turn_deg: float) -> None:
    """Of two sides of a cube in each view one is shared; a quarter turn off, both would be."""
    rng = np.random.default_rng(0)
    floor = plates_from(
        ROOM.apply([[1.0, 0.0, 0.0]]),
        MIDDLE + ROOM.apply([[-90.0, 0.0, 0.0]]),
        np.full((1, 2), 400.0),
    )
    turn = ROOM * Rotation.from_rotvec([np.pi / 4.0, 0.0, 0.0])
    cube = box_faces(RigidTransform.from_components(MIDDLE, turn), np.full(3, 90.0))
    around = ROOM * Rotation.from_rotvec([np.deg2rad(turn_deg), 0.0, 0.0]) * ROOM.inv()
    T_source_target = RigidTransform.from_components(MIDDLE - around.apply(MIDDLE), around)
    plates = join(floor, cube)
    target, source = (
        scan_plates(seen, profiles=80, noise=1.0, rng=rng)
        for seen in (plates, move_plates(plates, T_source_target))
    )
    result = register(target, source)
    right = result.T_target_source is not None and (
        pose_error(result.T_target_source, T_source_target.inv())[0] < 5.0
    )
    assert result.status != "ok" or right, result.reason


@pytest.mark.parametrize("seed", range(4))
def test_outlines_deny_a_pose_two_periods_off_where_the_row_ends(seed: int) -> None:
    pair = pair_of(room(*row(range(-1, 2))), seed)
    target, source = views_of(pair)
    right, wrong = (
        settled_at(target, source, *off_by(pair.T_target_source, periods)) for periods in (0, 2)
    )
    how = PARAMS.outlines
    outlines = outlines_of(target, how), outlines_of(source, how)
    for pose, denied in ((right, False), (wrong, True)):
        at = pose.rotation, pose.shift_mm, target, source
        assert is_doubtful(*at, how) == denied
        assert (denied_share(*at, outlines, how) > how.refuted_share) == denied
    left = appealed([wrong, right], target, source, outlines, 0.0, PARAMS)
    assert len(left) == 1
    assert np.linalg.norm(left[0].shift_mm - right.shift_mm) < 5.0


def test_an_answer_that_outlines_deny_is_taken_back() -> None:
    pair = clutter_pair(0, noise=1.0)
    assert register(pair.target, pair.source).status == "ok"
    # A single denial is too many, and no confirmation is enough.
    harsh = OutlineParams(refuted_share=0.0, refuting_share=0.0, least=1, confirmed_share=2.0)
    result = register(pair.target, pair.source, params=GaussSphereParams(outlines=harsh))
    assert (result.status, result.stage) == ("failed", "verification")
    assert result.T_target_source is None
    assert "outlines" in result.reason
    assert result.candidates


@pytest.mark.parametrize("every", [(1, 4), (4, 4), (5, 5), (1, 6)])
def test_ends_between_profiles_far_apart_deny_no_right_answer(every: tuple[int, int]) -> None:
    for seed in range(6):
        pair = clutter_pair(seed, noise=1.0)
        target, source = (
            Scan.from_points(scan.points_mm[::k], 5.0 * k, apex_mm=scan.apex_mm)
            for scan, k in zip((pair.target, pair.source), every, strict=True)
        )
        result = register(target, source)
        assert "outlines" not in result.reason, (seed, result.reason)


def test_a_pose_that_the_first_search_misses_is_found_widely() -> None:
    missed, found = 0, 0
    narrow = replace(PARAMS.translation, starts=0)
    off = replace(PARAMS, translation=narrow, wide=replace(PARAMS.wide, starts=0))
    for seed in range(4):
        pair = clutter_pair(seed, noise=1.0)
        missed += register(pair.target, pair.source, params=off).status == "failed"
        result = register(pair.target, pair.source, params=replace(PARAMS, translation=narrow))
        found += result.status == "ok"
        assert result.T_target_source is not None
        assert pose_error(result.T_target_source, pair.T_target_source)[1] < 5.0
    assert missed == found == 4


def test_one_field_of_the_wide_search_leaves_the_others_as_they_are() -> None:
    assert WideParams(tries=4000) == replace(PARAMS.wide, tries=4000)


@pytest.mark.parametrize("tilt_deg", [10.0, 13.0, 20.0])
def test_directions_that_differ_little_are_paired(tilt_deg: float) -> None:
    """A flat top and four sides that fall away from it by a little."""
    tilt = np.radians(tilt_deg)
    normals, places = [[0.0, 0.0, -1.0]], [[0.0, 0.0, 0.0]]
    for axis in range(2):
        for sign in (-1.0, 1.0):
            out = sign * np.eye(3)[axis]
            normals.append([*(np.sin(tilt) * out[:2]), -np.cos(tilt)])
            along = np.cos(tilt) * out + np.sin(tilt) * np.array([0.0, 0.0, 1.0])
            places.append(60.0 * out + 60.0 * along)
    top = plates_from(np.array(normals), MIDDLE + np.array(places), np.full((5, 2), 60.0))
    for seed in range(5):
        pair = pair_of(top, seed)
        target, source = views_of(pair)
        r, t = off_by(pair.T_target_source, 0)
        found = shifts_at(target.patches, source.patches, r, search_of(PARAMS.translation, 10))
        assert np.linalg.norm(found - t, axis=1).min() < 25.0
