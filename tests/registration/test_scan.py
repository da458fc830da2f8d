from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from registration import Scan, ScanError

ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True, width=32)
SHAPES = st.tuples(st.integers(1, 4), st.integers(1, 5), st.just(3))


@given(arrays.arrays(np.float64, SHAPES, elements=ANY_FLOAT))
def test_a_point_is_measured_whole_or_not_at_all(points_mm: np.ndarray) -> None:
    scan = Scan.from_points(points_mm, step_mm=5.0)
    whole = np.isfinite(points_mm).all(axis=2)
    np.testing.assert_array_equal(scan.valid, whole)
    np.testing.assert_array_equal(scan.points_mm[whole], points_mm[whole])
    assert np.isnan(scan.points_mm[~whole]).all()
    assert scan.n_valid == whole.sum()


def test_a_scan_keeps_its_own_copy_and_cannot_be_changed() -> None:
    points_mm = np.zeros((2, 3, 3))
    scan = Scan.from_points(points_mm, 5.0, np.ones((2, 3)), np.array([0.0, 0.0, -60.0]))
    points_mm[:] = 7.0
    assert (scan.points_mm == 0.0).all()
    for array in (scan.points_mm, scan.intensity, scan.apex_mm):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points_mm": np.zeros((4, 3))}, r"shape \(4, 3\); expected \(profiles, pixels, 3\)"),
        ({"points_mm": np.zeros((0, 5, 3))}, r"shape \(0, 5, 3\)"),
        ({"points_mm": [[["x", 1, 2]]]}, "points_mm is not an array of numbers"),
        ({"step_mm": 0.0}, "step_mm is 0.0; expected a number above 0, in mm"),
        ({"step_mm": -3.0}, "step_mm is -3.0"),
        ({"step_mm": np.nan}, "step_mm is nan"),
        ({"step_mm": "5"}, "step_mm is '5'; expected a number"),
        ({"step_mm": None}, "step_mm is None"),
        ({"step_mm": 5j}, "step_mm is 5j"),
        ({"step_mm": [5.0]}, r"step_mm is \[5.0\]"),
        ({"step_mm": [[1.0], [1.0, 2.0]]}, r"step_mm is \[\[1.0\]"),
        ({"intensity": np.zeros((3, 2))}, r"intensity has shape \(3, 2\); expected \(2, 3\)"),
        ({"apex_mm": [0.0, np.inf, 0.0]}, "apex_mm is .*; expected three finite lengths"),
        ({"apex_mm": [0.0, 0.0]}, "apex_mm is .*; expected three finite lengths"),
    ],
)
def test_what_cannot_be_a_scan_is_refused_in_one_line(arguments: dict, message: str) -> None:
    with pytest.raises(ScanError, match=message) as caught:
        Scan.from_points(**{"points_mm": np.zeros((2, 3, 3)), "step_mm": 5.0} | arguments)
    assert "\n" not in str(caught.value)


def test_points_in_another_order_of_memory_are_kept_row_by_row() -> None:
    points_mm = np.asfortranarray(np.random.default_rng(0).normal(size=(4, 5, 3)))
    scan = Scan.from_points(points_mm, 5.0)
    assert scan.points_mm.flags.c_contiguous
    np.testing.assert_array_equal(scan.points_mm, points_mm)


def test_points_under_a_mask_are_not_measured() -> None:
    points_mm = np.random.default_rng(0).normal(size=(4, 5, 3))
    masked = np.ma.masked_array(points_mm, np.repeat(points_mm[..., 2:] > 0.0, 3, axis=2))
    scan = Scan.from_points(masked, 5.0)
    np.testing.assert_array_equal(scan.valid, points_mm[..., 2] <= 0.0)
    assert np.isnan(scan.points_mm[~scan.valid]).all()
