"""From the beams to planes: noise, apex, segments, patches and their covariance."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from plane_scans import Plates, plates_from, random_clutter, scan_plates

from registration import Scan, register
from registration.gauss_sphere import describing
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.fan.beams import fan_of, measured
from registration.gauss_sphere.fan.calibrated import NOTHING_KNOWN
from registration.gauss_sphere.fan.depth_noise import depth_noise
from registration.gauss_sphere.params import GaussSphereParams, PatchParams, SegmentParams
from registration.gauss_sphere.planes.patches import MOST_PATCHES, fit_patches, fitting
from registration.gauss_sphere.planes.plane_fit import fit_plane, let_follow
from registration.gauss_sphere.planes.points import Grouped
from registration.gauss_sphere.planes.segments import cutting, find_segments


def plates(*normals: tuple[float, float, float], half_mm: float = 60.0):
    n = np.array(normals) / np.linalg.norm(normals, axis=1, keepdims=True)
    y = np.linspace(-110.0, 110.0, len(n)) if len(n) > 1 else np.zeros(1)
    centres = np.stack([np.full(len(n), 120.0), y, np.full(len(n), 800.0)], axis=1)
    return plates_from(n, centres, np.full((len(n), 2), half_mm))


def patches_of(scan: Scan):
    return describe(scan, GaussSphereParams()).patches


def test_the_loops_are_compiled_once_for_scans_of_any_origin() -> None:
    rng = np.random.default_rng(0)
    scan = scan_plates(random_clutter(rng), noise=1.0, rng=rng)
    params = GaussSphereParams()
    describe(scan, params)
    kinds = len(describing._described.signatures)
    describe(pickle.loads(pickle.dumps(scan)), params)
    fortran = Scan.from_points(np.asfortranarray(scan.points_mm), 5.0, apex_mm=(0, 0, -60))
    describe(fortran, GaussSphereParams(segments=SegmentParams(cliff_mm=10)))
    single = scan.points_mm[::2, ::2].astype(np.float32)
    describe(Scan.from_points(single, 5, travel=(1, 0, 0.1)), params)
    assert len(describing._described.signatures) == kinds


def test_a_plane_seen_by_parallel_beams_is_one_however_small_the_noise() -> None:
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(0.5 * np.arange(400.0), np.linspace(-100.0, 100.0, 1000), indexing="ij")
    z = 500.0 + 0.2 * x + 0.3 * y + rng.normal(0.0, 0.02, x.shape)
    found = patches_of(Scan.from_points(np.stack([x, y, z], axis=2), 0.5))
    assert found.n_points.size == 1
    assert found.n_points[0] > 0.98 * x.size


@pytest.mark.parametrize("noise", [0.3, 1.0, 2.0])
def test_the_noise_is_estimated_from_the_scan_alone(noise: float) -> None:
    rng = np.random.default_rng(1)
    scan = scan_plates(random_clutter(rng), noise=noise, rng=rng)
    fan = fan_of(measured(scan))
    constant, square = depth_noise(fan.depth_mm, fan.slope)
    for depth_mm in (850.0, 1000.0, 1150.0):
        true_mm = noise * (0.3 + (depth_mm - 230.0) * (1.2 / 1005.0))
        assert constant + square * depth_mm**2 == pytest.approx(true_mm, rel=0.08)


def test_a_crease_without_noise_is_cut_at_its_pixel() -> None:
    y = np.linspace(-100.0, 100.0, 201)
    z = 700.0 + 0.4 * np.abs(y - 20.0)
    points = np.stack([np.zeros_like(y), y, z], axis=1)[None]
    segments = find_segments(
        fan_of(measured(Scan.from_points(points, step_mm=5.0, apex_mm=[0, 0, -60]))),
        cutting(SegmentParams()),
    )
    assert segments.profile.size == 2
    assert abs(segments.last[0] - 120) <= 1
    assert segments.first[1] == segments.last[0] + 1


def test_a_noisy_plane_is_rarely_split() -> None:
    rng = np.random.default_rng(2)
    scan = scan_plates(plates((0.1, 0.3, -1.0), half_mm=300.0), 200, noise=1.0, rng=rng)
    segments = find_segments(fan_of(measured(scan)), cutting(SegmentParams()))
    assert segments.profile.size <= 200 * 1.03


def test_a_noise_free_plane_is_found_exactly() -> None:
    made = plates((0.2, 0.1, -1.0), (-0.3, 0.3, -1.0), (0.1, -0.5, -1.0))
    found = patches_of(scan_plates(made))
    assert found.n_points.size == 3
    for normal, offset in zip(found.normal, found.offset_mm, strict=True):
        nearest = np.argmin(np.linalg.norm(made.axes[:, 2] - normal, axis=1))
        np.testing.assert_allclose(normal, made.axes[nearest, 2], atol=1e-9)
        assert offset == pytest.approx(made.axes[nearest, 2] @ made.centre_mm[nearest], abs=1e-6)


@pytest.mark.parametrize("normal", [(0.1, 0.2, -1.0), (0.9, 0.6, -0.5)])
def test_the_covariance_of_a_plane_is_what_its_errors_are(normal) -> None:
    # A slanted plane too: least squares of the distances would be biased there by a sigma.
    rng = np.random.default_rng(3)
    made = plates(normal)
    true_normal, true_offset = made.axes[0, 2], made.axes[0, 2] @ made.centre_mm[0]
    errors, distances = [], []
    for _ in range(120):
        found = patches_of(scan_plates(made, 50, noise=1.0, rng=rng))
        if true_normal @ found.normal[0] < 0.0:
            true_normal, true_offset = -true_normal, -true_offset
        error = np.append(
            found.basis[0] @ true_normal, true_offset - true_normal @ found.centroid_mm[0]
        )
        errors.append(error / np.sqrt(np.diag(found.covariance[0])))
        distances.append(error @ np.linalg.solve(found.covariance[0], error))
    # Mean of 120 chi-square values of 3 degrees of freedom: 3 +- 0.22 (one sigma).
    assert 2.2 < np.mean(distances) < 4.0
    assert np.abs(np.mean(errors, axis=0)).max() < 0.4


def shaken(scan: Scan, made: Plates, mm: dict[int, float], rng: np.random.Generator) -> Scan:
    """The scan of plates with noise along the beams, of a standard deviation for each plate."""
    points_mm = scan.points_mm.copy()
    off_mm = np.abs(((points_mm[:, :, None] - made.centre_mm) * made.axes[:, 2]).sum(axis=3))
    beam = points_mm - scan.origins_mm[:, None] - scan.apex_mm
    beam /= beam[..., 2:]
    for plate, sigma_mm in mm.items():
        on = np.nanmin(off_mm, axis=2, initial=np.inf) == off_mm[:, :, plate]
        points_mm[on] += rng.normal(0.0, sigma_mm, (on.sum(), 1)) * beam[on]
    return Scan.from_points(points_mm, scan.step_mm, apex_mm=scan.apex_mm)


@pytest.mark.parametrize("noisy_mm", [0.45, 0.3, 0.2])
def test_without_a_calibration_a_plane_is_as_certain_as_its_own_points(noisy_mm: float) -> None:
    rng = np.random.default_rng(6)
    made = plates((0.2, 0.1, -1.0), (0.1, 0.3, -1.0), (0.1, -0.5, -1.0))
    exact, distances = scan_plates(made, 50), [list[float](), list[float](), list[float]()]
    for _ in range(100):
        found = patches_of(shaken(exact, made, {0: 0.3, 1: 0.3, 2: noisy_mm}, rng))
        for i in range(found.n_points.size):
            plate = np.argmax(np.abs(made.axes[:, 2] @ found.normal[i]))
            normal = made.axes[plate, 2] * np.sign(made.axes[plate, 2] @ found.normal[i])
            offset = normal @ (made.centre_mm[plate] - found.centroid_mm[i])
            error = np.append(found.basis[i] @ normal, offset)
            distances[plate].append(error @ np.linalg.solve(found.covariance[i], error))
    # Means of 100 chi-square values of 3 degrees of freedom: the ratio is 1 +- 0.1 (one sigma), and
    # without the plane's own noise 0.44 to 2.25. All together are as neighbours' noise is.
    usual = np.mean([*distances[0], *distances[1]])
    assert 0.7 < np.mean(distances[2]) / usual < 1.4
    assert 1.8 < usual < 4.2


def test_points_of_one_profile_make_no_plane() -> None:
    scan = scan_plates(plates((0.1, 0.2, -1.0)))
    fan = fan_of(measured(scan))
    place = 20 * fan.depth_mm.shape[1] + np.flatnonzero(np.isfinite(fan.depth_mm[20]))
    assert place.size > PatchParams().min_points
    points = Grouped(
        np.zeros(1, np.int64),
        np.array([place.size]),
        np.full(place.size, 20, np.int32),
        place.astype(np.int32),
    )
    fitted = fit_patches(fan, fan.depth_mm, points, NOTHING_KNOWN, fitting(PatchParams()))
    assert fitted.n_points.size == 0
    assert (fitted.label == -1).all()


def test_next_to_no_noise_on_one_plane_leaves_the_others_as_certain_as_they_were() -> None:
    made = plates((0.2, 0.1, -1.0), (0.1, 0.3, -1.0), (0.1, -0.5, -1.0))
    exact = scan_plates(made, 50)
    before = patches_of(exact)
    for tiny_mm in (1e-4, 1e-2):
        after = patches_of(shaken(exact, made, {2: tiny_mm}, np.random.default_rng(7)))
        np.testing.assert_allclose(after.covariance, before.covariance, rtol=0.2)


def receding(
    tilts: tuple[float, ...], rng: np.random.Generator, step_mm: float = 5.0, pixels: int = 256
) -> Scan:
    """A surface of strips of these tilts along X, 500 mm away and more, with noise."""
    x, slope = np.arange(0.0, 400.0, step_mm), np.linspace(-0.3, 0.3, pixels)
    tilt = np.repeat(tilts, -(-x.size // len(tilts)))[: x.size]
    depth = 500.0 + np.concatenate([[0.0], np.cumsum(step_mm * tilt[1:])])[:, None] + 0.0 * slope
    depth += 0.5 * (depth / 500.0) ** 2 * rng.standard_normal(depth.shape)
    points_mm = np.stack([np.broadcast_to(x[:, None], depth.shape), slope * depth, depth], axis=2)
    return Scan.from_points(points_mm, step_mm, apex_mm=np.zeros(3))


@pytest.mark.parametrize(("step_mm", "pixels"), [(5.0, 256), (5.0, 1024), (20.0, 256), (30.0, 128)])
@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.5, 3.0])
@pytest.mark.parametrize("way", [1, -1])
def test_a_plane_that_recedes_along_the_motion_is_one(
    step_mm: float, pixels: int, tilt: float, way: int
) -> None:
    scan = receding((tilt,), np.random.default_rng(1), step_mm, pixels)
    found = patches_of(replace(scan, points_mm=scan.points_mm[::way]))
    assert found.n_points.size == 1
    assert found.n_points[0] > 0.98 * scan.n_valid


@pytest.mark.parametrize("way", [1, -1])
def test_a_crease_across_the_motion_is_found_from_either_side(way: int) -> None:
    scan = receding((1.5, 1.55), np.random.default_rng(1))
    found = patches_of(replace(scan, points_mm=scan.points_mm[::way]))
    assert found.n_points.size == 2
    assert found.n_points[0] < 0.6 * scan.n_valid


def test_of_thousands_of_patches_the_largest_are_kept() -> None:
    rng = np.random.default_rng(4)
    depth = 600.0 + np.kron(rng.uniform(0.0, 60.0, (33, 33)), np.ones((3, 16)))
    slope, x = np.linspace(-0.4, 0.4, depth.shape[1]), 3.0 * np.arange(depth.shape[0])
    depth += rng.normal(0.0, 0.05, depth.shape)
    points_mm = np.stack([np.broadcast_to(x[:, None], depth.shape), slope * depth, depth], axis=2)
    scan = Scan.from_points(points_mm, 3.0, apex_mm=np.zeros(3))
    params = replace(GaussSphereParams(), patches=PatchParams(min_points=30, min_profiles=3))
    found = describe(scan, params).patches
    assert found.n_points.size == MOST_PATCHES
    assert (np.diff(found.area_mm2) <= 0.0).all()
    assert found.label.max() == MOST_PATCHES - 1
    assert register(scan, scan, params=params).status != "failed"


def test_far_planes_of_like_orientation_stay_apart() -> None:
    n = np.array([[0.1, 0.1, -1.0]] * 2) / np.linalg.norm([0.1, 0.1, -1.0])
    made = plates_from(
        n, np.array([[120.0, -60.0, 700.0], [120.0, 60.0, 800.0]]), np.full((2, 2), 50.0)
    )
    assert patches_of(scan_plates(made)).n_points.size == 2


def beside_a_step(seed: int, share: float) -> np.ndarray:
    """(5, n) beams of a plane, some of those at one side four deviations behind it."""
    rng = np.random.default_rng(seed)
    n, sigma = 4000, 0.3
    x, slope = rng.uniform(-150.0, 150.0, n), rng.uniform(-0.2, 0.2, n)
    depth = 900.0 + rng.normal(0.0, sigma, n)
    depth[(x > 60.0) & (rng.random(n) < share)] += 4.0 * sigma
    return np.stack([x, slope, depth, np.full(n, sigma), depth])


def fitted_to(beams: np.ndarray, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit normal (3,), and the information (3, 3) of its tilts."""
    plane, kept = np.empty(4), np.empty(beams.shape[1], np.bool_)
    centre, e, f, g, moments = *np.empty((3, 3)), np.empty((3, 4)), np.empty(7)
    sample = np.ascontiguousarray(beams[:, :128])
    assert fit_plane(
        beams, sample, np.zeros(2), 0.0, NOTHING_KNOWN, 3.5, rounds, kept, plane, centre, e, f, g,
        moments,
    )  # fmt: skip
    information = np.triu(g[:, :3]) + np.triu(g[:, :3], 1).T
    tilts = np.stack([e, f])
    return plane[:3], tilts.T @ np.linalg.inv(np.linalg.inv(information)[:2, :2]) @ tilts


