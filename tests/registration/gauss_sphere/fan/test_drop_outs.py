"""Beams that bring nothing back: their neighbours speak for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import clutter_pair, plates_from, pose_error, random_clutter, scan_plates

from registration import Scan, register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.fan.beams import fan_of, measured
from registration.gauss_sphere.fan.depth_noise import depth_noise
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.view import DEPTH, NEAREST, PATCH

DEFAULTS = GaussSphereParams()
MOST = DEFAULTS.segments.max_gap_pixels


def without(scan: Scan, missing: np.ndarray) -> Scan:
    points_mm = scan.points_mm.copy()
    points_mm[missing] = np.nan
    return Scan.from_points(points_mm, scan.step_mm, apex_mm=scan.apex_mm)


def half_of_them(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    return rng.random(shape) < 0.5


def all_but_every(nth: int):
    def missing(shape: tuple[int, int], _: np.random.Generator) -> np.ndarray:
        return np.broadcast_to(np.arange(shape[1]) % nth > 0, shape)

    return missing


@pytest.mark.parametrize("missing", [half_of_them, all_but_every(2), all_but_every(3)])
@pytest.mark.parametrize("seed", range(4))
def test_half_of_the_points_are_enough(missing, seed: int) -> None:
    rng = np.random.default_rng([31, seed])
    target, source, T_true = clutter_pair(seed, noise=1.0)
    thinned = [without(scan, missing(scan.points_mm.shape[:2], rng)) for scan in (target, source)]
    result = register(*thinned)
    assert result.status == "ok", result.reason
    angle_deg, distance_mm = pose_error(result.T_target_source, T_true)
    assert angle_deg < 0.5
    assert distance_mm < 5.0


@pytest.mark.parametrize("nth", [2, 4])
def test_the_noise_is_found_where_no_neighbour_returned(nth: int) -> None:
    rng = np.random.default_rng(1)
    scan = scan_plates(random_clutter(rng), 200, noise=1.0, rng=rng)
    whole, some = (
        fan_of(measured(each))
        for each in (scan, without(scan, all_but_every(nth)((200, 256), rng)))
    )
    for fan in (whole, some):
        constant, square = depth_noise(fan.depth_mm, fan.slope)
        assert constant + square * 1e6 == pytest.approx(0.3 + 770.0 * 1.2 / 1005.0, rel=0.1)


def test_columns_that_nothing_returned_to_lie_between_their_neighbours() -> None:
    scan = scan_plates(random_clutter(np.random.default_rng(1)))
    slope = fan_of(measured(scan)).column_slope
    missing = np.zeros((60, 256), dtype=bool)
    missing[:, 100:103] = missing[:, :5] = True
    left = fan_of(measured(without(scan, missing))).column_slope
    np.testing.assert_allclose(left[100:103], slope[100:103], atol=1e-4)
    assert np.isnan(left[:5]).all()


def test_outer_columns_that_nothing_returned_to_leave_areas_as_they_are() -> None:
    scan = scan_plates(random_clutter(np.random.default_rng(1)))
    nothing = np.full((60, 128, 3), np.nan)
    wide = replace(scan, points_mm=np.concatenate([nothing, scan.points_mm, nothing], axis=1))
    as_it_is, widened = (describe(s, DEFAULTS).patches for s in (scan, wide))
    np.testing.assert_array_equal(widened.area_mm2, as_it_is.area_mm2)


@pytest.mark.parametrize("gap", [1, MOST, MOST + 1])
def test_a_short_gap_in_a_plane_is_bridged(gap: int) -> None:
    wall = plates_from(
        np.array([[0.1, 0.2, -1.0]]), np.array([[120.0, 0.0, 800.0]]), np.full((1, 2), 300.0)
    )
    whole = scan_plates(wall)
    missing = np.zeros(whole.points_mm.shape[:2], dtype=bool)
    missing[:, 100 : 100 + gap] = True
    images = [
        describe(scan, DEFAULTS).seen.image.reshape(60, 256, 3)
        for scan in (whole, without(whole, missing))
    ]
    inside = np.s_[1:-1, 98 : 102 + gap]
    if gap > MOST:
        assert (images[1][:, 100 : 100 + gap, PATCH] == -1).all()
        assert np.isnan(images[1][:, 100 : 100 + gap, DEPTH]).all()
        assert (images[1][:, 100 : 100 + gap, NEAREST] == -np.inf).all()
    else:
        np.testing.assert_allclose(images[1][inside], images[0][inside], atol=1e-3)
    assert (images[0][inside][..., PATCH] == 0).all()
