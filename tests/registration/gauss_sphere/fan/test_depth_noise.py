"""Noise that a sensor smoothed along its profiles counts as what it was before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from plane_scans import APEX_BEHIND_MM, Pair, clutter_pair, pose_error, random_clutter, scan_plates
from scipy.stats import chi2

from registration import Scan, register
from registration.gauss_sphere.fan.beams import fan_of, measured
from registration.gauss_sphere.fan.depth_noise import _smoothed_by

EDGE_MM = 10.0  # points farther off in depth are of another face
Smoothing = Callable[[np.ndarray], np.ndarray]


def in_windows(depth_mm: np.ndarray, half: int) -> np.ndarray:
    """(profiles, pixels, window) what is around each pixel on its own face, else NaN."""
    padded = np.pad(depth_mm, ((0, 0), (half, half)), constant_values=np.nan)
    around = sliding_window_view(padded, 2 * half + 1, axis=1)
    return np.where(abs(around - depth_mm[..., None]) < EDGE_MM, around, np.nan)


def mean_of(pixels: int) -> Smoothing:
    return lambda depth_mm: np.nanmean(in_windows(depth_mm, pixels // 2), axis=2)


def median_of(pixels: int) -> Smoothing:
    return lambda depth_mm: np.nanmedian(in_windows(depth_mm, pixels // 2), axis=2)


def bell(depth_mm: np.ndarray) -> np.ndarray:
    around, weight = in_windows(depth_mm, 5), np.exp(-0.5 * (np.arange(-5, 6) / 1.7) ** 2)
    return np.nansum(around * weight, axis=2) / (np.isfinite(around) * weight).sum(axis=2)


SMOOTHINGS = {
    "mean of 3": mean_of(3), "mean of 5": mean_of(5), "mean of 7": mean_of(7),
    "median of 3": median_of(3), "median of 5": median_of(5), "bell": bell,
}  # fmt: skip


def smoothed(scan: Scan, smoothing: Smoothing) -> Scan:
    """A scan as a sensor gives it that smooths its depths: points move along their beams."""
    points_mm = scan.points_mm.copy()
    depth_mm = points_mm[..., 2] + APEX_BEHIND_MM
    measured = np.isfinite(depth_mm)
    factor = np.ones_like(depth_mm)
    with np.errstate(all="ignore"):
        factor[measured] = (smoothing(depth_mm) / depth_mm)[measured]
    points_mm[..., 1] *= factor
    points_mm[..., 2] = depth_mm * factor - APEX_BEHIND_MM
    return replace(scan, points_mm=points_mm)


@pytest.mark.filterwarnings("ignore:Mean of empty slice", "ignore:All-NaN slice")
@pytest.mark.parametrize("kind", SMOOTHINGS)
@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_the_noise_is_found_that_a_scan_had_before(kind: str, noise: float) -> None:
    if kind.startswith("median"):
        noise = 1.0 + noise  # a steep face's points are in order if it is less
    rng = np.random.default_rng(1)
    scan = scan_plates(random_clutter(rng), noise=noise, rng=rng)
    plain, fan = fan_of(measured(scan)), fan_of(measured(smoothed(scan, SMOOTHINGS[kind])))
    before = np.nanmedian(plain.sigma_mm)
    assert np.nanmedian(fan.sigma_mm) == pytest.approx(before, rel=0.3)


@pytest.mark.filterwarnings("ignore:Mean of empty slice", "ignore:All-NaN slice")
@pytest.mark.parametrize("kind", SMOOTHINGS)
def test_smoothed_scans_are_registered_and_know_how_well(kind: str) -> None:
    inside = 0
    for seed in range(6):
        pair: Pair = clutter_pair(seed, noise=1.0)
        scans = (smoothed(scan, SMOOTHINGS[kind]) for scan in (pair.target, pair.source))
        result = register(*scans)
        assert result.status == "ok", result.reason
        turn_deg, off_mm = pose_error(result.T_target_source, pair.T_target_source)
        assert turn_deg < 0.5
        assert off_mm < 5.0
        off = pair.T_target_source * result.T_target_source.inv()
        error = np.append(off.rotation.as_rotvec(), off.translation)
        inside += error @ np.linalg.solve(result.covariance, error) < chi2.ppf(0.99, 6)
    assert inside >= 5


@pytest.mark.parametrize("pixels", [256, 64])
@pytest.mark.parametrize("noise", [0.0, 0.05, 1.0])
def test_a_scan_that_was_not_smoothed_keeps_its_noise(noise: float, pixels: int) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        # So many boxes that points a few of 64 pixels apart seldom lie on one face.
        clutter = random_clutter(rng, boxes=25)
        fan = fan_of(measured(scan_plates(clutter, pixels=pixels, noise=noise, rng=rng)))
        assert _smoothed_by(fan.depth_mm, fan.slope) == 1.0


@pytest.mark.parametrize("radius_mm", [60.0, 150.0, 400.0])
def test_a_round_surface_is_no_smoothed_noise(radius_mm: float) -> None:
    slope = np.tile(np.linspace(-0.3, 0.3, 256), (30, 1))
    # Where the beams meet cylinders side by side, their axes 800 mm away.
    middle = np.round(slope / 0.15) * 0.15
    ahead = 800.0 * (1.0 + slope * middle) / (1.0 + slope**2)
    across2 = radius_mm**2 - (800.0 * (slope - middle)) ** 2 / (1.0 + slope**2)
    depth_mm = ahead - np.sqrt(across2 / (1.0 + slope**2))
    depth_mm += np.random.default_rng(2).normal(0.0, 0.1, depth_mm.shape)
    assert _smoothed_by(depth_mm, slope) == 1.0


@pytest.mark.parametrize("step_mm", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_rounded_depths_are_no_smoothed_noise(noise: float, step_mm: float) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        fan = fan_of(measured(scan_plates(random_clutter(rng), pixels=640, noise=noise, rng=rng)))
        rounded = np.round((fan.depth_mm - APEX_BEHIND_MM) / step_mm) * step_mm + APEX_BEHIND_MM
        assert _smoothed_by(rounded, fan.slope) < 2.0
