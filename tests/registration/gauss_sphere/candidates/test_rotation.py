"""Rotation candidates: each scored by the directions that agree, however many are looked at."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration.gauss_sphere.candidates.rotation import BLOCK, GaussSphere, rotation_candidates
from registration.gauss_sphere.params import RotationParams
from registration.scan import FloatArray


def sphere(direction: FloatArray, weight: FloatArray) -> GaussSphere:
    order = np.argsort(-weight, kind="stable")
    return GaussSphere(direction[order], weight[order], np.arange(weight.size))


@pytest.fixture
def pair() -> tuple[GaussSphere, GaussSphere, FloatArray]:
    """Fourteen directions of two views, with some noise and other areas, and the true rotation."""
    rng = np.random.default_rng(4)
    seen = rng.normal(size=(14, 3))
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    turn = Rotation.random(rng=5).as_matrix()
    noisy = seen + rng.normal(scale=0.01, size=seen.shape)
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    # n_target = R n_source.
    source = sphere(noisy @ turn, rng.uniform(1.0, 9.0, 14))
    return sphere(seen, rng.uniform(1.0, 9.0, 14)), source, turn


def agreeing_area(
    target: GaussSphere, source: GaussSphere, rotation: FloatArray, within_rad: float
) -> float:
    agrees = target.direction @ rotation @ source.direction.T > np.cos(within_rad)
    shared = np.minimum.outer(target.weight, source.weight)
    return float(np.where(agrees, shared, 0.0).max(axis=0).sum())


# At the wider tolerance several directions meet one, of which only the heaviest counts.
@pytest.mark.parametrize("overlap_rad", [0.09, 0.8])
def test_scores_are_the_area_that_agrees(
    pair: tuple[GaussSphere, GaussSphere, FloatArray], overlap_rad: float
) -> None:
    target, source, turn = pair
    # So many that they are looked at in several blocks, and none is left out as like another.
    params = RotationParams(overlap_tolerance_rad=overlap_rad, distinct_rad=1e-9, kept=8192)
    rotations, scores = rotation_candidates(target, source, params)
    assert scores.size > 2 * BLOCK  # whole blocks, and one that is not
    expected = [agreeing_area(target, source, r, overlap_rad) for r in rotations]
    np.testing.assert_allclose(scores, expected, rtol=1e-12)
    assert (np.diff(scores) <= 0.0).all()
    if overlap_rad < 0.1:
        assert Rotation.from_matrix(rotations[0] @ turn.T).magnitude() < 0.05


def test_no_more_candidates_than_there_is_room_for(
    pair: tuple[GaussSphere, GaussSphere, FloatArray],
) -> None:
    rotations, scores = rotation_candidates(*pair[:2], RotationParams(capacity=5))
    assert 0 < scores.size <= 5
    assert rotations.shape == (scores.size, 3, 3)


def test_one_direction_turns_nothing() -> None:
    one = sphere(np.array([[0.0, 0.0, -1.0]]), np.ones(1))
    rotations, scores = rotation_candidates(one, one, RotationParams())
    assert rotations.shape == (0, 3, 3)
    assert scores.size == 0
