"""One symmetric thing alone: no pose is sure that its symmetry turns into another."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    Pair,
    Plates,
    box_faces,
    join,
    move_plates,
    plates_from,
    pose_error,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration import register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging import symmetry
from registration.gauss_sphere.judging.symmetry import symmetric_rivals
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.view import View

PARAMS = GaussSphereParams()
FLOOR_MM = 80.0  # below the middle, away from the sensor
FLOOR = plates_from(
    np.array([[0.0, 0.0, -1.0]]),
    MIDDLE + np.array([[0.0, 0.0, FLOOR_MM]]),
    np.full((1, 2), 600.0),
)


def tilted(yaw_deg: float, tilt_deg: float, roll_deg: float) -> RigidTransform:
    """T_view_scene of a sensor that looks down on the scene's middle."""
    turn = Rotation.from_euler("XYZ", [roll_deg, tilt_deg, yaw_deg], degrees=True)
    return RigidTransform.from_components(MIDDLE - turn.apply(MIDDLE), turn)


def standing(
    half_mm: list[float],
    above_mm: float,
    yaw_rad: float,
    aside_mm: tuple[float, float] = (0.0, 0.0),
) -> Plates:
    """A box so far above the floor and aside from the middle."""
    place = MIDDLE + np.array([*aside_mm, FLOOR_MM - above_mm - half_mm[2]])
    turn = Rotation.from_rotvec([0.0, 0.0, yaw_rad])
    return box_faces(RigidTransform.from_components(place, turn), np.array(half_mm))


def box_from_above(seed: int, half_mm: list[float], noise: float = 0.1) -> Pair:
    """A box on a floor, alone, of which one view sees other sides than the other."""
    rng = np.random.default_rng(seed)
    things = [standing(half_mm, 0.0, rng.uniform(0.0, np.pi))]
    views = [
        tilted(rng.uniform(-20.0, 20.0), sign * rng.uniform(5.0, 14.0), rng.uniform(-10.0, 10.0))
        for sign in (-1.0, 1.0)
    ]
    return seen_twice(things, views, rng, noise)


def is_right(estimate: RigidTransform | None, exact: RigidTransform) -> bool:
    return estimate is not None and pose_error(estimate, exact)[0] < 5.0


def seen_twice(
    things: list[Plates],
    views: list[RigidTransform],
    rng: np.random.Generator,
    noise: float,
    profiles: int = 80,
) -> Pair:
    scene = join(FLOOR, *things)
    target, source = (
        scan_plates(move_plates(scene, view), profiles, noise=noise, rng=rng) for view in views
    )
    return Pair(target, source, views[0] * views[1].inv())


def tiers_from_two_sides(seed: int, noise: float) -> Pair:
    """Three boxes on each other, seen by two sensors that look down on them from two sides."""
    rng = np.random.default_rng(seed)
    yaw, slimmer, heights = rng.uniform(0.0, np.pi), rng.uniform(0.7, 1.0), rng.uniform(15, 30, 3)
    things = [
        standing([half, slimmer * half, heights[i]], 2.0 * heights[:i].sum(), yaw)
        for i, half in enumerate((140.0, 95.0, 50.0))
    ]
    views = [
        tilted(rng.uniform(-20.0, 20.0), rng.uniform(-8.0, 8.0), sign * rng.uniform(10.0, 40.0))
        for sign in (-1.0, 1.0)
    ]
    return seen_twice(things, views, rng, noise)


def turned_by(yaw_rad: float, x: float, y: float) -> tuple[float, float]:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return float(c * x - s * y), float(s * x + c * y)


def twins_from_two_sides(seed: int, noise: float, profiles: int = 80) -> Pair:
    """Two equal boxes side by side, seen by two sensors that look down on them from two sides."""
    rng = np.random.default_rng(seed)
    yaw, half = rng.uniform(0.0, np.pi), list(rng.uniform([30.0, 30.0, 20.0], 60.0))
    away = rng.uniform(80.0, 130.0)
    things = [standing(half, 0.0, yaw, turned_by(yaw, x, 0.0)) for x in (-away, away)]
    views = [
        tilted(rng.uniform(-20.0, 20.0), rng.uniform(-8.0, 8.0), sign * rng.uniform(10.0, 40.0))
        for sign in (-1.0, 1.0)
    ]
    return seen_twice(things, views, rng, noise, profiles)


