"""Pieces of one plane count as one plane, and tell the pose what no single piece knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plane_scans import clutter_pair

from registration import register
from registration.calibration import KNOWN_TO_MM
from registration.gauss_sphere.params import GaussSphereParams, RefineParams, WholePlaneParams
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.matching import Settled
from registration.gauss_sphere.refinement.refine import (
    EXACTLY,
    distances2,
    likelihood,
    maximise,
    widened,
)
from registration.gauss_sphere.refinement.whole_planes import Joining, by_whole_planes, put_together
from registration.scan import FloatArray
from registration.warm import no_bias

SIGMA_MM = 0.5
LEVER_MM = likelihood(RefineParams()).lever_mm
JOINING = Joining(floor_mm=0.0, distance2=9.0, loosest_mm=1.0, rounds=6)


def fitted(points_mm: FloatArray, normal: FloatArray) -> dict[str, FloatArray]:
    """Least squares plane through points with noise along the normal."""
    e0 = np.cross(normal, [0.3, 0.5, 0.8])
    e0 /= np.linalg.norm(e0)
    basis = np.stack([e0, np.cross(normal, e0)])
    centroid = points_mm.mean(axis=0)
    along = (points_mm - centroid) @ basis.T
    design = np.column_stack([-along, np.ones(len(points_mm))])
    found, *_ = np.linalg.lstsq(design, (points_mm - centroid) @ normal, rcond=None)
    tilted = normal + found[:2] @ basis
    tilted /= np.linalg.norm(tilted)
    basis = basis - np.outer(basis @ tilted, tilted)
    basis /= np.linalg.norm(basis, axis=1)[:, None]
    return {
        "normal": tilted,
        "centroid_mm": centroid + found[2] * tilted,
        "basis": basis,
        "covariance": SIGMA_MM**2 * np.linalg.inv(design.T @ design),
    }


def pieces_of(
    rng: np.random.Generator, *pieces: tuple[FloatArray, float, FloatArray, float]
) -> Patches:
    """Patches of pieces, each a square: normal, offset, middle (in the plane or not), half side."""
    made, areas = [], []
    for normal, offset_mm, middle_mm, half_mm in pieces:
        points = middle_mm + rng.uniform(-half_mm, half_mm, (300, 3))
        points += np.outer(offset_mm - points @ normal, normal)
        points += SIGMA_MM * rng.standard_normal((300, 1)) * normal
        made.append(fitted(points, normal))
        areas.append(4.0 * half_mm**2)
    columns = {name: np.array([one[name] for one in made]) for name in made[0]}
    n = len(made)
    return Patches(
        offset_mm=np.einsum("ij,ij->i", columns["normal"], columns["centroid_mm"]),
        spread_mm=np.zeros((n, 2)),
        n_points=np.full(n, 300),
        area_mm2=np.array(areas),
        label=np.full((1, 1), -1, dtype=np.int32),
        **columns,
    )


UP, RIGHT, AHEAD = np.eye(3)[[2, 0, 1]]


def test_putting_pieces_together_is_fitting_all_their_points() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-200.0, 200.0, (600, 3)) * [1.0, 1.0, 0.0]
    points[:, 2] = 30.0 + SIGMA_MM * rng.standard_normal(600)
    left = points[:, 0] < 0.0
    parts = [fitted(points[which], UP) for which in (left, ~left)]
    whole = fitted(points, UP)
    two = pieces_of(rng, *[(UP, 30.0, np.zeros(3), 100.0)] * 2)._replace(
        **{name: np.array([part[name] for part in parts]) for name in whole}
    )
    together, whole_of = put_together(two, LEVER_MM, JOINING)
    assert whole_of.tolist() == [0, 0]
    normal, centroid = together.normal[0], together.centroid_mm[0]
    assert normal == pytest.approx(whole["normal"], abs=2e-6)
    assert normal @ (whole["centroid_mm"] - centroid) == pytest.approx(0.0, abs=1e-3)
    # How well the offset at the common centroid, and the tilts, are known.
    lever = np.append(together.basis[0] @ (whole["centroid_mm"] - centroid), -1.0)
    offset_variance = lever @ together.covariance[0] @ lever
    assert offset_variance == pytest.approx(whole["covariance"][2, 2], rel=1e-3)
    tilts = [np.trace(c[:2, :2]) for c in (together.covariance[0], whole["covariance"])]
    assert tilts[0] == pytest.approx(tilts[1], rel=1e-3)


def test_planes_a_step_or_an_angle_apart_stay_two() -> None:
    rng = np.random.default_rng(2)
    tilted = np.array([np.sin(0.02), 0.0, np.cos(0.02)])
    middle = np.array([150.0, 0.0, 0.0])
    made = pieces_of(
        rng,
        (UP, 0.0, -middle, 80.0),
        (UP, 3.0, middle, 80.0),
        (tilted, 150.0 * np.sin(0.02), middle, 80.0),
        (UP, 0.0, middle, 80.0),
    )
    _, whole_of = put_together(made, LEVER_MM, JOINING)
    assert whole_of.tolist() == [0, 1, 2, 0]


def settled(target: Patches, source: Patches, pairs: FloatArray) -> Settled:
    """The pose by these pairs, from the true one."""
    likely = likelihood(RefineParams())
    r, t, n = np.eye(3), np.zeros(3), len(pairs)
    information, sure, distance2 = np.zeros((6, 6)), np.zeros((6, 6)), np.empty(n)
    maximise(target, source, pairs, likely, 0.005, r, t, information, distance2, EXACTLY)
    widened(target, source, pairs, likely, 0.005, r, t, sure, 0.0)
    return Settled(r, t, information, sure, 0.005, pairs, distance2, np.zeros(2), 1.0)


def test_a_wall_of_which_each_view_sees_another_part_fixes_the_pose() -> None:
    """Both see a floor and two faces of a small box; the wall's parts share no point."""
    box = [(UP, 40.0, 10.0 * UP, 12.0), (RIGHT, 30.0, AHEAD, 12.0), (AHEAD, 30.0, UP, 12.0)]
    floor = (UP, 0.0, np.zeros(3), 150.0)
    errors_deg, kept_deg, distances2 = [], [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        target = pieces_of(rng, floor, *box, (AHEAD, 200.0, -150.0 * RIGHT, 120.0))
        source = pieces_of(rng, floor, *box, (AHEAD, 200.0, 150.0 * RIGHT, 120.0))
        best = settled(target, source, np.stack([np.arange(4)] * 2, axis=1))
        refined = by_whole_planes(best, target, source, GaussSphereParams())
        for found, errors in ((best, kept_deg), (refined, errors_deg)):
            cosine = 0.5 * (np.trace(found.rotation) - 1.0)
            errors.append(np.rad2deg(np.arccos(min(cosine, 1.0))))
        turn = refined.rotation
        step = np.array([turn[2, 1], turn[0, 2], turn[1, 0], *refined.shift_mm])
        distances2.append(step @ refined.sure @ step)
    assert np.mean(errors_deg) < 0.3 * np.mean(kept_deg)
    # And it knows how sure it is: 6 in the mean, known to 0.5 from 40 draws.
    assert 3.5 < np.mean(distances2) < 8.0


def test_a_plane_counts_once_when_the_other_view_left_its_pieces_apart() -> None:
    """The floor of one view is worth no more for being paired with two pieces of the other's."""
    box = [(UP, 40.0, 10.0 * UP, 12.0), (RIGHT, 30.0, AHEAD, 12.0), (AHEAD, 30.0, UP, 12.0)]
    floor = (UP, 0.0, np.zeros(3), 20.0)
    pieces = (floor, *box, (UP, 0.18, 20.0 * RIGHT, 20.0))
    sure = []
    for n in (4, 5):
        rng = np.random.default_rng(0)
        target, source = pieces_of(rng, floor, *box), pieces_of(rng, *pieces[:n])
        assert put_together(source, LEVER_MM, JOINING)[1].tolist() == list(range(n))
        best = settled(target, source, np.stack([np.arange(4)] * 2, axis=1))
        pairs = np.array([[0, 0], [1, 1], [2, 2], [3, 3], [0, 4]])[:n]
        found = best._replace(pairs=pairs, distance2=np.zeros(n), sure=1e-6 * np.eye(6))
        params = GaussSphereParams(whole_planes=WholePlaneParams(moved_distance2=1e9))
        sure.append(by_whole_planes(found, target, source, params).sure)
    assert sure[1] == pytest.approx(sure[0], rel=1e-9)


@pytest.mark.parametrize("calibrated", [True, False])
def test_distances_of_planes_are_of_the_pose_that_is_answered(
    tmp_path: Path, calibrated: bool
) -> None:
    no_bias().write(tmp_path / "c.json")
    params = GaussSphereParams(calibration=str(tmp_path / "c.json") if calibrated else "")
    target, source, _ = clutter_pair(1001, 1.0)
    result = register(target, source, params=params)
    assert result.status == "ok"
    seen = result.evidence["planes"]
    pose = result.T_target_source
    found = [
        min(
            np.abs(
                distances2(
                    seen.target.patches, seen.source.patches, seen.pairs,
                    likelihood(params.refine), floor, pose.rotation.as_matrix(), pose.translation,
                ) - seen.distance2
            ).max()
            for floor in (*params.refine.floors_mm, KNOWN_TO_MM)
        )
    ]  # fmt: skip
    assert max(found) < 1e-6


def test_without_a_calibration_whole_planes_move_poses_and_leave_them_as_sure() -> None:
    whole = GaussSphereParams()
    apart = GaussSphereParams(whole_planes=WholePlaneParams(most_floor_mm=0.0))
    moved2 = []
    for seed in range(1001, 1007):
        target, source, _ = clutter_pair(seed, 1.0)
        before, after = (register(target, source, params=params) for params in (apart, whole))
        assert before.status == after.status == "ok"
        np.testing.assert_array_equal(after.covariance, before.covariance)
        moved = after.T_target_source * before.T_target_source.inv()
        step = np.concatenate([moved.rotation.as_rotvec(), moved.translation])
        moved2.append(step @ np.linalg.solve(before.covariance, step))
    assert 0.0 < max(moved2) < whole.whole_planes.moved_distance2
