"""One symmetric thing alone: no pose is sure that its symmetry turns into another."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

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
from registration.gauss_sphere.matching import settle_best
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.pipeline import describe
from registration.gauss_sphere.symmetry import turned_rivals

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


def turned_by(yaw_rad: float, x: float, y: float) -> tuple[float, float]:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return float(c * x - s * y), float(s * x + c * y)


def twins_from_two_sides(seed: int, noise: float) -> Pair:
    """Two equal boxes side by side, seen by two sensors that look down on them from two sides."""
    rng = np.random.default_rng(seed)
    yaw, half = rng.uniform(0.0, np.pi), list(rng.uniform([30.0, 30.0, 20.0], 60.0))
    away = rng.uniform(80.0, 130.0)
    things = [standing(half, 0.0, yaw, turned_by(yaw, x, 0.0)) for x in (-away, away)]
    views = [
        tilted(rng.uniform(-20.0, 20.0), rng.uniform(-8.0, 8.0), sign * rng.uniform(10.0, 40.0))
        for sign in (-1.0, 1.0)
    ]
    return seen_twice(things, views, rng, noise)


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


def houses_in_a_row(seed: int) -> Pair:
    """Three equal boxes with roofs at equal distances on a floor, from views that see some of them.

    The ridges lie along the row, so the roofs of all lie in two planes.
    """
    rng = np.random.default_rng([42, seed])
    half, deep, wall, rise = rng.uniform([50.0, 50.0, 25.0, 30.0], [80.0, 90.0, 50.0, 60.0])
    apart, yaw_rad = rng.uniform([200.0, -0.5], [300.0, 0.5])
    slope, length = np.arctan2(rise, half), np.hypot(rise, half)
    turn, things = Rotation.from_rotvec([0.0, 0.0, yaw_rad]), []
    for nth in (-1, 0, 1):
        things.append(
            standing([half, deep, wall], 0.0, yaw_rad, turned_by(yaw_rad, 0, nth * apart))
        )
        middle = MIDDLE + np.array([0.0, 0.0, FLOOR_MM - 2.0 * wall - 0.5 * rise])
        for side in (-1.0, 1.0):
            normal = turn.apply([side * np.sin(slope), 0.0, -np.cos(slope)])
            centre = middle + turn.apply([side * 0.5 * half, nth * apart, 0.0])
            axes = np.array([turn.apply([0.0, 1.0, 0.0]), normal])
            axes = np.array([axes[0], np.cross(normal, axes[0]), normal])
            things.append(Plates(centre[None], axes[None], np.array([[deep, 0.5 * length]])))
    views = [
        tilted(rng.uniform(-20.0, 20.0), rng.uniform(10.0, 35.0), rng.uniform(-10.0, 10.0))
        for _ in range(2)
    ]
    moved = [RigidTransform.from_translation([*rng.uniform(-150.0, 150.0, 2), 0.0]) for _ in views]
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


@pytest.mark.parametrize(
    ("row", "seed"),
    [*((brackets_in_a_row, seed) for seed in (40, 73, 95, 115, 123, 175, 176, 193)),
     (houses_in_a_row, 170)],
)  # fmt: skip
def test_a_thing_of_a_row_is_not_taken_for_the_next(row: Callable[[int], Pair], seed: int) -> None:
    # Seeds at which it was: of 160 of brackets, 10 were wrong, where outlines replaced poses by
    # others; of the last seeds, planes alone decided, and the true pose had not been looked for.
    pair = row(seed)
    result = register(pair.target, pair.source)
    if result.status == "ok":
        angle_deg, distance_mm = pose_error(result.T_target_source, pair.T_target_source)
        assert angle_deg < 1.0
        assert distance_mm < 15.0


def rivals_of_true_poses(pairs: list[Pair], **decision: float) -> int:
    """How many turned poses rival the true ones, however few planes these stand on."""
    every = replace(PARAMS, decision=replace(PARAMS.decision, turned_planes=99, **decision))
    count = 0
    for pair in pairs:
        target, source = (describe(scan, every) for scan in (pair.target, pair.source))
        rotation = np.ascontiguousarray(pair.T_target_source.rotation.as_matrix())
        shift = np.asarray(pair.T_target_source.translation)
        (pose,) = settle_best(target, source, rotation[None], shift[None], every, look_again=False)
        count += len(turned_rivals([pose], target, source, every))
    return count


def test_ends_of_faces_and_free_space_keep_rivals_out() -> None:
    pairs = [laid_table(seed) for seed in range(8)]
    asked = rivals_of_true_poses(pairs)
    without_ends = rivals_of_true_poses(pairs, turned_denied=1.0)
    without_both = rivals_of_true_poses(pairs, turned_denied=1.0, plain_contradiction=1.0)
    assert 3 * asked < without_ends
    assert without_ends < without_both
