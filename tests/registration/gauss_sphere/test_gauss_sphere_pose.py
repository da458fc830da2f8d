"""From planes to an answer: exact, the same when swapped, honest about what stays open."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from plane_scans import (
    move_plates,
    plates_from,
    pose_error,
    random_clutter,
    random_view,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration import Scan, register
from registration.gauss_sphere.params import GaussSphereParams
from registration.warm import no_bias


def pair(seed: int, noise: float) -> tuple[Scan, Scan, RigidTransform]:
    rng = np.random.default_rng([11, seed])
    made = random_clutter(rng)
    T_source_target = random_view(rng)
    target = scan_plates(made, noise=noise, rng=rng)
    source = scan_plates(move_plates(made, T_source_target), noise=noise, rng=rng)
    return target, source, T_source_target.inv()


def error_vector(T_estimated: RigidTransform, T_true: RigidTransform) -> np.ndarray:
    """(rotation vector, translation) of the perturbation on the left of the truth."""
    difference = T_estimated * T_true.inv()
    return np.append(difference.rotation.as_rotvec(), difference.translation)


@pytest.mark.parametrize("seed", range(6))
def test_noise_free_pairs_are_exact(seed: int) -> None:
    target, source, T_true = pair(seed, noise=0.0)
    result = register(target, source)
    assert result.status == "ok", result.reason
    angle_deg, distance_mm = pose_error(result.T_target_source, T_true)
    assert angle_deg < 1e-3
    assert distance_mm < 1e-2


@pytest.mark.parametrize("seed", range(12))
def test_noisy_pairs_are_registered_to_a_fraction_of_the_noise(seed: int) -> None:
    target, source, T_true = pair(seed, noise=1.0)
    result = register(target, source)
    assert result.status == "ok", result.reason
    angle_deg, distance_mm = pose_error(result.T_target_source, T_true)
    assert angle_deg < 0.3
    assert distance_mm < 3.0


def test_the_covariance_is_what_the_errors_are() -> None:
    distances = []
    for seed in range(40):
        target, source, T_true = pair(seed, noise=1.0)
        result = register(target, source)
        if result.status == "ok":
            error = error_vector(result.T_target_source, T_true)
            distances.append(error @ np.linalg.solve(result.covariance, error))
    assert len(distances) >= 38
    # Chi-square of 6 degrees of freedom: median 5.3 (a little less is cautious), 99 % below 16.8.
    assert 2.7 < np.median(distances) < 8.0
    assert np.mean(np.array(distances) < 16.8) > 0.85


@pytest.mark.parametrize("seed", range(4))
def test_swapping_the_roles_inverts_the_answer(seed: int) -> None:
    target, source, _ = pair(seed, noise=1.0)
    forth, back = register(target, source), register(source, target)
    assert (forth.status, back.status) == ("ok", "ok")
    angle_deg, distance_mm = pose_error(forth.T_target_source, back.T_target_source.inv())
    assert angle_deg < 0.01
    assert distance_mm < 0.1


def test_the_same_pair_gives_the_same_bits() -> None:
    target, source, _ = pair(0, noise=1.0)
    first, second = register(target, source), register(target, source)
    assert np.array_equal(first.T_target_source.as_matrix(), second.T_target_source.as_matrix())
    assert np.array_equal(first.covariance, second.covariance)


def test_the_apex_need_not_be_given() -> None:
    target, source, T_true = pair(3, noise=1.0)
    bare = [Scan.from_points(scan.points_mm, scan.step_mm) for scan in (target, source)]
    result = register(*bare)
    assert result.status == "ok"
    angle_deg, distance_mm = pose_error(result.T_target_source, T_true)
    assert angle_deg < 0.3
    assert distance_mm < 3.0


def test_one_plane_leaves_a_turn_and_two_shifts_open() -> None:
    normal = np.array([[0.2, 0.3, -1.0]]) / np.linalg.norm([0.2, 0.3, -1.0])
    scan = scan_plates(plates_from(normal, np.array([[100.0, 0.0, 800.0]]), np.full((1, 2), 90.0)))
    result = register(scan, scan)
    assert result.status == "underdetermined"
    assert result.T_target_source is None
    assert result.undetermined.shape == (3, 6)
    # Moving the plane along an open direction leaves it where it is.
    for direction in result.undetermined:
        turned = np.cross(direction[:3], normal[0])
        np.testing.assert_allclose(turned, 0.0, atol=1e-6)
        shift = np.cross(direction[:3], [100.0, 0.0, 800.0]) + direction[3:]
        assert abs(shift @ normal[0]) < 1e-6


def test_a_prism_leaves_the_shift_along_its_edges_open() -> None:
    rng = np.random.default_rng(5)
    edge = np.array([1.0, 0.1, 0.0]) / np.linalg.norm([1.0, 0.1, 0.0])
    normals = np.array(
        [Rotation.from_rotvec(a * edge).apply([0.1, -1.0, 0.0]) for a in (0.6, 1.6, 2.3)]
    )
    normals -= (normals @ edge)[:, None] * edge
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= -np.sign(normals[:, 2:])
    centres = np.array([[100.0, y, 800.0] for y in (-90.0, 0.0, 90.0)])
    made = plates_from(normals, centres, np.array([[400.0, 40.0]] * 3))
    target = scan_plates(made, noise=0.5, rng=rng)
    source = scan_plates(
        move_plates(made, RigidTransform.from_rotation(Rotation.from_euler("x", 5, degrees=True))),
        noise=0.5,
        rng=rng,
    )
    result = register(target, source)
    assert result.status == "underdetermined", result.reason
    assert result.undetermined.shape == (1, 6)
    along = result.undetermined[0, 3:] / np.linalg.norm(result.undetermined[0, 3:])
    assert abs(along @ edge) > 0.99
    assert "shift along" in result.reason
    assert "besides" not in result.reason


def test_a_roof_turned_around_is_named_besides_the_shift_that_it_leaves_open() -> None:
    normals = np.array([[0.0, 0.5, -1.0], [0.0, -0.5, -1.0]]) / np.hypot(0.5, 1.0)
    centres = np.array([[150.0, 80.0, 840.0], [150.0, -80.0, 840.0]])
    roof = plates_from(normals, centres, np.array([[400.0, 80.0 * np.hypot(1.0, 0.5)]] * 2))
    rng = np.random.default_rng(8)
    result = register(*(scan_plates(roof, noise=0.5, rng=rng) for _ in range(2)))
    assert result.status == "underdetermined"
    turns = [T.rotation.magnitude() for T in (result.T_target_source,
             *(c.T_target_source for c in result.candidates))]  # fmt: skip
    np.testing.assert_allclose(sorted(turns), [0.0, np.pi], atol=0.02)
    assert "besides, another pose fits about equally well" in result.reason


def test_a_symmetric_pyramid_is_ambiguous() -> None:
    rng = np.random.default_rng(6)
    turns = [Rotation.from_euler("z", a, degrees=True) for a in (0, 90, 180, 270)]
    middle = np.array([120.0, 0.0, 800.0])
    lean = np.array([0.6, 0.0, -0.8])
    made = plates_from(
        np.array([t.apply(lean) for t in turns]),
        np.array([middle + t.apply([55.0, 0.0, 0.0]) for t in turns]),
        np.full((4, 2), 38.0),
    )
    # All faces the same square, each with its sides along and across the slope.
    made.axes[:, 2] = [t.apply(lean) for t in turns]
    made.axes[:, 1] = [t.apply([0.0, 1.0, 0.0]) for t in turns]
    made.axes[:, 0] = [t.apply([0.8, 0.0, 0.6]) for t in turns]
    tilt = RigidTransform.from_rotation(Rotation.from_euler("x", 4, degrees=True))
    T_source_target = (
        RigidTransform.from_translation(middle) * tilt * RigidTransform.from_translation(-middle)
    )
    target = scan_plates(made, noise=0.3, rng=rng)
    source = scan_plates(move_plates(made, T_source_target), noise=0.3, rng=rng)
    result = register(target, source)
    assert result.status == "ambiguous", result.reason
    poses = [result.T_target_source, *(c.T_target_source for c in result.candidates)]
    angles = [pose_error(p, T_source_target.inv())[0] for p in poses]
    assert min(angles) < 2.0
    assert max(angles) > 80.0


def answers(workers: int, order: list[int], calibration: str) -> dict[int, bytes]:
    """Pose and covariance of some pairs, bit by bit, registered in that order by threads."""
    params = GaussSphereParams(calibration=calibration)

    def bits(seed: int) -> bytes:
        result = register(*pair(seed, noise=1.0)[:2], params=params)
        assert result.T_target_source is not None
        assert result.covariance is not None
        return result.T_target_source.as_matrix().tobytes() + result.covariance.tobytes()

    with ThreadPoolExecutor(workers) as pool:
        return dict(zip(order, pool.map(bits, order), strict=True))


@pytest.mark.parametrize("calibrated", [False, True])
def test_threads_order_and_process_do_not_change_a_bit(calibrated: bool, tmp_path: Path) -> None:
    calibration = str(tmp_path / "calibration.json") if calibrated else ""
    if calibrated:
        no_bias().write(calibration)
    seeds = [0, 1, 2, 3]
    alone = answers(1, seeds, calibration)
    for order in (seeds[::-1], [2, 0, 3, 1] * 3):
        assert answers(4, order, calibration) == alone
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as fresh:
        assert fresh.submit(answers, 1, seeds[1:], calibration).result() == {
            seed: alone[seed] for seed in seeds[1:]
        }
