"""How sure an answer is follows from all planes it matches, not from those that agree alone."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import random_clutter, scan_plates

from registration.gauss_sphere.params import GaussSphereParams, RefineParams
from registration.gauss_sphere.patches import Patches
from registration.gauss_sphere.pipeline import describe
from registration.gauss_sphere.refine import EXACTLY, likelihood, maximise, widened
from registration.scan import FloatArray


@pytest.fixture(scope="module")
def patches() -> Patches:
    rng = np.random.default_rng(3)
    scan = scan_plates(random_clutter(rng), noise=0.3, rng=rng)
    return describe(scan, GaussSphereParams()).patches


def moved(patches: Patches, by_mm: FloatArray) -> Patches:
    """Each plane moved along its normal."""
    return patches._replace(
        offset_mm=patches.offset_mm + by_mm,
        centroid_mm=patches.centroid_mm + by_mm[:, None] * patches.normal,
    )


def informations(target: Patches, source: Patches) -> tuple[FloatArray, FloatArray]:
    """By the planes that agree, and with all disagreement taken into account."""
    n = target.n_points.size
    pairs = np.stack([np.arange(n)] * 2, axis=1)
    r, t = np.eye(3), np.zeros(3)
    agreeing, sure, distance2 = np.empty((6, 6)), np.empty((6, 6)), np.empty(n)
    likely = likelihood(RefineParams())
    maximise(target, source, pairs, likely, 0.005, r, t, agreeing, distance2, EXACTLY)
    widened(target, source, pairs, likely, 0.005, r, t, sure, 0.0)
    return agreeing, sure


def test_planes_that_agree_are_believed(patches: Patches) -> None:
    agreeing, sure = informations(patches, patches)
    np.testing.assert_allclose(sure, agreeing, rtol=1e-9)


@pytest.mark.parametrize("error_mm", [1.0, 3.0])
def test_planes_that_disagree_make_unsure_by_as_much(patches: Patches, error_mm: float) -> None:
    signs = np.where(np.arange(patches.n_points.size) % 2, 1.0, -1.0)
    agreeing, sure = informations(moved(patches, error_mm * signs), patches)
    sigma_mm = np.sqrt(np.diag(np.linalg.inv(sure))[3:])
    assert np.linalg.eigvalsh(np.linalg.inv(sure) - np.linalg.inv(agreeing)).min() > 0.0
    # n planes of that error each, whatever their own noise, fix a shift to error / sqrt(n) or so.
    least_mm = 0.3 * error_mm / np.sqrt(signs.size)
    assert (sigma_mm > least_mm).all()
    once, twice = (
        np.linalg.inv(informations(moved(patches, scale * error_mm * signs), patches)[1])
        for scale in (1.0, 2.0)
    )
    assert np.trace(twice[3:, 3:]) > 2.0 * np.trace(once[3:, 3:])