def laid_table(seed: int) -> Pair:
    """A box with two small things on it, which tell its sides apart, seen from about one side."""
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(0.0, np.pi)
    things = [standing([110.0, 80.0, 30.0], 0.0, yaw)]
    for half in ([18.0, 18.0, 18.0], [25.0, 15.0, 10.0]):
        aside = turned_by(yaw, rng.uniform(-80.0, 80.0), rng.uniform(-50.0, 50.0))
        things.append(standing(half, 60.0, rng.uniform(0.0, np.pi), aside))
    base = tilted(0.0, rng.uniform(15.0, 35.0), rng.uniform(15.0, 35.0))
    views = [tilted(rng.uniform(-12.0, 12.0), *rng.uniform(-8.0, 8.0, 2)) * base for _ in range(2)]
    return seen_twice(things, views, rng, noise=0.1)


def brackets_in_a_row(seed: int) -> Pair:
    """Three equal L brackets at equal distances on a floor, from views that see some of them."""
    rng = np.random.default_rng([41, seed])
    half, height = rng.uniform([50.0, 50.0], [80.0, 100.0])
    apart, yaw_rad, depth = rng.uniform([200.0, -0.5, 100.0], [300.0, 0.5, 200.0])
    things = []
    for nth in (-1, 0, 1):
        for half_mm, x, y in (
            ([half, 25.0, 0.5 * height], 0.0, 0.0),
            ([25.0, 0.3 * depth, 0.5 * height], half - 25.0, 0.3 * depth + 25.0),
        ):
            place = turned_by(yaw_rad, x, y + nth * apart)
            things.append(standing(half_mm, 0.0, yaw_rad, place))
    views = [
        tilted(rng.uniform(-20.0, 20.0), rng.uniform(10.0, 35.0), rng.uniform(-10.0, 10.0))
        for _ in range(2)
    ]
    moved = [RigidTransform.from_translation([*rng.uniform(-100.0, 100.0, 2), 0.0]) for _ in views]
    return seen_twice(things, [m * v for m, v in zip(moved, views, strict=True)], rng, 1.0)


def counted(pairs: list[Pair]) -> tuple[Counter[str], int]:
    """Statuses, with "ok" as "right" or "wrong", and how many hold the true pose in any place."""
    counts, held = Counter[str](), 0
    for pair in pairs:
        result = register(pair.target, pair.source)
        right = is_right(result.T_target_source, pair.T_target_source)
        counts[("right" if right else "wrong") if result.status == "ok" else result.status] += 1
        if result.status == "ambiguous":
            scores = [candidate.score for candidate in result.candidates]
            assert scores == sorted(scores, reverse=True)
            of_first = re.search(r"scores (\d+)% of the first", result.reason)
            assert of_first
            assert int(of_first[1]) <= 100
            others = [candidate.T_target_source for candidate in result.candidates]
            held += right or any(is_right(T, pair.T_target_source) for T in others)
    return counts, held


@pytest.mark.parametrize("half_mm", [[75.0, 75.0, 75.0], [120.0, 80.0, 60.0]])
def test_a_box_from_above_is_not_taken_for_its_half_turn(half_mm: list[float]) -> None:
    counts, held = counted([box_from_above(seed, half_mm) for seed in range(16)])
    assert counts["wrong"] == 0
    assert counts["ambiguous"] >= 5
    assert held >= 0.8 * counts["ambiguous"]


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_tiers_from_two_sides_are_not_taken_for_their_half_turn(noise: float) -> None:
    counts, held = counted([tiers_from_two_sides(seed, noise) for seed in range(16)])
    assert counts["wrong"] == 0
    assert counts["ambiguous"] >= 4
    assert held >= 0.8 * counts["ambiguous"]


def test_two_equal_boxes_from_two_sides_are_hardly_taken_for_each_other() -> None:
    """One still is: 16 % of the ends of faces deny its true pose, 3 % the wrong one."""
    pairs = [twins_from_two_sides(seed, noise) for noise in (0.1, 1.0) for seed in range(16)]
    counts, _ = counted(pairs)
    assert counts["wrong"] <= 1
    assert counts["ambiguous"] >= 12


def test_things_that_tell_sides_apart_leave_one_pose() -> None:
    counts, _ = counted([laid_table(seed) for seed in range(16)])
    assert counts["wrong"] == 0
    assert counts["right"] >= 14


def test_no_rival_is_lost_by_asking_some_ends_of_faces_first() -> None:
    # Of the last pair, some ends confirm the true pose less where they move it than where it was.
    pairs = [
        *(tiers_from_two_sides(seed, 1.0) for seed in range(8)),
        *(box_from_above(seed, [75.0, 75.0, 75.0]) for seed in range(8)),
        *(twins_from_two_sides(seed, 0.1) for seed in range(8)),
        twins_from_two_sides(5354, 1.0, profiles=100),
    ]
    loud = replace(PARAMS, decision=replace(PARAMS.decision, silent_planes=0))
    some = [register(pair.target, pair.source, params=loud) for pair in pairs]
    with patch("registration.gauss_sphere.judging.symmetry._worth_asking", lambda found, *_: found):
        every = [register(pair.target, pair.source, params=loud) for pair in pairs]
    assert Counter(result.status for result in every)["ambiguous"] >= 8
    assert every[-1].status == "ambiguous"
    for one, other in zip(some, every, strict=True):
        assert one.status == other.status
        assert len(one.candidates) == len(other.candidates)