@pytest.mark.parametrize("share", [0.2, 0.5])
@pytest.mark.parametrize("seed", range(5))
def test_points_of_another_plane_in_the_sample_do_not_tilt_the_fit(seed: int, share: float) -> None:
    """Fitted once, it lies within two deviations of where more and more steps take it."""
    beams = beside_a_step(seed, share)
    (normal, sure), (settled, _) = (fitted_to(beams, rounds) for rounds in (1, 20))
    away = normal - settled
    assert away @ sure @ away < 4.0


def test_a_step_is_lengthened_to_where_the_bias_has_followed_it() -> None:
    following = np.array([[0.5, 0.0], [0.0, 0.2], [0.3, 0.0]])
    step = np.array([1.0, 2.0, 4.0])
    let_follow(following, step)
    np.testing.assert_allclose(step, [2.0, 2.5, 4.6])


@pytest.mark.parametrize("of_a_tilt", [np.diag([2.0, 2.0]), np.diag([0.9, 0.9])])
def test_a_step_stays_where_the_bias_follows_too_far(of_a_tilt: np.ndarray) -> None:
    """A bias that follows farther than the plane tilts would turn the step around."""
    step = np.array([1.0, 2.0, 4.0])
    let_follow(np.vstack([of_a_tilt, [0.3, 0.0]]), step)
    np.testing.assert_array_equal(step, [1.0, 2.0, 4.0])
