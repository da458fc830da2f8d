"""Scenes whose planes leave directions open, or fit as well a step further."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import (
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

# Seen from above at a slant: floor and wall of a room in the frame of a sensor that looks along Z.
ROOM = Rotation.from_euler("YX", [35.0, 20.0], degrees=True)
MIDDLE = np.array([150.0, 0.0, 930.0])


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


@pytest.mark.parametrize("seed", range(4))
def test_ridges_of_two_directions_leave_the_shift_along_them_open(seed: int) -> None:
    """Dozens of small planes, whose noisy normals together seem to fix what none of them does."""
    rng = np.random.default_rng(seed)
    places = [
        [0.0, y + rng.uniform(-8, 8), z] for y in range(-200, 201, 50) for z in range(-90, 91, 60)
    ]
    side = np.arange(len(places)) % 2
    normals = ROOM.apply(np.stack([np.full(side.size, 0.3), 0 * side, 2.0 * side - 1.0], axis=1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= -np.sign(normals[:, 2:])
    halves = np.full((len(places), 2), 22.0)
    plates = plates_from(normals, MIDDLE + ROOM.apply(places), halves)
    pair = pair_of(plates, rng)
    result = register(pair.target, pair.source)
    assert result.status != "ok"


@pytest.mark.parametrize("seed", range(6))
def test_a_row_of_equal_boxes_is_never_sure_of_a_wrong_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    period = rng.uniform(90.0, 130.0)
    boxes = [
        box_faces(in_room(np.array([-50.0, k * period, 0.0])), np.array([40.0, 25.0, 60.0]))
        for k in range(-4, 5)
    ]
    T_source_target = random_view(rng, turn_deg=15.0)
    # As if the second view had been taken further along the row: the views share a part of it.
    further = RigidTransform.from_translation(ROOM.apply([0.0, rng.uniform(-1.2, 1.2) * period, 0]))
    T_source_target = T_source_target * further
    plates = join(room(), *boxes)
    target = scan_plates(plates, noise=1.0, rng=rng)
    source = scan_plates(move_plates(plates, T_source_target), noise=1.0, rng=rng)
    result = register(target, source)
    if result.status == "ok":
        assert result.T_target_source is not None
        assert pose_error(result.T_target_source, T_source_target.inv())[1] < 30.0
