"""Profiles that a trembling sensor moved in depth are moved back; those of a still one stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import clutter_pair, pose_error

from registration import Scan, register
from registration.gauss_sphere.beams import fan_of
from registration.gauss_sphere.trembling import moves_of_profiles


def moved(scan: Scan, by_mm: np.ndarray) -> Scan:
    """Each profile (profiles,) moved along its beams by as much depth."""
    reach_mm = scan.points_mm[..., 2] - scan.apex_mm[2]
    points_mm = scan.points_mm.copy()
    points_mm[..., 1] *= 1.0 + by_mm[:, None] / reach_mm
    points_mm[..., 2] += by_mm[:, None]
    return replace(scan, points_mm=points_mm)


def trembling(kind: str, n: int, seed: int) -> np.ndarray:
    """(n,) moves of 1 mm, as a root mean square."""
    rng = np.random.default_rng(seed)
    if kind == "each by itself":
        return rng.normal(size=n)
    period = {"every third alike": 3.0, "every seventh alike": 7.0}[kind]
    return np.sqrt(2.0) * np.sin(2.0 * np.pi * (np.arange(n) / period + rng.random()))


KINDS = ("each by itself", "every third alike", "every seventh alike")


@pytest.mark.parametrize("noise", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_profiles_that_lie_still_stay(seed: int, noise: float) -> None:
    fan = fan_of(clutter_pair(seed, noise).target)
    assert fan.moved_mm == 0.0
    assert moves_of_profiles(fan.x_mm, fan.depth_mm) is None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_moves_are_found_as_far_as_neighbours_tell(seed: int, kind: str) -> None:
    scan = clutter_pair(seed, 0.3).target
    by_mm = trembling(kind, len(scan.points_mm), seed)
    before, fan = fan_of(scan), fan_of(moved(scan, by_mm))
    assert fan.moved_mm == pytest.approx(1.0, abs=0.4)
    left_mm = np.nanmedian(fan.depth_mm - before.depth_mm, axis=1)
    # A move that is linear over the profiles tilts all planes: no neighbour tells.
    p = np.arange(len(by_mm))
    left_mm -= np.polyval(np.polyfit(p, left_mm, 1), p)
    assert np.sqrt((left_mm**2).mean()) < 0.4


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_scans_of_a_trembling_sensor_are_registered_and_told(seed: int, kind: str) -> None:
    pair = clutter_pair(seed, 1.0)
    scans = [
        moved(scan, 2.0 * trembling(kind, len(scan.points_mm), 10 * seed + n))
        for n, scan in enumerate((pair.target, pair.source))
    ]
    result = register(*scans)
    assert result.status == "ok", result.reason
    rotation_deg, translation_mm = pose_error(result.T_target_source, pair.T_target_source)
    assert rotation_deg < 1.0
    assert translation_mm < 10.0
    told = [note for note in result.notes if "too near or far" in note]
    assert [note.split()[3] for note in told] == ["target", "source"]
