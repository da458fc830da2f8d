"""The small matrices of the compiled loops, against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from registration.gauss_sphere.small_matrices import is_positive_definite


@pytest.mark.parametrize("least", [-1.0, -1e-3, 1e-3, 1.0])
def test_a_matrix_is_positive_definite_if_all_its_eigenvalues_are(least: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
        # Radians and millimetres: far apart in size.
        scale = np.diag([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
        values = np.concatenate([[least], rng.uniform(0.1, 10.0, 5)])
        matrix = scale @ turn @ np.diag(values) @ turn.T @ scale
        assert is_positive_definite(matrix) == (least > 0.0)


@pytest.mark.parametrize("matrix", [np.zeros((6, 6)), np.full((6, 6), np.nan)])
def test_nothing_known_is_not_positive_definite(matrix: np.ndarray) -> None:
    assert not is_positive_definite(matrix)
