from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planar_profiles import as_segments, motion, moved, random_lines, scan_outline
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform

from registration import Scan
from registration.planar.circle import (
    circle_overlap,
    gauss_circle,
    pair_pose,
    planar_transform,
    wrapped,
)
from registration.planar.overlap import line_table, matches_under, total_overlaps
from registration.planar.params import PlanarParams
from registration.planar.pipeline import register_profiles, register_segments
from registration.planar.search import pair_poses

PRESETS = {
    "default": PlanarParams(),
    "thesis": PlanarParams.thesis(),
    "literal": PlanarParams.literal(),
    "pair": PlanarParams(refinement="none"),
}
ROOF_MM = np.array(
    [[-180, 760], [-90, 700], [-30, 640], [60, 655], [110, 730], [190, 690]], dtype=float
)


def difference(a: RigidTransform, b: RigidTransform) -> tuple[float, float]:
    turn = (a.rotation * b.rotation.inv()).magnitude()
    return float(turn), float(np.linalg.norm(a.translation - b.translation))


@pytest.mark.parametrize("seed", range(20))
def test_the_corrected_equations_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = motion(rng.uniform(-np.pi, np.pi), *rng.uniform(-900.0, 900.0, 2))
    normal, centroid = rng.normal(size=3) * [0, 1, 1], rng.uniform(-900.0, 900.0, 3) * [0, 1, 1]
    dphi, dx, dy = pair_pose(
        pose.rotation.apply(normal)[1:], normal[1:], pose.apply(centroid)[1:], centroid[1:]
    )
    assert -np.pi < dphi <= np.pi
    found = planar_transform([dphi, dx, dy])
    assert max(difference(found, pose)) < 1e-9


