from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenes import SCENES
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import NoiseParams
from sensors.paths import aimed_view, straight_line
from sensors.sigma import depth_variance_mm2

RANDOM_ONLY = NoiseParams(
    bulge="none", dropout=False, shadow=False, ghosts=False, mixed=False, quantised=False
)


@pytest.fixture(scope="module")
def view():
    entry = SCENES["desk"]
    pose = aimed_view([0, 0, 100], 950.0, 0.2, np.deg2rad(25), 0.0, 12, 20.0)
    return entry.builder(entry.params_type()), straight_line(pose, 12, 20.0)


@pytest.mark.parametrize(
    "noise",
    [
        RANDOM_ONLY,
        replace(RANDOM_ONLY, speckle=False, texture=False),
        replace(RANDOM_ONLY, gaussian=False, texture=False, speckle_contrast=0.5),
        replace(RANDOM_ONLY, quantised=True),
    ],
)
def test_scans_scatter_by_the_variances(view, noise: NoiseParams) -> None:
    scene, path = view
    sensor = Jupiter(JupiterParams(noise=noise))
    hits = sensor.hits(scene, path)
    variance = depth_variance_mm2(sensor, scene, hits)
    sums, count = np.zeros(variance.shape), 60
    rng = np.random.default_rng(5)
    for _ in range(count):
        error = sensor.scan(scene, path, rng).points_mm[..., 2] - hits.points_mm[..., 2]
        sums += error**2
    inside = hits.valid & np.isfinite(sums)
    ratio = (sums / count / variance)[inside]
    # Some 3,000 beams by 60 scans: 0.3 % for the mean of all; rounding and its approximation more.
    assert ratio.size > 2000
    assert abs(ratio.mean() - 1.0) < 0.02
    for depth_group in np.array_split(np.argsort(hits.points_mm[..., 2][inside]), 4):
        assert abs(ratio[depth_group].mean() - 1.0) < 0.05


def test_nothing_is_uncertain_without_noise(view) -> None:
    scene, path = view
    sensor = Jupiter(JupiterParams(noise=NoiseParams.exact()))
    hits = sensor.hits(scene, path)
    variance = depth_variance_mm2(sensor, scene, hits)
    assert (variance[hits.valid] == 0.0).all()
    assert np.isnan(variance[~hits.valid]).all()
