"""How sure an answer is follows from all planes it matches, not from those that agree alone."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import box_faces, join, random_clutter, scan_plates
from scipy.spatial.transform import RigidTransform, Rotation

from registration.gauss_sphere.candidates.rotation import gauss_sphere
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.bending import of_unknown_bias
from registration.gauss_sphere.params import GaussSphereParams, RefineParams
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.matching import Settled
from registration.gauss_sphere.refinement.refine import EXACTLY, likelihood, maximise, widened
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


def turned(patches: Patches, by_rad: FloatArray) -> Patches:
    """Each plane turned a little about its centroid, its normal by what is across of (m, 3)."""
    tilt = np.einsum("mvi,mi->mv", patches.basis, by_rad)
    normal = patches.normal + np.einsum("mvi,mv->mi", patches.basis, tilt)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return patches._replace(
        normal=normal,
        basis=patches.basis - tilt[:, :, None] * patches.normal[:, None, :],
        offset_mm=np.einsum("mi,mi->m", normal, patches.centroid_mm),
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


@pytest.fixture(scope="module")
def alike_boxes() -> Patches:
    """Twelve boxes in three rows, the boxes of a row turned alike."""
    faces = []
    for row, turn_deg in enumerate(([25, 10, 0], [-20, -15, 40], [10, 30, 80])):
        rotation = Rotation.from_euler("xyz", turn_deg, degrees=True)
        for place in range(4):
            centre_mm = np.array([110.0 * place, 150.0 * (row - 1), 700.0 + 40.0 * place])
            pose = RigidTransform.from_components(centre_mm, rotation)
            faces.append(box_faces(pose, np.array([45.0, 45.0, 45.0])))
    scan = scan_plates(join(*faces), noise=0.1, rng=np.random.default_rng(5))
    return describe(scan, GaussSphereParams()).patches


def squared_errors(target: Patches, source: Patches, floor_mm: float) -> tuple[float, float]:
    """Of the pose that planes make likely, where they lie on each other by the identity.

    In units of its covariance by all disagreement, and by that which directions share.
    floor_mm: with which the pose is found.
    """
    n, params = target.n_points.size, GaussSphereParams()
    pairs, likely = np.stack([np.arange(n)] * 2, axis=1), likelihood(params.refine)
    r, t = np.eye(3), np.zeros(3)
    agreeing, sure, distance2 = np.empty((6, 6)), np.empty((6, 6)), np.empty(n)
    maximise(target, source, pairs, likely, floor_mm, r, t, agreeing, distance2, EXACTLY)
    widened(target, source, pairs, likely, 0.005, r, t, sure, 0.0)
    pose = Settled(r, t, agreeing, sure, 0.005, pairs, distance2, np.ones(2), 1.0)
    error = np.append(Rotation.from_matrix(r).as_rotvec(), t)
    shared = of_unknown_bias(pose, target, source, params)
    return float(error @ sure @ error), float(error @ shared.sure @ error)


def test_directions_that_share_an_error_know_no_more_than_one_plane_each(
    alike_boxes: Patches,
) -> None:
    """What a bias does that goes with the incidence, and no calibration takes out."""
    rng, params, n = np.random.default_rng(6), GaussSphereParams(), alike_boxes.n_points.size
    direction = gauss_sphere(alike_boxes, params.bending.close_rad).member
    assert n > 2 * direction.max()
    distances2 = []
    for _ in range(1000):
        off_mm, off_rad = rng.normal(size=n), rng.normal(size=(n, 3)) / params.refine.floor_lever_mm
        target = turned(moved(alike_boxes, off_mm[direction]), off_rad[direction])
        distances2.append(squared_errors(target, alike_boxes, floor_mm=1.0))
    # Inside what should hold 50 and 99 %: as their size is estimated on 21 freedoms, by F(6, 21)
    # 48 and 96 % are.
    half, nearly_all = ((np.array(distances2) < limit).mean(axis=0) for limit in (5.35, 16.8))
    assert half[0] < 0.1
    assert 0.4 < half[1] < 0.55
    assert nearly_all[0] < 0.5
    assert nearly_all[1] > 0.93


def test_noise_alone_makes_directions_share_next_to_nothing(alike_boxes: Patches) -> None:
    rng, n = np.random.default_rng(7), alike_boxes.n_points.size
    # Far beyond the least systematic error that planes are allowed.
    noisy = alike_boxes._replace(covariance=400.0 * alike_boxes.covariance)
    root = np.linalg.cholesky(2.0 * noisy.covariance)  # of both views
    distances2 = []
    for _ in range(1000):
        off = np.einsum("mij,mj->mi", root, rng.normal(size=(n, 3)))
        off_rad = np.einsum("mvi,mv->mi", noisy.basis, off[:, :2])
        target = turned(moved(noisy, off[:, 2]), off_rad)
        distances2.append(squared_errors(target, noisy, floor_mm=0.005))
    apart, together = np.mean(distances2, axis=0)
    assert 4.0 < apart < 6.0  # chance widens some: planes differ by more than expected
    assert together > 0.85 * apart
