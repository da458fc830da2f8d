"""Preprocessing, segmentation and merging, on profiles with known lines."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import plates_from, scan_plates

from registration import Scan
from registration.thesis.merging import merge_profiles
from registration.thesis.params import MergeParams, PreprocessParams, SegmentParams
from registration.thesis.preprocess import preprocess
from registration.thesis.segments import Segments, find_segments

LITERAL = SegmentParams(seed="first_points", seed_points=3, min_points=3)


def profile(y: np.ndarray, z: np.ndarray, profiles: int = 1) -> Scan:
    points = np.stack([np.zeros_like(y), y, z], axis=1)[None].repeat(profiles, axis=0)
    points[..., 0] += 5.0 * np.arange(profiles)[:, None]
    return Scan.from_points(points, step_mm=5.0)


def step_profile() -> tuple[np.ndarray, np.ndarray]:
    """A slope, and 40 mm behind it another."""
    y = np.arange(-60.0, 60.0, 2.0)
    return y, np.where(y < 0.0, 800.0 + 0.5 * y, 840.0 - 0.3 * y)


def test_filtering_leaves_straight_lines_as_they_are() -> None:
    scan = profile(*step_profile())
    np.testing.assert_array_equal(preprocess(scan, PreprocessParams()).points_mm, scan.points_mm)


def test_the_literal_median_reaches_across_a_gap() -> None:
    y, z = step_profile()
    scan = profile(y, z)
    smooth = preprocess(scan, PreprocessParams(median_across_gaps=True)).points_mm[0, :, 2]
    windows = [np.median(z[max(i - 2, 0) : i + 3]) for i in range(len(z))]
    np.testing.assert_array_equal(smooth, windows)
    assert not np.array_equal(smooth, z)


def test_isolated_points_go_and_what_they_split_is_smoothed_as_one() -> None:
    y, z = step_profile()
    z[10] += 100.0
    z[[20, 21]] -= 50.0
    filtered = preprocess(profile(y, z), PreprocessParams())
    assert np.flatnonzero(~filtered.valid[0]).tolist() == [10, 20, 21]
    kept = filtered.valid[0]
    np.testing.assert_array_equal(filtered.points_mm[0, kept, 2], z[kept])


def test_the_median_halves_the_noise() -> None:
    rng = np.random.default_rng(0)
    y = np.linspace(-100.0, 100.0, 256)
    z = 900.0 + rng.normal(scale=1.0, size=(20, 256))
    points = np.stack(np.broadcast_arrays(np.arange(20)[:, None] * 5.0, y, z), axis=2)
    scan = preprocess(Scan.from_points(points, 5.0), PreprocessParams())
    assert np.std(scan.points_mm[..., 2]) < 0.6


@pytest.mark.parametrize("params", [SegmentParams(), LITERAL, SegmentParams(fit="regression")])
def test_exact_lines_are_found_exactly(params: SegmentParams) -> None:
    segments = find_segments(profile(*step_profile()), params)
    assert len(segments) == 2
    assert segments.first.tolist() == [0, 30]
    assert segments.last.tolist() == [29, 59]
    assert segments.count.tolist() == [30, 30]
    slopes = segments.direction[:, 2] / segments.direction[:, 1]
    np.testing.assert_allclose(slopes, [0.5, -0.3], atol=1e-12)
    np.testing.assert_allclose(segments.length_mm, 58.0 * np.hypot(1.0, slopes), atol=1e-9)
    np.testing.assert_allclose(np.einsum("nj,nj->n", segments.direction, segments.normal), 0.0)
    assert (segments.normal[:, 2] < 0.0).all()
    np.testing.assert_allclose(segments.endpoints_mm.mean(axis=1), segments.centroid_mm, atol=1e-9)


def test_a_steep_line_needs_total_least_squares() -> None:
    """Appendix D, corrected."""
    rng = np.random.default_rng(1)
    angle, n = np.radians(85.0), 60
    along = np.linspace(0.0, 80.0, n)
    on_line = np.stack([0.0 * along, np.cos(angle) * along, 800.0 + np.sin(angle) * along], axis=1)
    points = on_line + rng.normal(scale=1.0, size=(100, n, 3)) * [0.0, 1.0, 1.0]
    scan = Scan.from_points(points, 5.0)
    mean_deg = {}
    for fit in ("total", "regression"):
        segments = find_segments(scan, SegmentParams(warp_mm=10.0, fit=fit))
        d = segments.direction[segments.count == n]
        assert len(d) > 90
        mean_deg[fit] = np.degrees(np.arctan2(np.abs(d[:, 2]), np.abs(d[:, 1]))).mean()
    assert mean_deg["total"] == pytest.approx(85.0, abs=0.1)
    assert mean_deg["regression"] < 84.8


def test_pixels_in_the_other_order_change_no_normal() -> None:
    y, z = step_profile()
    there, back = (
        find_segments(profile(*v), SegmentParams()) for v in ((y, z), (y[::-1], z[::-1]))
    )
    np.testing.assert_allclose(there.normal, back.normal[::-1], atol=1e-12)
    np.testing.assert_allclose(there.direction, -back.direction[::-1], atol=1e-12)


def test_a_face_beyond_the_perpendicular_still_has_its_normal_towards_the_sensor() -> None:
    """Seen from the apex at Y = 0: a face so steep that its normal points away in Z."""
    tangent = np.linspace(0.15, 0.2, 40)
    n, anchor = np.array([-0.995, 0.0998]), np.array([150.0, 800.0])
    depth = (n @ anchor) / (n[0] * tangent + n[1])
    points = np.stack([np.zeros(40), tangent * depth, depth], axis=1)[None]
    for apex_mm in (None, [0.0, 0.0, 0.0]):
        scan = Scan.from_points(points, 5.0, apex_mm=apex_mm)
        segments = find_segments(scan, SegmentParams(cliff_mm=1e3))
        np.testing.assert_allclose(segments.normal[0, 1:], n / np.linalg.norm(n), atol=1e-9)


def test_a_gap_in_a_line_ends_the_segment_only_beyond_cliff() -> None:
    y = np.arange(0.0, 100.0, 2.0)
    scan = profile(np.delete(y, range(20, 23)), np.full(47, 800.0))
    assert len(find_segments(scan, SegmentParams())) == 1
    scan = profile(np.delete(y, range(20, 25)), np.full(45, 800.0))
    assert len(find_segments(scan, SegmentParams())) == 2


def test_under_noise_only_the_running_line_survives() -> None:
    """What made the running line the default."""
    rng = np.random.default_rng(2)
    wall = plates_from(
        np.array([[0.0, 0.0, -1.0]]), np.array([[100.0, 0.0, 1000.0]]), np.array([[300.0, 200.0]])
    )
    scan = preprocess(scan_plates(wall, 30, noise=1.0, rng=rng), PreprocessParams())
    longest = {
        name: np.median(find_segments(scan, params).length_mm)
        for name, params in (("running", SegmentParams()), ("literal", LITERAL))
    }
    assert longest["running"] > 350.0
    assert longest["literal"] < 50.0


def roof(profiles: int = 10) -> Segments:
    """Two faces that meet at a ridge, from a row of like profiles."""
    y = np.arange(-60.0, 60.0, 2.0)
    return find_segments(profile(y, 800.0 + 0.4 * np.abs(y), profiles), SegmentParams())


@pytest.mark.parametrize("rule", ["literal", "global", "segments"])
def test_like_profiles_make_one_chain_a_face(rule: str) -> None:
    segments = roof()
    chain = merge_profiles(segments, MergeParams(rule=rule))
    assert sorted(np.bincount(chain)) == [10, 10]
    for c in np.unique(chain):
        assert np.ptp(segments.normal[chain == c], axis=0).max() < 1e-9


def altered(segments: Segments, k: int, face: int, length_factor: float) -> Segments:
    length = segments.length_mm.copy()
    length[np.flatnonzero(segments.profile == k)[face]] *= length_factor
    return Segments(**{**vars(segments), "length_mm": length})


@pytest.mark.parametrize(
    ("rule", "chains"),
    [
        ("literal", [1, 1, 4, 4, 5, 5]),  # the whole profile 5 stands apart
        ("global", [10, 10]),  # its overlap is still above 80 %
        ("segments", [1, 4, 5, 10]),  # only the one face is cut
    ],
)
def test_one_odd_segment_breaks_what_the_rule_says(rule: str, chains: list[int]) -> None:
    segments = altered(roof(), k=5, face=0, length_factor=0.7)
    chain = merge_profiles(segments, MergeParams(rule=rule))
    assert sorted(np.bincount(chain)) == chains


@pytest.mark.parametrize("rule", ["literal", "global", "segments"])
def test_a_turn_of_the_whole_profile_beyond_rotation_th_cuts_it(rule: str) -> None:
    segments = roof()
    turned = segments.profile >= 5
    c, s = np.cos(0.2), np.sin(0.2)
    normal = segments.normal.copy()
    normal[turned, 1:] = normal[turned, 1:] @ np.array([[c, s], [-s, c]])
    segments = Segments(**{**vars(segments), "normal": normal})
    params = MergeParams(rule=rule, close_normal_rad=0.1)
    assert sorted(np.bincount(merge_profiles(segments, params))) == [5, 5, 5, 5]


def test_no_segments_make_no_chains() -> None:
    empty = find_segments(profile(np.full(5, np.nan), np.full(5, np.nan)), SegmentParams())
    assert len(merge_profiles(empty, MergeParams())) == 0
