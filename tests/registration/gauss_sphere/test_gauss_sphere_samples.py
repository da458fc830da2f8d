"""The samples of a view: those of every stride are spread over the scan, and follow its order."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from registration.gauss_sphere.view import places_of_samples

STRIDES = (36, 12, 4, 1)


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