@pytest.mark.parametrize("seed", [40, 73, 95, 115, 123, 175, 176, 193])
def test_a_bracket_of_a_row_is_not_taken_for_the_next(seed: int) -> None:
    # Seeds at which it was: of 160, 10 were wrong, where outlines replaced poses by others. Of the
    # last one planes alone decided, and the true pose had not been looked for.
    pair = brackets_in_a_row(seed)
    result = register(pair.target, pair.source)
    assert result.status in ("ok", "ambiguous", "underdetermined")
    poses = [result.T_target_source, *(c.T_target_source for c in result.candidates)]
    errors = [pose_error(pose, pair.T_target_source) for pose in poses]
    right = [angle_deg < 1.0 and distance_mm < 15.0 for angle_deg, distance_mm in errors]
    assert right[0] if result.status == "ok" else any(right)


def views_of(pair: Pair, params: GaussSphereParams) -> tuple[View, View]:
    return describe(pair.target, params), describe(pair.source, params)


def settled_at(
    pose: RigidTransform, views: tuple[View, View], params: GaussSphereParams
) -> Settled:
    """What planes make of a pose."""
    rotation, shift = np.ascontiguousarray(pose.rotation.as_matrix()), np.asarray(pose.translation)
    (settled,) = settle_best(*views, rotation[None], shift[None], params, look_again=False)
    return settled


def is_at(one: Settled, pair: Pair) -> bool:
    """Whether a pose is the true one."""
    pose = RigidTransform.from_components(one.shift_mm, Rotation.from_matrix(one.rotation))
    angle_deg, distance_mm = pose_error(pose, pair.T_target_source)
    return angle_deg < 1.0 and distance_mm < 15.0


def test_a_pose_further_along_needs_planes_and_hides_no_settled_one() -> None:
    pair = brackets_in_a_row(193)
    wrong, *_ = register(pair.target, pair.source).candidates
    views = views_of(pair, PARAMS)
    best = settled_at(wrong.T_target_source, views, PARAMS)
    (other,) = (one for one in symmetric_rivals([best], *views, PARAMS)[0] if is_at(one, pair))
    needed = replace(PARAMS.decision, sure_planes=0, repeat_planes=99.0)
    strict = replace(PARAMS, decision=needed)
    assert not any(is_at(one, pair) for one in symmetric_rivals([best], *views, strict)[0])
    assert any(is_at(one, pair) for one in symmetric_rivals([best, other], *views, strict)[0])


def rivals_of_true_poses(pairs: list[Pair], **decision: float) -> int:
    """How many turned poses rival the true ones, however few planes these stand on."""
    every = replace(PARAMS, decision=replace(PARAMS.decision, turned_planes=99, **decision))
    count = 0
    for pair in pairs:
        views = views_of(pair, every)
        pose = settled_at(pair.T_target_source, views, every)
        count += len(symmetric_rivals([pose], *views, every)[0])
    return count


def test_ends_of_faces_and_free_space_keep_rivals_out(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = [laid_table(seed) for seed in range(16)]
    # Planes that would stand where nothing was seen keep all of them out by themselves.
    assert rivals_of_true_poses(pairs, turned_denied=1.0, plain_contradiction=1.0) == 0
    monkeypatch.setattr(symmetry, "has_free_plane", lambda *_: False)
    asked = rivals_of_true_poses(pairs)
    without_ends = rivals_of_true_poses(pairs, turned_denied=1.0)
    without_both = rivals_of_true_poses(pairs, turned_denied=1.0, plain_contradiction=1.0)
    assert 3 * asked < without_ends
    assert without_ends < without_both


def test_poses_of_which_ends_of_faces_say_nothing_are_no_rivals_but_told() -> None:
    told = replace(PARAMS.decision, silent_planes=99, silent_share=PARAMS.decision.repeat_share)
    mute = replace(PARAMS, outlines=replace(PARAMS.outlines, least=10**9), decision=told)
    count = 0
    for seed in range(8):
        pair = tiers_from_two_sides(seed, noise=0.1)
        views = views_of(pair, PARAMS)
        pose = settled_at(pair.T_target_source, views, PARAMS)
        rivals, _ = symmetric_rivals([pose], *views, PARAMS)
        none, unsaid = symmetric_rivals([pose], *views, mute)
        assert not none
        assert len(unsaid) >= len(rivals)
        count += len(rivals)
    assert count >= 4
