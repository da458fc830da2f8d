"""One symmetric thing alone: no pose is sure that its symmetry turns into another."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    Pair,
    Plates,
    box_faces,
    clutter_pair,
    join,
    move_plates,
    plates_from,
    pose_error,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration import register
from registration.gauss_sphere.matching import settle_best
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.pipeline import describe
from registration.gauss_sphere.symmetry import TURNS_DEG, turned_rivals

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


def standing(half_mm: list[float], above_mm: float, yaw_rad: float) -> Plates:
    """A box in the middle, so far above the floor."""
    place = MIDDLE + np.array([0.0, 0.0, FLOOR_MM - above_mm - half_mm[2]])
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
    things: list[Plates], views: list[RigidTransform], rng: np.random.Generator, noise: float
) -> Pair:
    scene = join(FLOOR, *things)
    target, source = (
        scan_plates(move_plates(scene, view), profiles=80, noise=noise, rng=rng) for view in views
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


def counted(pairs: list[Pair]) -> Counter[str]:
    """Statuses, with "ok" as "right" or "wrong", and how many hold the true pose in any place."""
    counts = Counter[str]()
    for pair in pairs:
        result = register(pair.target, pair.source)
        right = is_right(result.T_target_source, pair.T_target_source)
        counts[("right" if right else "wrong") if result.status == "ok" else result.status] += 1
        if result.status == "ambiguous":
            scores = [candidate.score for candidate in result.candidates]
            assert scores == sorted(scores, reverse=True)
            others = [candidate.T_target_source for candidate in result.candidates]
            counts["held"] += right or any(is_right(T, pair.T_target_source) for T in others)
    return counts


@pytest.mark.parametrize("half_mm", [[75.0, 75.0, 75.0], [120.0, 80.0, 60.0]])
def test_a_box_from_above_is_not_taken_for_its_half_turn(half_mm: list[float]) -> None:
    counts = counted([box_from_above(seed, half_mm) for seed in range(16)])
    assert counts["wrong"] == 0
    assert counts["ambiguous"] >= 5
    assert counts["held"] >= 0.8 * counts["ambiguous"]


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_tiers_from_two_sides_are_not_taken_for_their_half_turn(noise: float) -> None:
    counts = counted([tiers_from_two_sides(seed, noise) for seed in range(16)])
    assert counts["wrong"] == 0
    assert counts["ambiguous"] >= 4
    assert counts["held"] >= 0.8 * counts["ambiguous"]


def test_turns_are_those_of_the_prisms_that_people_make() -> None:
    for sides in (2, 3, 4, 5, 6, 8):
        assert {360.0 * k / sides for k in range(1, sides)} <= set(TURNS_DEG)


@pytest.mark.parametrize("seed", range(6))
def test_things_without_a_symmetry_have_no_turned_rival(seed: int) -> None:
    """However few planes it stands on: here all are asked, as if they were few."""
    pair = clutter_pair(seed, noise=1.0)
    every = replace(PARAMS, decision=replace(PARAMS.decision, turned_planes=99))
    target, source = (describe(scan, every) for scan in (pair.target, pair.source))
    rotation = np.ascontiguousarray(pair.T_target_source.rotation.as_matrix())
    shift_mm = np.asarray(pair.T_target_source.translation)
    (pose,) = settle_best(target, source, rotation[None], shift_mm[None], every, look_again=False)
    assert turned_rivals(pose, target, source, every) == []
