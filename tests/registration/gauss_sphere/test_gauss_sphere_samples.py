"""The samples of a view: those of every stride are spread over the scan, and stand for it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from plane_scans import random_clutter, scan_plates

from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.verification import (
    CONTRADICTION,
    SUPPORT,
    compare_both,
    comparison,
)
from registration.gauss_sphere.view import View, places_of_samples
from registration.scan import FloatArray

STRIDES = np.array(sorted({*GaussSphereParams().strides}, reverse=True))


@pytest.mark.parametrize("n", [1, 7, 40, 500, 1500])
def test_every_sample_has_a_place_of_its_own(n: int) -> None:
    np.testing.assert_array_equal(np.sort(places_of_samples(n, STRIDES)), np.arange(n))


@pytest.mark.parametrize("stride", STRIDES)
def test_the_first_samples_of_a_stride_are_spread_over_the_scan(stride: int) -> None:
    n = 1500
    along = np.argsort(places_of_samples(n, STRIDES))[: -(-n // stride)]
    gaps = np.diff(np.sort(np.concatenate([[0], along, [n]])))
    assert gaps.max() <= 3 * stride


def test_what_a_stride_adds_is_in_the_order_of_the_scan() -> None:
    n = 1500
    along = np.argsort(places_of_samples(n, STRIDES))
    ends = [0, *(-(-n // stride) for stride in STRIDES)]
    for first, last in pairwise(ends):
        assert (np.diff(along[first:last]) > 0).all()


def test_few_samples_are_no_more_than_some() -> None:
    looks = GaussSphereParams().verification
    assert looks.few_stride >= looks.rough_stride


def clutter_view() -> View:
    rng = np.random.default_rng(3)
    return describe(scan_plates(random_clutter(rng), noise=1.0, rng=rng), GaussSphereParams())


def compare(view: View, shift_mm: FloatArray, stride: int, areas: FloatArray) -> None:
    """Compare a view with itself, moved; areas (2,) out."""
    counts = np.empty((view.patches.n_points.size,) * 2, np.int64)
    how = comparison(GaussSphereParams().verification)
    compare_both(view.seen, view.seen, how, np.eye(3), shift_mm, 5.0, stride, counts, areas)


@pytest.mark.parametrize(
    ("stride", "within"), [(1, 0.05), (4, 0.1), (7, 0.3), (36, 0.5), (5000, 1.0)]
)
def test_samples_of_any_stride_stand_for_the_seen_surface(stride: int, within: float) -> None:
    view, areas = clutter_view(), np.empty(2)
    compare(view, np.zeros(3), stride, areas)
    assert areas[SUPPORT] > 0.0
    assert areas[SUPPORT] == pytest.approx(view.seen_mm2, rel=within)
    assert areas[CONTRADICTION] == 0.0


@pytest.mark.parametrize("stride", [1, 4, 7])
def test_a_view_moved_towards_the_sensor_stands_in_free_space(stride: int) -> None:
    """One way all but edges stand free; the other way round all is hidden, and says nothing."""
    view, areas, nearer_mm = clutter_view(), np.empty(2), np.array([0.0, 0.0, -60.0])
    compare(view, nearer_mm, stride, areas)
    assert areas[SUPPORT] < 0.1 * view.seen_mm2
    assert 0.35 * view.seen_mm2 < areas[CONTRADICTION] < 0.6 * view.seen_mm2
