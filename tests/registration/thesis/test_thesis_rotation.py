"""Single normals, correspondences and the search, against laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration.thesis.angles import two_rotations
from registration.thesis.gauss_sphere import GaussSphere
from registration.thesis.params import RotationParams
from registration.thesis.rotation import (
    fit_rotation,
    match_normals,
    project_on_rotations,
    search_rotation,
    solve_correspondences,
)
from registration.thesis.triplet_search import angle_table, degenerate, equal_triplets

CASES = 1000


ANY = np.zeros((0, 0, 0, 0), dtype=bool)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def sphere(direction: np.ndarray, weight: np.ndarray) -> GaussSphere:
    order = np.argsort(-weight)
    return GaussSphere(direction[order], weight[order], np.argsort(order))


def facing(rng: np.random.Generator, k: int) -> np.ndarray:
    """Normals towards the sensor, no two within 6 degrees."""
    while True:
        n = unit(np.column_stack([rng.normal(scale=0.7, size=(k, 2)), -np.ones(k)]))
        if (angle_table(n) + np.eye(k)).min() > 0.1:
            return n


def test_two_rotations_are_found_from_one_normal() -> None:
    """(4-21), (4-22), corrected: among the answers is the true one, and all satisfy (4-19)."""
    rng = np.random.default_rng(1)
    for _ in range(CASES):
        R = Rotation.from_euler("YX", rng.uniform(-np.pi, np.pi, 2))
        n = unit(rng.normal(size=3))
        found = two_rotations(R.apply(n), n)
        np.testing.assert_allclose(found.apply(n) - R.apply(n), 0.0, atol=1e-9)
        assert (found * R.inv()).magnitude().min() < 1e-6
        theta = found.as_euler("ZYX")[:, 0]
        np.testing.assert_allclose(np.sin(theta), 0.0, atol=1e-9)  # Ry Rx, no turn about Z


def test_no_two_rotations_lead_where_only_a_turn_about_z_would() -> None:
    assert len(two_rotations([0.0, 1.0, 0.0], [1.0, 0.0, 0.0])) == 0


def literal_solution(normals: np.ndarray, source_normals: np.ndarray) -> np.ndarray:
    """(4-12) to (4-14) as printed: one 9 x 9 matrix."""
    A = np.zeros((9, 9))
    for i in range(3):
        for row in range(3):
            A[3 * i + row, 3 * row : 3 * row + 3] = source_normals[i]
    return np.linalg.solve(A, normals.ravel()).reshape(3, 3)


def test_solving_by_blocks_is_solving_the_nine_by_nine_system() -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        n, m = facing(rng, 3), facing(rng, 3)
        expected = literal_solution(n, m)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(solve_correspondences(n, m), expected, atol=1e-10 * scale)


def test_exact_normals_give_the_exact_rotation() -> None:
    rng = np.random.default_rng(3)
    R = Rotation.random(200, rng=rng).as_matrix()
    m = np.stack([facing(rng, 3) for _ in R])
    n = m @ R.swapaxes(1, 2)
    solved, distance = project_on_rotations(solve_correspondences(n, m))
    np.testing.assert_allclose(solved, R, atol=1e-9)
    assert distance.max() < 1e-9
    np.testing.assert_allclose(fit_rotation(n, m, np.ones((200, 3))), R, atol=1e-9)


def test_a_mirrored_triplet_is_far_from_every_rotation() -> None:
    mirror = np.diag([1.0, 1.0, -1.0]) @ Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    R, distance = project_on_rotations(mirror)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert distance == pytest.approx(2.0)


def test_mirrored_normals_are_not_taken_for_turned_ones() -> None:
    n = facing(np.random.default_rng(5), 5)
    mirrored = n * [1.0, -1.0, 1.0]
    weight = np.ones(5)
    assert len(equal_triplets(n, weight, n, weight, 1e-6, 1000, 0.0, ANY)) == 10
    assert len(equal_triplets(n, weight, mirrored, weight, 1e-6, 1000, 0.0, ANY)) == 0


def test_coplanar_normals_are_degenerate() -> None:
    a, b, c = (np.array([np.sin(t), 0.0, -np.cos(t)]) for t in (-0.4, 0.1, 0.5))
    table = angle_table(np.stack([a, b, c]))
    assert degenerate(table[0, 1], table[0, 2], table[1, 2], 1e-6)
    around = angle_table(np.stack([[np.cos(t), np.sin(t), 0.0] for t in (0.0, 2.1, 4.2)]))
    assert degenerate(around[0, 1], around[0, 2], around[1, 2], 1e-6)
    upright = angle_table(np.eye(3))
    assert not degenerate(upright[0, 1], upright[0, 2], upright[1, 2], 1e-6)


def test_the_heaviest_hypotheses_are_kept() -> None:
    rng = np.random.default_rng(6)
    n = facing(rng, 8)
    weight = np.sort(rng.uniform(1, 10, 8))[::-1].copy()
    everything = equal_triplets(n, weight, n, weight, 0.2, 100_000, 0.0, ANY)
    few = equal_triplets(n, weight, n, weight, 0.2, 20, 0.0, ANY)

    def heft(rows: np.ndarray) -> np.ndarray:
        return np.minimum(weight[rows[:, :3]], weight[rows[:, 3:]]).sum(axis=1)

    assert len(everything) > 60
    np.testing.assert_allclose(heft(few), heft(everything)[:20])


@pytest.mark.parametrize("seed", range(5))
def test_search_finds_the_rotation_among_foreign_normals(seed: int) -> None:
    rng = np.random.default_rng(20 + seed)
    R = Rotation.from_rotvec(rng.normal(scale=0.5, size=3))
    shared, weight = facing(rng, 6), rng.uniform(1, 5, 6)
    target = sphere(
        np.vstack([shared, facing(rng, 4)]), np.concatenate([weight, rng.uniform(0.1, 1, 4)])
    )
    source = sphere(
        R.inv().apply(np.vstack([shared, facing(rng, 3)])),
        np.concatenate([weight, rng.uniform(0.1, 1, 3)]),
    )
    search = search_rotation(target, source, RotationParams())
    assert search.status == "ok"
    np.testing.assert_allclose(search.R_target_source[0], R.as_matrix(), atol=1e-9)
    smaller = min(target.weight.sum(), source.weight.sum())
    assert search.overlap[0] >= weight.sum() / smaller - 1e-9
    assert len(match_normals(target, source, search.R_target_source[0], 1e-6)) == 6


def test_two_normals_need_the_fallback_and_the_users_word() -> None:
    rng = np.random.default_rng(30)
    R = Rotation.from_euler("YX", [0.1, -0.4])
    n, weight = facing(rng, 2), np.array([2.0, 1.0])
    target, source = sphere(n, weight), sphere(R.inv().apply(n), weight)

    refused = search_rotation(target, source, RotationParams())
    assert (refused.status, len(refused.R_target_source)) == ("underdetermined", 0)
    assert "2 distinct normals in the target" in refused.reason

    search = search_rotation(target, source, RotationParams(zero_rotation="z"))
    assert search.two_rotations
    np.testing.assert_allclose(search.R_target_source[0], R.as_matrix(), atol=1e-9)


def test_no_equal_triplet_is_a_failure_that_says_so() -> None:
    weight = np.ones(3)
    steep = sphere(unit(np.array([[0.9, 0, -1], [-0.9, 0.1, -1], [0.1, 0.9, -1.0]])), weight)
    flat = sphere(unit(np.array([[0.2, 0, -1], [-0.2, 0.1, -1], [0.1, 0.2, -1.0]])), weight)
    search = search_rotation(steep, flat, RotationParams())
    assert search.status == "failed"
    assert "none of the 1 triplets of normals" in search.reason
