from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from harness.scoring.poses import (
    COARSE,
    FINE,
    PoseError,
    exact_pose,
    is_success,
    parameter_errors,
    pose_error,
    pose_from_parameters,
    six_parameters,
)
from sensors.paths import ViewPath

SEEDS = range(20)


def random_pose(rng: np.random.Generator) -> RigidTransform:
    return RigidTransform.from_components(rng.normal(0.0, 500.0, 3), Rotation.random(rng=rng))


@pytest.mark.parametrize("seed", SEEDS)
def test_parameters_and_pose_are_inverse(seed: int) -> None:
    pose = random_pose(np.random.default_rng(seed))
    six = six_parameters(pose)
    again = pose_from_parameters(six[:3], six[3:])
    np.testing.assert_allclose(again.as_matrix(), pose.as_matrix(), atol=1e-11)


def test_parameters_follow_equation_4_6() -> None:
    psi, phi, theta = np.deg2rad([10.0, -20.0, 30.0])
    c, s = np.cos, np.sin
    rx = np.array([[1, 0, 0], [0, c(psi), -s(psi)], [0, s(psi), c(psi)]])
    ry = np.array([[c(phi), 0, s(phi)], [0, 1, 0], [-s(phi), 0, c(phi)]])
    rz = np.array([[c(theta), -s(theta), 0], [s(theta), c(theta), 0], [0, 0, 1]])
    pose = pose_from_parameters(np.array([10.0, -20.0, 30.0]), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(pose.rotation.as_matrix(), rz @ ry @ rx, atol=1e-15)
    np.testing.assert_array_equal(pose.translation, [1.0, 2.0, 3.0])


def test_parameters_follow_equations_4_15_to_4_17_as_corrected() -> None:
    """In the thesis's letters, R = [[g, h, i], [j, k, l], [m, n, p]]."""
    poses = RigidTransform.from_rotation(Rotation.random(1000, rng=np.random.default_rng(0)))
    (g, _, _), (j, _, _), (m, n, p) = np.moveaxis(poses.rotation.as_matrix(), 0, -1)
    angles = [np.arctan2(n, p), np.arctan2(-m, np.hypot(g, j)), np.arctan2(j, g)]
    np.testing.assert_allclose(six_parameters(poses)[:, :3], np.rad2deg(angles).T, atol=1e-7)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_exact_pose_takes_the_source_frame_to_the_target_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_world_target, T_world_source = random_pose(rng), random_pose(rng)
    target, source = (
        ViewPath(RigidTransform.concatenate([pose]), 5.0)
        for pose in (T_world_target, T_world_source)
    )
    point_mm = rng.normal(0.0, 300.0, 3)
    in_target = exact_pose(target, source).apply(T_world_source.inv().apply(point_mm))
    np.testing.assert_allclose(in_target, T_world_target.inv().apply(point_mm), atol=1e-9)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-9, 1e-4, 1.0, 3.0])
def test_the_error_of_a_known_perturbation(angle_rad: float) -> None:
    rng = np.random.default_rng(5)
    exact = random_pose(rng)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis))
    moved = RigidTransform.from_components(
        np.add(exact.translation, [3.0, 0.0, -4.0]), turn * exact.rotation
    )
    error = pose_error(exact, moved)
    assert error.rotation_rad == pytest.approx(angle_rad, rel=1e-6, abs=1e-15)
    assert error.translation_mm == pytest.approx(5.0)


def test_parameter_errors_wrap_angles_only() -> None:
    exact = np.array([179.0, -179.0, 0.0, 179.0, -400.0, 0.0])
    estimated = np.array([-179.0, 179.0, 180.0, -179.0, 400.0, 0.0])
    np.testing.assert_allclose(
        parameter_errors(exact, estimated), [2.0, -2.0, 180.0, -358.0, 800.0, 0.0]
    )


def test_success_needs_both_tolerances_and_an_estimate() -> None:
    assert is_success(PoseError(np.deg2rad(0.99), 5.0), FINE)
    assert not is_success(PoseError(np.deg2rad(1.01), 0.0), FINE)
    assert not is_success(PoseError(0.0, 30.1), COARSE)
    assert not is_success(PoseError(np.nan, np.nan), COARSE)
    assert not is_success(None, COARSE)
