"""Scenes whose planes leave directions open, or fit as well a step further."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    ROOM,
    Pair,
    Plates,
    box_faces,
    join,
    move_plates,
    plates_from,
    pose_error,
    random_view,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration import RegistrationResult, register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.open_directions import is_elsewhere, uncertainty
from registration.gauss_sphere.params import DecisionParams, GaussSphereParams, RefineParams
from registration.gauss_sphere.refinement.holding import Held, hold
from registration.gauss_sphere.refinement.matching import settle_best
from registration.scan import FloatArray


def in_room(place_mm: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(MIDDLE + ROOM.apply(place_mm), ROOM)


def room() -> Plates:
    """Floor and wall, which meet along the room's Y."""
    normals = ROOM.apply([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    places = MIDDLE + ROOM.apply([[-90.0, 0.0, -100.0], [100.0, 0.0, 170.0]])
    return plates_from(normals, places, np.array([[400.0, 500.0], [400.0, 500.0]]))


def pair_of(plates: Plates, rng: np.random.Generator) -> Pair:
    T_source_target = random_view(rng, turn_deg=15.0)
    return Pair(
        scan_plates(plates, noise=1.0, rng=rng),
        scan_plates(move_plates(plates, T_source_target), noise=1.0, rng=rng),
        T_source_target.inv(),
    )


def answer(pair: Pair) -> tuple[RegistrationResult, float, float]:
    result = register(pair.target, pair.source)
    assert result.T_target_source is not None, result.reason
    T_exact, T = pair.T_target_source, result.T_target_source
    middle = T_exact.inv().apply(MIDDLE)
    turn_deg, _ = pose_error(T, T_exact)
    return result, turn_deg, float(np.linalg.norm(T.apply(middle) - MIDDLE))


@pytest.mark.parametrize("seed", range(6))
def test_boxes_along_three_axes_are_found_in_spite_of_their_few_directions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = [
        box_faces(in_room(rng.uniform([-70, -200, -120], [-20, 200, 100])), rng.uniform(30, 80, 3))
        for _ in range(6)
    ]
    result, turn_deg, off_mm = answer(pair_of(join(room(), *boxes), rng))
    assert turn_deg < 0.5
    assert off_mm < (5.0 if result.status == "ok" else 60.0)


def ridges(rng: np.random.Generator) -> Pair:
    """Dozens of small planes of two directions, which run along the room's Y."""
    places = [
        [0.0, y + rng.uniform(-8, 8), z] for y in range(-200, 201, 50) for z in range(-90, 91, 60)
    ]
    side = np.arange(len(places)) % 2
    normals = ROOM.apply(np.stack([np.full(side.size, 0.3), 0 * side, 2.0 * side - 1.0], axis=1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= -np.sign(normals[:, 2:])
    halves = np.full((len(places), 2), 22.0)
    return pair_of(plates_from(normals, MIDDLE + ROOM.apply(places), halves), rng)


@pytest.mark.parametrize("seed", range(4))
def test_noisy_normals_of_two_directions_do_not_fix_the_third(seed: int) -> None:
    pair = ridges(np.random.default_rng(seed))
    assert register(pair.target, pair.source).status != "ok"


def moved_from_the_truth_mm(pair: Pair, params: GaussSphereParams) -> float:
    """How far settling carries the middle of the scene away from the true pose."""
    target, source = describe(pair.target, params), describe(pair.source, params)
    T = pair.T_target_source
    rotation, shift_mm = T.rotation.as_matrix()[None].copy(), T.translation[None].copy()
    (pose,) = settle_best(target, source, rotation, shift_mm, params, look_again=False)
    return float(np.linalg.norm(pose.rotation @ T.inv().apply(MIDDLE) + pose.shift_mm - MIDDLE))


def test_what_no_plane_fixes_is_not_carried_away() -> None:
    held, free = GaussSphereParams(), GaussSphereParams(refine=RefineParams(held_mm=1e9))
    pairs = [ridges(np.random.default_rng(seed)) for seed in range(8)]
    assert max(moved_from_the_truth_mm(pair, held) for pair in pairs) < 30.0
    assert max(moved_from_the_truth_mm(pair, free) for pair in pairs) > 60.0


def terraces(rng: np.random.Generator) -> Pair:
    """Dozens of small planes that all face the same way."""
    places = [
        [rng.uniform(-60, 60), y, z] for y in range(-200, 201, 50) for z in range(-90, 91, 60)
    ]
    normals = ROOM.apply(np.tile([0.0, 0.0, -1.0], (len(places), 1)))
    halves = np.full((len(places), 2), 22.0)
    return pair_of(plates_from(normals, MIDDLE + ROOM.apply(places), halves), rng)


def turned_from_the_truth_deg(pair: Pair, params: GaussSphereParams) -> float:
    """How far settling turns the true pose; infinite where it loses it."""
    target, source = describe(pair.target, params), describe(pair.source, params)
    rotation = pair.T_target_source.rotation.as_matrix()
    start = rotation[None].copy(), pair.T_target_source.translation[None].copy()
    left = settle_best(target, source, *start, params, look_again=False)
    if not left:
        return np.inf
    return float(np.rad2deg(Rotation.from_matrix(left[0].rotation @ rotation.T).magnitude()))


def test_what_no_plane_fixes_is_not_turned_away() -> None:
    held, free = GaussSphereParams(), GaussSphereParams(refine=RefineParams(held_rad=1e9))
    pairs = [terraces(np.random.default_rng(seed)) for seed in range(8)]
    assert max(turned_from_the_truth_deg(pair, held) for pair in pairs) < 15.0
    assert max(turned_from_the_truth_deg(pair, free) for pair in pairs) > 60.0


@pytest.mark.parametrize("turn_rad", [0.01, 0.5, 1.5, 3.0])
def test_a_hold_pulls_as_its_cost_falls(turn_rad: float) -> None:
    rng = np.random.default_rng(3)
    start, axis = Rotation.random(rng=rng), rng.standard_normal(3)
    middle, at_mm = rng.uniform(-300.0, 300.0, (2, 3))
    held = Held(middle, start.inv().apply(middle - at_mm), start.as_matrix(), 10.0, 0.1)
    turned = Rotation.from_rotvec(turn_rad * axis / np.linalg.norm(axis)) * start
    pose = RigidTransform.from_components(at_mm + rng.normal(0.0, 5.0, 3), turned)

    def cost_and_gradient(step: FloatArray) -> tuple[float, FloatArray]:
        by = RigidTransform.from_components(step[3:], Rotation.from_rotvec(step[:3])) * pose
        hessian, gradient = np.zeros((6, 6)), np.zeros(6)
        r, t = np.ascontiguousarray(by.rotation.as_matrix()), np.ascontiguousarray(by.translation)
        return hold(held, r, t, hessian, gradient), gradient

    _, gradient = cost_and_gradient(np.zeros(6))
    for u in range(6):
        step = 1e-5 * np.eye(6)[u]
        slope = (cost_and_gradient(step)[0] - cost_and_gradient(-step)[0]) / 2e-5
        assert 2.0 * gradient[u] == pytest.approx(slope, rel=1e-4, abs=1e-4)


def shelf(rng: np.random.Generator) -> Pair:
    """Compartments without end, and a second view two or three of them further."""
    width_mm, height_mm = rng.uniform(90.0, 130.0, 2)
    back = plates_from(
        ROOM.apply([[0.0, 0.0, -1.0]]),
        MIDDLE + ROOM.apply([[0.0, 0.0, 120.0]]),
        np.array([[500.0, 600.0]]),
    )
    uprights = [
        box_faces(in_room(np.array([0.0, k * width_mm, 30.0])), np.array([500.0, 7.0, 90.0]))
        for k in range(-7, 8)
    ]
    boards = [
        box_faces(in_room(np.array([k * height_mm, 0.0, 30.0])), np.array([7.0, 900.0, 90.0]))
        for k in range(-4, 5)
    ]
    further = [0.0, rng.uniform(2.0, 2.8) * width_mm, 0.0]
    T_source_target = random_view(rng, 15.0) * RigidTransform.from_translation(ROOM.apply(further))
    plates = join(back, *uprights, *boards)
    return Pair(
        scan_plates(plates, noise=1.0, rng=rng),
        scan_plates(move_plates(plates, T_source_target), noise=1.0, rng=rng),
        T_source_target.inv(),
    )


def test_a_pose_a_compartment_further_is_a_rival_though_it_shares_less() -> None:
    # Every pose that shares as much surface is wrong; some of them share less by a compartment.
    pairs = [shelf(np.random.default_rng(seed)) for seed in range(20)]
    results = [register(pair.target, pair.source) for pair in pairs]
    assert not any(result.status == "ok" for result in results)
    assert sum("repeats itself" in result.reason for result in results) > 15
    blind = GaussSphereParams(decision=DecisionParams(repeat_share=1.0))
    unseen = [register(pair.target, pair.source, params=blind).status for pair in pairs]
    assert "ok" in unseen


def test_a_pose_slid_along_an_open_direction_is_where_the_best_one_is() -> None:
    pair, params = ridges(np.random.default_rng(0)), GaussSphereParams()
    views = [describe(scan, params) for scan in (pair.target, pair.source)]
    T = pair.T_target_source
    rotation, shift_mm = T.rotation.as_matrix()[None].copy(), T.translation[None].copy()
    (best,) = settle_best(*views, rotation, shift_mm, params, look_again=False)
    _, open_directions, _ = uncertainty(best, best.sure, views[0], params.decision)
    assert open_directions.shape[0]
    along = open_directions[0, 3:] / np.linalg.norm(open_directions[0, 3:])
    across = np.cross(along, [0.3, -0.5, 0.8])
    across /= np.linalg.norm(across)
    for moved, elsewhere in ((250.0 * along, False), (250.0 * along + 40.0 * across, True)):
        slid = best._replace(shift_mm=best.shift_mm + moved)
        assert is_elsewhere(slid, best, open_directions, views[0], params.decision) is elsewhere
    turned = Rotation.from_rotvec(0.1 * across).as_matrix() @ best.rotation
    assert is_elsewhere(best._replace(rotation=turned), best, open_directions, views[0],
                        params.decision)  # fmt: skip
