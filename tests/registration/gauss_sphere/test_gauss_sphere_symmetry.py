"""One symmetric thing alone: no pose is sure that its symmetry turns into another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    Pair,
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
from registration.gauss_sphere.symmetry import turned_rivals

PARAMS = GaussSphereParams()
TOP_MM = 80.0  # of the box above the floor's middle, toward the sensor


def tilted(yaw_deg: float, tilt_deg: float, roll_deg: float) -> RigidTransform:
    """T_view_scene of a sensor that looks down on the scene's middle."""
    turn = Rotation.from_euler("XYZ", [roll_deg, tilt_deg, yaw_deg], degrees=True)
    return RigidTransform.from_components(MIDDLE - turn.apply(MIDDLE), turn)


def box_from_above(seed: int, half_mm: list[float], noise: float = 0.1) -> Pair:
    """A box on a floor, alone, of which one view sees other sides than the other."""
    rng = np.random.default_rng(seed)
    floor = plates_from(
        np.array([[0.0, 0.0, -1.0]]),
        MIDDLE + np.array([[0.0, 0.0, TOP_MM]]),
        np.full((1, 2), 600.0),
    )
    yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, np.pi)])
    place = MIDDLE + np.array([0.0, 0.0, TOP_MM - half_mm[2]])
    scene = join(floor, box_faces(RigidTransform.from_components(place, yaw), np.array(half_mm)))
    views = [
        tilted(rng.uniform(-20.0, 20.0), sign * rng.uniform(5.0, 14.0), rng.uniform(-10.0, 10.0))
        for sign in (-1.0, 1.0)
    ]
    target, source = (
        scan_plates(move_plates(scene, view), profiles=80, noise=noise, rng=rng) for view in views
    )
    return Pair(target, source, views[0] * views[1].inv())


def is_right(estimate: RigidTransform | None, exact: RigidTransform) -> bool:
    return estimate is not None and pose_error(estimate, exact)[0] < 5.0


@pytest.mark.parametrize("half_mm", [[75.0, 75.0, 75.0], [120.0, 80.0, 60.0]])
@pytest.mark.parametrize("seed", range(8))
def test_a_box_from_above_is_not_taken_for_its_half_turn(seed: int, half_mm: list[float]) -> None:
    pair = box_from_above(seed, half_mm)
    result = register(pair.target, pair.source)
    assert result.status != "ok" or is_right(result.T_target_source, pair.T_target_source)


@pytest.mark.parametrize("seed", [1, 2, 3, 5, 6, 7])
def test_the_true_pose_of_a_cube_is_among_the_candidates(seed: int) -> None:
    pair = box_from_above(seed, [75.0, 75.0, 75.0])
    result = register(pair.target, pair.source)
    assert result.status == "ambiguous"
    poses = [result.T_target_source, *(c.T_target_source for c in result.candidates)]
    turns_deg = [pose_error(pose, poses[0])[0] for pose in poses[1:] if pose is not None]
    assert any(is_right(pose, pair.T_target_source) for pose in poses)
    assert np.any(np.abs(np.array(turns_deg) - 180.0) < 5.0)


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
