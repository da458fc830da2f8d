"""Poses turned about their planes: where they are moved to, and which of them are given up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plane_scans import random_clutter, scan_plates

from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.turning import Turning, _move_to_fit
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.verification import compared, comparison
from registration.gauss_sphere.view import View
from registration.scan import FloatArray

TOLERANCE_MM = 5.0
ALONG = np.eye(3)[:2]


@pytest.fixture(scope="module")
def view() -> View:
    rng = np.random.default_rng(3)
    return describe(scan_plates(random_clutter(rng), noise=1.0, rng=rng), GaussSphereParams())


def moved(view: View, needed_share: float, shift_mm: FloatArray) -> tuple[bool, FloatArray]:
    """A view moved to fit itself, if a pose needs such a share of what the view itself scores."""
    looks = GaussSphereParams().verification
    score = compared(view, view, np.eye(3), np.zeros(3), TOLERANCE_MM, looks)[1]
    turning = Turning(
        np.zeros(1), 1, math.cos(0.1), 50.0, TOLERANCE_MM, np.array([36, 12, 4]),
        needed_share * score, 0.1, 30.0,
    )  # fmt: skip
    shift_mm, n = shift_mm.copy(), view.patches.n_points.size
    counts = np.empty((n, n), np.int64)
    hopeful = _move_to_fit(
        view, view, comparison(looks), turning, np.eye(3), shift_mm, ALONG, counts
    )
    return hopeful, shift_mm


@pytest.mark.parametrize("off_mm", [[14.0, 0.0, 0.0], [0.0, -11.0, 0.0], [9.0, 9.0, 0.0]])
def test_a_pose_that_is_slid_along_is_moved_back(view: View, off_mm: list[float]) -> None:
    hopeful, shift_mm = moved(view, 1.0, np.array(off_mm))
    assert hopeful
    assert np.linalg.norm(shift_mm) < TOLERANCE_MM


# By a fourth of the samples the score is known to some per cent: 0.65 and 0.75 are far enough off.
@pytest.mark.parametrize(("needed_share", "hopeful"), [(1.1, True), (1.43, False), (1.8, False)])
def test_a_pose_is_given_up_where_it_fits_too_little(
    view: View, needed_share: float, hopeful: bool
) -> None:
    assert moved(view, needed_share, np.zeros(3))[0] == hopeful


def test_a_pose_in_free_space_is_given_up(view: View) -> None:
    assert not moved(view, 0.01, np.array([0.0, 0.0, -60.0]))[0]
