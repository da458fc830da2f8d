"""Patches, the Gauss sphere and the densest shifts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import Plates, plates_from, scan_plates
from scipy.spatial.transform import Rotation

from registration import Scan
from registration.thesis.gauss_sphere import compact_sphere
from registration.thesis.merging import merge_profiles
from registration.thesis.params import (
    MergeParams,
    PatchParams,
    SegmentParams,
    SphereParams,
)
from registration.thesis.patches import Patches, build_patches
from registration.thesis.planes import fit_planes
from registration.thesis.segments import find_segments
from registration.thesis.translation import densest_ball, densest_box
from registration.thesis.triplets import repair_triplets


def upright_plate() -> Plates:
    n = np.array([[0.0, 0.35, -1.0]]) / np.hypot(1.0, 0.35)
    return plates_from(n, np.array([[150.0, 20.0, 950.0]]), np.array([[80.0, 60.0]]))


def patches_of(scan: Scan, **params: object) -> Patches:
    segments = find_segments(scan, SegmentParams())
    chain = merge_profiles(segments, MergeParams())
    return build_patches(segments, chain, PatchParams(**params), scan)


@pytest.mark.parametrize("triplets", ["carried", "measured", "fitted"])
@pytest.mark.parametrize("plane", ["centred", "uncentred"])
def test_an_upright_plate_is_one_patch_with_its_plane_centre_and_area(
    triplets: str, plane: str
) -> None:
    plates = upright_plate()
    patches = patches_of(scan_plates(plates, 60), triplets=triplets, plane=plane)
    assert len(patches) == 1
    np.testing.assert_allclose(patches.normal[0], plates.axes[0, 2], atol=1e-9)
    offset_mm = plates.axes[0, 2] @ plates.centre_mm[0]
    np.testing.assert_allclose(patches.offset_mm, offset_mm, atol=1e-6)
    assert np.linalg.norm(patches.centroid_mm[0] - plates.centre_mm[0]) < 5.0
    assert patches.area_mm2[0] == pytest.approx(160.0 * 120.0, rel=0.1)
    heights = patches.corners_mm[0] @ patches.normal[0] - patches.offset_mm[0]
    np.testing.assert_allclose(heights, 0.0, atol=1e-9)
    assert patches.count[0] == patches.profile_last[0] - patches.profile_first[0] + 1


def test_the_area_of_a_tilted_plate_is_measured_on_the_plate() -> None:
    n = np.array([[0.8, 0.1, -1.0]]) / np.linalg.norm([0.8, 0.1, -1.0])
    plates = plates_from(n, np.array([[150.0, 0.0, 950.0]]), np.array([[90.0, 70.0]]))
    patches = patches_of(scan_plates(plates, 120, step_mm=2.5))
    assert len(patches) == 1
    assert patches.area_mm2[0] == pytest.approx(180.0 * 140.0, rel=0.06)


def test_readings_that_need_the_scan_say_so() -> None:
    segments = find_segments(scan_plates(upright_plate(), 60), SegmentParams())
    chain = merge_profiles(segments, MergeParams())
    assert len(build_patches(segments, chain, PatchParams(triplets="fitted"))) == 1
    with pytest.raises(ValueError, match='"carried", which reads depths from the scan'):
        build_patches(segments, chain, PatchParams(triplets="carried"))


def test_an_intermediate_patch_bridges_two_groups_that_run_parallel() -> None:
    """A shelf edge: two plates one above the other, the upper one nearer by 60 mm."""
    n = np.array([[0.0, 0.2, -1.0]] * 2) / np.hypot(1.0, 0.2)
    centres = np.array([[60.0, 0.0, 980.0], [160.0, 0.0, 920.0]])
    scan = scan_plates(plates_from(n, centres, np.array([[52.4, 70.0], [47.4, 70.0]])), 60)
    plain, bridged = (patches_of(scan, intermediate=i, repair=False) for i in (False, True))
    assert (len(plain), len(bridged)) == (2, 3)
    assert bridged.intermediate.tolist() == [False, False, True]
    assert bridged.count[2] == 2
    assert bridged.profile_first[2] == bridged.profile_last[0]
    assert bridged.profile_last[2] == bridged.profile_first[1]


def triplet_rows(z_mm: list[float]) -> np.ndarray:
    x, y = np.meshgrid(np.arange(len(z_mm)) * 5.0, [-20.0, 0.0, 20.0], indexing="ij")
    return np.stack([x, y, np.repeat(np.array(z_mm)[:, None], 3, axis=1)], axis=2)


def test_a_profile_that_jumps_is_interpolated_from_the_others() -> None:
    points = triplet_rows([900.0, 901.0, 940.0, 903.0, 904.0])
    repaired = repair_triplets(points, 10.0)
    np.testing.assert_allclose(repaired, triplet_rows([900.0, 901.0, 902.0, 903.0, 904.0]))


def test_of_two_profiles_the_second_takes_the_depths_of_the_first() -> None:
    repaired = repair_triplets(triplet_rows([900.0, 940.0]), 10.0)
    np.testing.assert_allclose(repaired, triplet_rows([900.0, 900.0]))


def test_one_deviating_point_of_three_is_left_alone() -> None:
    points = triplet_rows([900.0, 900.0, 900.0])
    points[1, 0, 2] = 940.0
    np.testing.assert_array_equal(repair_triplets(points, 10.0), points)


def test_both_plane_fits_are_exact_without_noise_and_only_one_is_unbiased() -> None:
    """(5-2), (5-3), corrected."""
    rng = np.random.default_rng(1)
    q = 4000
    flat = np.column_stack([rng.uniform(-10, 10, (q, 2)), np.zeros(q)])
    off_rad: dict[str, list[float]] = {"centred": [], "uncentred": []}
    for R in Rotation.random(10, rng=rng):
        n, centre = R.apply([0.0, 0.0, 1.0]), np.array([40.0, 300.0, 1000.0])
        exact = R.apply(flat) + centre
        noisy = exact + rng.normal(scale=2.0, size=exact.shape)
        for fit, off in off_rad.items():
            fitted, mean = fit_planes(exact, np.zeros(q, dtype=np.int64), 1, fit)
            assert np.linalg.norm(np.cross(fitted[0], n)) < 1e-6
            np.testing.assert_allclose(mean[0], exact.mean(axis=0))
            fitted, _ = fit_planes(noisy, np.zeros(q, dtype=np.int64), 1, fit)
            off.append(np.linalg.norm(np.cross(fitted[0], n)))
    assert np.mean(off_rad["centred"]) < 0.5 * np.mean(off_rad["uncentred"])


def bare_patches(normal: np.ndarray, area_mm2: np.ndarray) -> Patches:
    m = len(normal)
    one = patches_of(scan_plates(upright_plate(), 60))
    return replace(
        one,
        normal=normal,
        area_mm2=area_mm2,
        centroid_mm=np.zeros((m, 3)),
        offset_mm=np.zeros(m),
    )


@pytest.mark.parametrize("close", [0.025, 0.14])
def test_compaction_keeps_the_weight_and_leaves_no_close_normals(close: float) -> None:
    rng = np.random.default_rng(2)
    n = np.column_stack([rng.normal(scale=0.4, size=(150, 2)), -np.ones(150)])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    area = rng.uniform(100, 5000, 150)

    sphere = compact_sphere(bare_patches(n, area), SphereParams(close))

    assert 1 < len(sphere) < 150
    assert sphere.weight.sum() == pytest.approx(area.sum())
    assert (np.diff(sphere.weight) <= 0.0).all()
    np.testing.assert_allclose(sphere.weight, np.bincount(sphere.member, area))
    np.testing.assert_allclose(np.linalg.norm(sphere.direction, axis=1), 1.0)
    chords = np.linalg.norm(sphere.direction[:, None] - sphere.direction, axis=2)
    assert (chords + 9.0 * np.eye(len(sphere))).min() >= close

    order = rng.permutation(150)
    shuffled = compact_sphere(bare_patches(n[order], area[order]), SphereParams(close))
    np.testing.assert_allclose(shuffled.direction, sphere.direction, atol=1e-12)
    np.testing.assert_array_equal(shuffled.member, sphere.member[order])


def test_close_normal_zero_unites_nothing() -> None:
    n = np.array([[0.0, 0.0, -1.0], [0.0, 1e-6, -1.0], [0.0, 0.0, -1.0]])
    assert len(compact_sphere(bare_patches(n, np.ones(3)), SphereParams(0.0))) == 3


@pytest.mark.parametrize("densest", [densest_box, densest_ball])
def test_the_densest_shifts_are_found_wherever_they_lie(densest) -> None:
    rng = np.random.default_rng(3)
    truth = rng.uniform(-300, 300, 3)
    cluster = truth + rng.uniform(-3, 3, (25, 3))
    values = np.concatenate([rng.uniform(-400, 400, (40, 3)), cluster])
    chosen, box_mm = densest(values, np.ones(65), 20.0)
    assert chosen[40:].all()
    assert chosen.sum() <= 26
    assert (values[chosen] >= box_mm[0] - 1e-9).all()
    assert (values[chosen] <= box_mm[1] + 1e-9).all()


def test_axis_by_axis_the_densest_region_can_be_empty_where_the_ball_is_not() -> None:
    """Section 6.6: the union of densest intervals need not be dense."""
    a, b, c = np.arange(3.0), 200.0, 400.0
    lines = [
        np.column_stack([np.zeros(3), b + 90 * a, c + 90 * a]),
        np.column_stack([b + 90 * a, np.zeros(3), -c - 90 * a]),
        np.column_stack([-b - 90 * a, -c - 90 * a, np.zeros(3)]),
        np.array([[900.0, 900.0, 900.0], [901.0, 901.0, 901.0]]),
    ]
    values = np.concatenate(lines)
    chosen, _ = densest_box(values, np.ones(len(values)), 20.0)
    assert not chosen.any()
    chosen, _ = densest_ball(values, np.ones(len(values)), 20.0)
    assert np.flatnonzero(chosen).tolist() == [9, 10]