def test_half_a_turn_is_wrapped_to_the_positive_side() -> None:
    np.testing.assert_allclose(wrapped([-np.pi, np.pi, 3.0 * np.pi]), np.pi)
    np.testing.assert_allclose(wrapped([2.0 * np.pi + 0.1, -0.1]), [0.1, -0.1])


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("seed", range(8))
def test_true_segments_give_the_pose_exactly(preset: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = motion(rng.uniform(-1.1, 1.1), *rng.uniform(-500.0, 500.0, 2))
    lines = random_lines(rng)
    seen, also = as_segments(moved(lines, pose)), as_segments(rng.permutation(lines))
    result = register_segments(seen, also, PRESETS[preset])
    assert (result.status, result.reason) == ("ok", "")
    turn, shift = difference(result.T_target_source, pose)
    assert turn < 1e-9
    assert shift < 1e-6
    assert len(result.evidence["planar"].matches.pairs) == len(lines)
    np.testing.assert_array_equal(result.undetermined, np.eye(6)[[1, 2, 3]])


@pytest.mark.parametrize("refinement", ["centroids", "lines", "none"])
@pytest.mark.parametrize("seed", range(5))
def test_moving_the_source_moves_the_answer_and_swapping_inverts_it(
    refinement: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    params = PlanarParams(refinement=refinement, min_overlap=0.0)
    lines = random_lines(rng)
    jitter = np.concatenate([np.zeros((*lines.shape[:2], 1)), rng.normal(0, 0.2, (6, 2, 2))], 2)
    pose, extra = motion(-0.7, -420.0, 300.0), motion(0.4, 90.0, -60.0)
    target, source = moved(lines, pose), lines + jitter
    first = register_segments(as_segments(target), as_segments(source), params).T_target_source
    second = register_segments(
        as_segments(target), as_segments(moved(source, extra)), params
    ).T_target_source
    assert max(difference(first, second * extra)) < 1e-6
    back = register_segments(as_segments(source), as_segments(target), params).T_target_source
    assert max(difference(first, back.inv())) < 1e-6
    assert max(difference(first, pose)) > 1e-3  # the jitter shows: the laws are not trivial here


def test_refinement_by_lines_minimises_what_it_says() -> None:
    rng = np.random.default_rng(4)
    lines = random_lines(rng)
    noisy = lines + rng.normal(0.0, 0.4, lines.shape) * [0, 1, 1]
    target, source = as_segments(lines), as_segments(noisy)
    params = PlanarParams(refinement="lines")
    found = register_segments(target, source, params).T_target_source
    pose = np.array([-found.rotation.as_rotvec()[0], *found.translation[1:]])
    tables = line_table(target), line_table(source)
    at = matches_under(*tables, pose, params.angle_tolerance_rad, params.offset_tolerance_mm)
    ends = (at.source_mm - pose[1:]) @ _turn(pose[0])  # back in the source's frame

    def cost(p: np.ndarray) -> float:
        apart = at.target_mm - (ends @ _turn(p[0]).T + p[1:])
        across = np.einsum("mi,mei->me", at.normal, apart)
        return float((at.overlap_mm[:, None] * across**2).sum())

    scale = np.array([1e-3, 1.0, 1.0])
    best = minimize(lambda q: cost(pose + scale * q), np.zeros(3), tol=1e-14).x
    np.testing.assert_allclose(scale * best, 0.0, atol=1e-5)


def _turn(dphi: float) -> np.ndarray:
    return np.array([[np.cos(dphi), np.sin(dphi)], [-np.sin(dphi), np.cos(dphi)]])


def test_lines_do_not_mind_what_part_of_a_face_is_seen() -> None:
    lines = random_lines(np.random.default_rng(9))
    middle, half = lines.mean(axis=1, keepdims=True), 0.5 * (lines[:, 1:] - lines[:, :1])
    cut = np.concatenate([middle - half, middle + 0.4 * half], axis=1)
    pose = motion(-0.5, -200.0, 120.0)
    target, source = as_segments(moved(lines, pose)), as_segments(cut)
    by_lines = register_segments(target, source, PlanarParams()).T_target_source
    by_centroids = register_segments(target, source, PlanarParams.thesis()).T_target_source
    assert max(difference(by_lines, pose)) < 1e-6
    assert difference(by_centroids, pose)[1] > 1.0


def test_overlap_is_the_length_that_both_cover() -> None:
    flat = np.array([[[0.0, 0.0, 500.0], [0.0, 100.0, 500.0]]])
    beside = flat + np.array([0.0, 30.0, 3.0])
    table = [line_table(as_segments(e)) for e in (flat, beside)]
    totals, spreads = total_overlaps(*table, np.zeros((1, 3)), 0.02, 4.0)
    np.testing.assert_allclose(totals, [70.0])
    np.testing.assert_allclose(spreads, [0.0])
    assert total_overlaps(*table, np.zeros((1, 3)), 0.02, 2.9)[0][0] == 0.0
    assert total_overlaps(*table, np.array([[0.03, 0, 0]]), 0.02, 99.0)[0][0] == 0.0


def test_gauss_circles_overlap_by_the_shorter_of_like_normals() -> None:
    lines = random_lines(np.random.default_rng(2))
    circle = gauss_circle(as_segments(lines))
    turned = gauss_circle(as_segments(moved(lines, motion(0.3, 5.0, 5.0))))
    assert circle_overlap(turned, circle, -0.3, 1e-6) == pytest.approx(circle.length_mm.sum())
    assert circle_overlap(turned, circle, 0.0, 1e-6) == 0.0


def test_every_pair_of_normals_is_tried() -> None:
    lines = random_lines(np.random.default_rng(2))
    poses = pair_poses(as_segments(lines[:2]), as_segments(lines))
    assert poses.shape == (12, 3)
    np.testing.assert_allclose(poses[[0, 7]], 0.0, atol=1e-9)


def test_scans_are_registered_to_a_part_of_a_sample() -> None:
    pose = motion(-0.2, -60.0, 25.0)
    source_mm = pose.inv().apply(np.pad(ROOF_MM, ((0, 0), (1, 0))))[:, 1:]
    result = register_profiles(scan_outline(ROOF_MM), scan_outline(source_mm), PlanarParams())
    assert result.status == "ok"
    turn, shift = difference(result.T_target_source, pose)
    assert np.degrees(turn) < 0.5  # WARP lets every line run some 4 mm past its corner
    assert shift < 5.0
    assert set(result.stage_ms) == {"preprocess", "segments", "plane"}


def test_poor_profiles_come_back_with_status_and_reason() -> None:
    good = scan_outline(ROOF_MM)
    empty = Scan.from_points(np.full((1, 64, 3), np.nan), step_mm=5.0)
    wall = scan_outline(np.array([[-300.0, 700.0], [300.0, 720.0]]))
    two = Scan.from_points(np.repeat(good.points_mm, 2, axis=0), step_mm=5.0)
    for target, source, status, reason in (
        (empty, good, "failed", "of the target has no straight segment"),
        (empty, empty, "failed", "of the target and of the source has no straight segment"),
        (wall, wall, "underdetermined", "of two directions, 0% overlap"),
        (two, good, "failed", "the target has 2 profiles and the source 1"),
    ):
        result = register_profiles(target, source, PlanarParams())
        assert result.status == status
        assert reason in result.reason
        assert result.T_target_source is None
    open_ = register_profiles(wall, wall, PlanarParams()).undetermined
    assert open_.shape == (4, 6)
    np.testing.assert_allclose(np.abs(open_[3, 4:]), np.array([600, 20]) / np.hypot(600, 20), 1e-3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("preset", PRESETS)
def test_any_content_comes_back_with_a_status(preset: str) -> None:
    rng = np.random.default_rng(12)
    statuses = set()
    for _ in range(60):
        scans = [odd_profile(rng) for _ in range(2)]
        if rng.random() < 0.3:
            scans[1] = scans[0]
        result = register_profiles(*scans, PRESETS[preset])
        assert (result.status == "ok") == (result.reason == "")
        if result.T_target_source is not None:
            assert np.isfinite(result.T_target_source.as_matrix()).all()
        statuses.add(result.status)
    assert {"ok", "failed"} <= statuses


def odd_profile(rng: np.random.Generator) -> Scan:
    """Noise, spikes, steps, one place only, or far too wide; a tenth or all of it missing."""
    n = int(rng.integers(1, 128))
    y = np.sort(rng.uniform(-200.0, 200.0, n))
    y, z = [
        (y, np.full(n, 700.0)),
        (y, rng.uniform(-1e3, 1e3, n)),
        (y, 600.0 + np.abs(y) * rng.uniform(-3.0, 3.0)),
        (np.zeros(n), np.zeros(n)),
        (y, 700.0 + 40.0 * np.round(y / 40.0) + rng.normal(0.0, 0.3, n)),
        (1e3 * y, 700.0 + 2.0 * np.abs(y % 60.0 - 30.0)),
    ][int(rng.integers(6))]
    points = np.stack([np.zeros(n), y, z], axis=1)
    points[rng.random(n) < rng.choice([0.0, 0.1, 1.0])] = np.nan
    return Scan.from_points(points[None], step_mm=5.0)


def test_a_profile_that_repeats_itself_is_ambiguous() -> None:
    tooth = np.array([[0.0, 60.0], [30.0, 0.0], [60.0, 60.0]])
    ends = np.stack([tooth[:-1], tooth[1:]], axis=1)
    comb = np.concatenate([ends + np.array([60.0 * k, 700.0]) for k in range(4)])
    lines = np.pad(comb, ((0, 0), (0, 0), (1, 0)))
    result = register_segments(as_segments(lines), as_segments(lines[:6]), PlanarParams())
    assert result.status == "ambiguous"
    assert "another pose" in result.reason
    assert result.candidates[0].score == pytest.approx(2 * 3 * np.hypot(30, 60))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"refinement": "points"}, "refinement is 'points'; must be one of none, centroids, lines"),
        ({"min_overlap": 1.5}, "min_overlap is 1.5; must be at least 0 and at most 1"),
        ({"offset_tolerance_mm": float("nan")}, "offset_tolerance_mm is nan"),
        ({"candidates": -1}, "candidates is -1; must be a whole number"),
    ],
)
def test_wrong_parameters_are_refused(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(PlanarParams(), **change)
