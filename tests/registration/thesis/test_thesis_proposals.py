"""Laws of what chapter 7 and section 6.6 propose; all of it is off by default."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_patches import assert_same_pose, move_patches, random_plates, random_pose, true_patches
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_scans import move_plates, plates_from, pose_error, scan_plates
from scipy.spatial.transform import RigidTransform, Rotation

from registration import Scan, register
from registration.thesis.icp import point_to_plane, surface
from registration.thesis.merging import merge_profiles
from registration.thesis.params import (
    IcpParams,
    RotationParams,
    ThesisParams,
    TranslationParams,
)
from registration.thesis.patches import Patches, build_patches
from registration.thesis.pipeline import register_patches
from registration.thesis.segments import find_segments
from registration.thesis.translation import densest_ball, densest_nested, shift_between_planes
from registration.thesis.view_params import MergeParams, PatchParams, SegmentParams

IRREGULAR = PatchParams(shape="irregular")
PROPOSALS = {
    "longest first": ThesisParams(segments=SegmentParams(order="longest_first")),
    "irregular": ThesisParams(patches=IRREGULAR),
    "transitions": ThesisParams(patches=replace(IRREGULAR, transitions=True)),
    "areas": ThesisParams(rotation=RotationParams(min_area_ratio=0.3)),
    "distances": ThesisParams(rotation=RotationParams(distance_tolerance_mm=40.0)),
    "hierarchical": ThesisParams(translation=TranslationParams(density="hierarchical")),
    "plane distances": ThesisParams(translation=TranslationParams(estimate="plane_distances")),
    "icp": ThesisParams(icp=IcpParams(rounds=30)),
}
# Those that act on patches, and for which axes do not matter; "per_axis" depends on the axes.
ON_PATCHES = ("areas", "distances", "hierarchical", "plane distances")


def zigzag(profiles: int = 1) -> Scan:
    """Three straight lines that meet at corners, of 100, 180 and 60 mm along Y."""
    y = np.linspace(-170.0, 170.0, 341)
    z = 800.0 + np.interp(y, [-170.0, -70.0, 110.0, 170.0], [0.0, 100.0, 0.0, 60.0])
    x = 5.0 * np.arange(profiles)
    points = np.stack(
        [np.repeat(x[:, None], len(y), 1), *(np.tile(v, (profiles, 1)) for v in (y, z))], axis=2
    )
    return Scan.from_points(points, 5.0)


@pytest.mark.parametrize("proposal", PROPOSALS)
def test_plates_seen_whole_register_without_noise(proposal: str) -> None:
    tilts = np.radians([[12, -9], [-20, 15], [9, 22], [-12, -20], [24, 8], [-8, -14]])
    normals = Rotation.from_euler("XY", tilts).apply([0.0, 0.0, -1.0])
    centres = np.array([[x, y, 950.0] for x in (110.0, 290.0) for y in (-125.0, 0.0, 125.0)])
    plates = plates_from(normals, centres + [[0, 0, 15 * k] for k in range(6)], np.full((6, 2), 36))
    turn = Rotation.from_euler("ZYX", np.radians([2.0, -3.0, 14.0]))
    pivot = np.array([200.0, 0.0, 950.0])
    T_source_target = RigidTransform.from_components(pivot - turn.apply(pivot), turn)

    result = register(
        scan_plates(plates, profiles=84),
        scan_plates(move_plates(plates, T_source_target), profiles=84),
        "thesis",
        PROPOSALS[proposal],
    )

    assert result.status == "ok"
    angle_deg, distance_mm = pose_error(result.T_target_source, T_source_target.inv())
    assert angle_deg < 0.02
    assert distance_mm < 5.0
    if proposal == "icp":
        assert distance_mm < 0.02


@pytest.mark.parametrize("proposal", ON_PATCHES)
@pytest.mark.parametrize("seed", range(3))
def test_true_patches_give_the_true_pose(proposal: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    patches, T_target_source = true_patches(random_plates(rng)), random_pose(rng)

    result = register_patches(
        patches, move_patches(patches, T_target_source.inv()), PROPOSALS[proposal]
    )

    assert result.status == "ok"
    assert_same_pose(result.T_target_source, T_target_source)


@pytest.mark.parametrize("proposal", ON_PATCHES)
def test_moving_both_views_moves_the_estimate(proposal: str, noisy_pair) -> None:
    params = PROPOSALS[proposal]
    if params.translation.density == "per_axis":
        params = replace(params, translation=replace(params.translation, density="3d"))
    views = register(noisy_pair.target, noisy_pair.source, "thesis", params).evidence
    target, source = views["target"].patches, views["source"].patches
    rng = np.random.default_rng(8)
    T_new_target, T_new_source = random_pose(rng), random_pose(rng)

    before = register_patches(target, source, params)
    after = register_patches(
        move_patches(target, T_new_target), move_patches(source, T_new_source), params
    )

    assert before.status == after.status == "ok"
    assert_same_pose(
        after.T_target_source * T_new_source, T_new_target * before.T_target_source, 1e-8
    )


def test_constraints_of_no_force_change_no_bit(noisy_pair) -> None:
    plain = register(noisy_pair.target, noisy_pair.source, "thesis")
    slack = RotationParams(min_area_ratio=1e-9, distance_tolerance_mm=1e6)
    loose = register(noisy_pair.target, noisy_pair.source, "thesis", ThesisParams(rotation=slack))
    np.testing.assert_array_equal(
        plain.T_target_source.as_matrix(), loose.T_target_source.as_matrix()
    )


@pytest.mark.parametrize(
    "rotation", [RotationParams(min_area_ratio=1.0), RotationParams(distance_tolerance_mm=1e-9)]
)
def test_constraints_that_nothing_meets_are_named(rotation: RotationParams, noisy_pair) -> None:
    result = register(
        noisy_pair.target, noisy_pair.source, "thesis", ThesisParams(rotation=rotation)
    )
    assert result.status == "failed"
    assert "areas alike" in result.reason or "centroids as far apart" in result.reason


def test_the_longest_line_is_whole_and_the_one_before_it_gives_way() -> None:
    """From end to end it is the first line that runs past its corner by WARP."""
    scan = zigzag()
    in_order, longest = (
        find_segments(scan, SegmentParams(order=order)) for order in ("index", "longest_first")
    )

    assert len(in_order) == len(longest) == 3
    corners = 100, 280  # pixels
    assert longest.first[1] <= corners[0] < in_order.first[1]
    assert longest.last[1] >= corners[1]
    assert longest.length_mm[1] > in_order.length_mm[1]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), noise_mm=st.floats(0.0, 5.0), seed_line=st.booleans())
def test_longest_first_segments_are_disjoint_and_the_longest_is_no_shorter(
    seed: int, noise_mm: float, seed_line: bool
) -> None:
    rng = np.random.default_rng(seed)
    points = zigzag().points_mm.copy()
    points[..., 2] += rng.normal(scale=noise_mm, size=points.shape[:2])
    points[rng.random(points.shape[:2]) < 0.1] = np.nan
    scan = Scan.from_points(points, 5.0)
    params = SegmentParams(seed="first_points" if seed_line else "running")

    in_order, longest = (
        find_segments(scan, replace(params, order=order)) for order in ("index", "longest_first")
    )

    assert (longest.first[1:] > longest.last[:-1]).all()
    assert (longest.last - longest.first + 1 >= params.min_points).all()
    if len(in_order):
        ends = [scan.points_mm[0][[s.first, s.last]] for s in (in_order, longest)]
        chords = [np.hypot(*(e[1] - e[0])[:, 1:].T).max() for e in ends]
        assert chords[1] >= chords[0] - 1e-9


def test_an_irregular_patch_has_the_area_and_middle_of_its_face() -> None:
    """A triangle: a mean of three points a segment is too near its tip."""
    profiles, step = 40, 5.0
    y = np.linspace(-150.0, 150.0, 601)
    x = step * np.arange(profiles)
    half = 140.0 * (1.0 - x / x[-1])[:, None]
    z = np.where(np.abs(y) <= half, 900.0 + 0.3 * y, np.nan)
    points = np.stack([*np.broadcast_arrays(x[:, None], y), z], axis=2)
    scan = Scan.from_points(points, step)
    segments = find_segments(scan, SegmentParams())
    chain = np.zeros(len(segments), dtype=np.int64)

    plain, irregular, without_scan = (
        build_patches(segments, chain, params, given)
        for params, given in ((PatchParams(), scan), (IRREGULAR, scan), (IRREGULAR, None))
    )

    third = x[-1] / 3.0
    for patches in (irregular, without_scan):
        np.testing.assert_allclose(patches.centroid_mm[0, :2], [third, 0.0], atol=2.0)
        assert patches.normal[0] @ patches.centroid_mm[0] == pytest.approx(patches.offset_mm[0])
        # A strip reaches half a step to either side of its segment.
        area = 140.0 * (x[-1] + step) * np.hypot(1.0, 0.3)
        assert patches.area_mm2[0] == pytest.approx(area, rel=0.005)
    assert plain.centroid_mm[0, 0] > third + 20.0
    assert len(irregular.points_mm) == segments.count.sum()


def groups_of_one_face(slope: float) -> tuple[Scan, Patches, Patches]:
    """One inclined face whose width jumps twice, which parts its profiles into three groups."""
    profiles, y = 36, np.linspace(-200.0, 200.0, 401)
    x = 5.0 * np.arange(profiles)
    half = np.where(np.arange(profiles) < 12, 60.0, np.where(np.arange(profiles) < 24, 180.0, 90.0))
    bend = np.maximum(np.arange(profiles) - 23, 0.0)[:, None]
    z = 900.0 + 0.2 * y + 0.1 * x[:, None] + slope * 5.0 * bend
    z = np.where(np.abs(y) <= half[:, None], z, np.nan)
    scan = Scan.from_points(np.stack([*np.broadcast_arrays(x[:, None], y), z], axis=2), 5.0)
    segments = find_segments(scan, SegmentParams())
    chain = merge_profiles(segments, MergeParams())
    apart, joined = (
        build_patches(segments, chain, replace(IRREGULAR, transitions=transitions), scan)
        for transitions in (False, True)
    )
    return scan, apart, joined


def test_groups_of_profiles_on_one_face_become_one_patch() -> None:
    scan, apart, joined = groups_of_one_face(slope=0.0)
    assert len(apart) == 3
    assert len(joined) == 1
    assert joined.count[0] == apart.count.sum() == 36
    assert joined.area_mm2.sum() == pytest.approx(apart.area_mm2.sum(), rel=1e-9)
    assert len(joined.points_mm) == scan.n_valid


def test_groups_of_profiles_on_two_faces_stay_apart() -> None:
    """The last group bends away by 0.5: its ends leave the plane of the others."""
    _, apart, joined = groups_of_one_face(slope=0.5)
    assert len(apart) == 3
    assert len(joined) == 2
    assert joined.area_mm2.sum() == pytest.approx(apart.area_mm2.sum(), rel=1e-9)


def test_nested_balls_find_the_cluster_that_one_small_ball_misses() -> None:
    rng = np.random.default_rng(3)
    spread = rng.uniform([75.0, -25.0, -25.0], [125.0, 25.0, 25.0], (30, 3))
    lone = rng.normal([-300.0, 0.0, 0.0], 0.5, (5, 3))
    values, weights = np.vstack([spread, lone]), np.ones(35)

    small, _ = densest_ball(values, weights, 8.0)
    nested, box = densest_nested(values, weights, 8.0, levels=3)

    assert small[30:].all()
    assert nested.any()
    assert not nested[30:].any()
    assert ((values[nested] >= box[0]) & (values[nested] <= box[1])).all()


def test_plane_distances_do_not_care_where_on_their_planes_the_patches_lie() -> None:
    rng = np.random.default_rng(4)
    normal = rng.normal(size=(7, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    true_mm = rng.uniform(-300, 300, 3)
    slid = np.cross(normal, rng.normal(scale=40.0, size=(7, 3)))
    weights = rng.uniform(0.1, 1.0, 7)

    start_mm = true_mm + np.array([5.0, -9.0, 3.0])
    found = shift_between_planes(normal, true_mm + slid, weights, start_mm)
    np.testing.assert_allclose(found, true_mm, atol=1e-9)

    # Nothing tells the shift along X, so the given one stays.
    upright = np.column_stack([np.zeros(7), normal[:, 1:]])
    upright /= np.linalg.norm(upright, axis=1, keepdims=True)
    found = shift_between_planes(upright, np.tile(true_mm, (7, 1)), weights, start_mm)
    np.testing.assert_allclose(found, [start_mm[0], *true_mm[1:]], atol=1e-9)


def test_icp_walks_back_to_the_true_pose_and_stays_where_it_has_nothing_to_go_by(
    exact_pair,
) -> None:
    views = surface(exact_pair.target), surface(exact_pair.source)
    off = RigidTransform.from_components(
        [4.0, -5.0, 3.0], Rotation.from_rotvec(np.radians([0.4, -0.6, 0.5]))
    )
    start = off * exact_pair.T_target_source

    there = point_to_plane(*views, start, IcpParams(rounds=60))
    far = RigidTransform.from_translation([1e4, 0.0, 0.0]) * start
    stays = point_to_plane(*views, far, IcpParams(rounds=60))

    before, after = (pose_error(pose, exact_pair.T_target_source) for pose in (start, there))
    assert after[0] < 0.1 * before[0]
    assert after[1] < 0.1 * before[1]
    np.testing.assert_array_equal(stays.as_matrix(), far.as_matrix())


def test_transitions_need_irregular_patches() -> None:
    with pytest.raises(ValueError, match="transitions needs shape"):
        PatchParams(transitions=True)
    with pytest.raises(ValueError, match="transitions needs shape"):
        PatchParams(shape="irregular", transitions=True, intermediate=True)
