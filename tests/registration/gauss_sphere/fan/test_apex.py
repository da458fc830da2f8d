"""Where the beams of a scan meet, and their slopes from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import APEX_BEHIND_MM, Plates, plates_from, random_clutter, scan_plates

from registration import Scan
from registration.gauss_sphere.fan.beams import fan_of, measured


def flat() -> Plates:
    """A plate that faces the sensor, without relief."""
    centre, half = np.array([[120.0, 0.0, 800.0]]), np.array([[300.0, 300.0]])
    return plates_from(np.array([[0.0, 0.0, -1.0]]), centre, half)


def found_apex_mm(scan: Scan) -> np.ndarray:
    return fan_of(measured(replace(scan, apex_mm=None))).apex_mm


def test_the_apex_is_found_where_the_beams_meet() -> None:
    rng = np.random.default_rng(0)
    scan = scan_plates(random_clutter(rng), noise=1.0, rng=rng)
    np.testing.assert_allclose(found_apex_mm(scan), [0.0, 0.0, -APEX_BEHIND_MM], atol=1e-6)


def test_marks_of_no_return_absurdly_far_away_leave_the_apex() -> None:
    rng = np.random.default_rng(0)
    points_mm = scan_plates(random_clutter(rng), noise=1.0, rng=rng).points_mm.copy()
    points_mm[1, ::7] = 1e200
    apex_mm = fan_of(measured(Scan.from_points(points_mm, 5.0))).apex_mm
    np.testing.assert_allclose(apex_mm, [0.0, 0.0, -APEX_BEHIND_MM], atol=1e-6)


def test_a_scan_without_relief_gets_nearly_parallel_beams() -> None:
    scan = scan_plates(flat())
    assert found_apex_mm(scan)[2] < -1e4


@pytest.mark.parametrize(("noise", "relief"), [(0.0, False), (1.0, True)])
def test_only_a_scan_without_relief_takes_the_apex_that_was_measured(
    noise: float, relief: bool
) -> None:
    rng, known_mm = np.random.default_rng(0), np.array([1.0, 2.0, -70.0])
    made = random_clutter(rng) if relief else flat()
    scan = replace(scan_plates(made, noise=noise, rng=rng), apex_mm=None)
    apex_mm = fan_of(measured(scan, known_mm)).apex_mm
    np.testing.assert_allclose(
        apex_mm, [0.0, 0.0, -APEX_BEHIND_MM] if relief else known_mm, atol=1e-6
    )


@pytest.mark.parametrize("travel", [(1.0, 0.0, 0.0), (1.0, 0.4, 0.0), (1.0, 0.4, 0.3)])
def test_beams_have_their_slopes_wherever_along_the_motion_the_frame_begins(travel) -> None:
    slope, motion = np.linspace(-0.23, 0.23, 100), np.array(travel) / np.linalg.norm(travel)
    beams = np.stack([0.0 * slope, slope, np.ones_like(slope)], axis=1)
    apex_mm = np.array([300.0, 0.0, -60.0])
    points_mm = apex_mm + 3.0 * motion * np.arange(40)[:, None, None] + 800.0 * beams
    fan = fan_of(measured(Scan.from_points(points_mm, 3.0, apex_mm=apex_mm, travel=travel)))
    np.testing.assert_allclose(fan.column_slope, slope, atol=1e-12)
    np.testing.assert_allclose(fan.depth_mm, 800.0, atol=1e-9)
