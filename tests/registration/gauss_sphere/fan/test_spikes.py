"""Wild points all over a scan, alone or a few side by side, are left out, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import clutter_pair, pose_error

from registration import Scan, register
from registration.gauss_sphere.fan.returns import usable_points
from registration.gauss_sphere.fan.spikes import leave_out_spikes


def with_spikes(scan: Scan, share: float, width: int, seed: int) -> tuple[Scan, np.ndarray]:
    """The scan with wild depths along its beams, so many side by side, and where they are."""
    rng, reach_mm = np.random.default_rng(seed), scan.points_mm[..., 2] - scan.apex_mm[2]
    wild = np.zeros(reach_mm.shape, np.bool_)
    factor = np.ones(reach_mm.shape)
    for p, u in np.argwhere(rng.random(reach_mm.shape) < share / width):
        wild[p, u : u + width] = True
        factor[p, u : u + width] = rng.uniform(500.0, 1500.0) / reach_mm[p, u : u + width]
    points_mm = scan.points_mm.copy()
    points_mm[..., 1] *= factor
    points_mm[..., 2] = reach_mm * factor + scan.apex_mm[2]
    return replace(scan, points_mm=points_mm), wild & np.isfinite(points_mm[..., 2])


@pytest.mark.parametrize("noise", [0.0, 1.0, 20.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_scan_without_spikes_keeps_its_points(seed: int, noise: float) -> None:
    scan = clutter_pair(seed, noise).target
    np.testing.assert_array_equal(usable_points(scan.points_mm), scan.valid)


@pytest.mark.parametrize("width", [1, 2, 3])
@pytest.mark.parametrize("share", [0.05, 0.15, 0.25])
def test_spikes_are_left_out_and_the_scene_is_kept(share: float, width: int) -> None:
    """Four of five spikes at least: by chance some lie near to others, or go on."""
    scan, wild = with_spikes(clutter_pair(2, 1.0).target, share, width, seed=4)
    usable = usable_points(scan.points_mm)
    assert usable[wild].mean() < 0.2
    assert usable[scan.valid & ~wild].mean() > 0.97


@pytest.mark.parametrize(("share", "width"), [(0.02, 1), (0.15, 1), (0.3, 1), (0.1, 2), (0.1, 3)])
@pytest.mark.parametrize("seed", [1, 2])
def test_scans_full_of_spikes_are_registered(seed: int, share: float, width: int) -> None:
    pair = clutter_pair(seed, 1.0)
    scans = [
        with_spikes(scan, share, width, 10 * seed + n)[0]
        for n, scan in enumerate((pair.target, pair.source))
    ]
    result = register(*scans)
    assert result.status == "ok"
    rotation_deg, translation_mm = pose_error(pair.T_target_source, result.T_target_source)
    assert rotation_deg < 0.2
    assert translation_mm < 3.0


def two_walls(rng: np.random.Generator, wall: str) -> np.ndarray:
    """(30, 200) depths of a wall at 500 mm, and beside it of another one, with noise."""
    p, u = np.mgrid[:30, :100]
    if wall == "far":
        far_mm = np.full(u.shape, 4000.0)
        return np.hstack([d + 2e-6 * d**2 * rng.normal(size=u.shape) for d in (far_mm / 8, far_mm)])
    steep_mm = 3000.0 - 15.0 * u - 15.0 * p
    return np.hstack([np.full(u.shape, 500.0), steep_mm]) + 0.5 * rng.normal(size=(30, 200))


@pytest.mark.parametrize("wall", ["far", "steep"])
@pytest.mark.parametrize("share", [0.0, 0.03])
def test_a_noisier_or_a_steep_wall_is_kept(wall: str, share: float) -> None:
    """Where noise grows with the depth, and where it differs little from point to point."""
    rng = np.random.default_rng(3)
    depth = two_walls(rng, wall)
    wild = rng.random(depth.shape) < share
    depth[wild] = rng.uniform(400.0, 4400.0, wild.sum())
    usable = np.ones(depth.shape, np.bool_)
    leave_out_spikes(depth, usable)
    assert usable.all() if share == 0.0 else usable[~wild].mean() > 0.97
    assert usable[wild].sum() <= 0.16 * wild.sum()


@pytest.mark.parametrize("step_mm", [2.0, 15.0, 25.0, 40.0])
def test_rounded_depths_are_kept(step_mm: float) -> None:
    depth = clutter_pair(1, 1.0).target.points_mm[..., 2]
    rounded = np.round(depth / step_mm) * step_mm
    usable = np.isfinite(rounded)
    leave_out_spikes(rounded, usable)
    assert usable.sum() == np.isfinite(rounded).sum()
