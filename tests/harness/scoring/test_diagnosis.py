from __future__ import annotations

import numpy as np
import pytest

from harness.scoring import exact_pose, pose_error
from harness.scoring.common_points import common_points
from harness.scoring.diagnosis import (
    only,
    register_with_true_patches,
    register_with_true_rotation,
    true_patches,
    true_segments,
    visible_parts,
)
from registration.thesis.params import ThesisParams
from scenes.desk import DeskParams, desk
from scenes.separated_planes import SeparatedPlanesParams, separated_planes
from sensors.jupiter import Jupiter
from sensors.overlap import seen
from sensors.paths import aimed_view, straight_line

SENSOR = Jupiter()
STEP_MM = 5.0
PROFILES = 80


def path_at(yaw_deg: float):
    T_world_view = aimed_view(
        [0.0, 0.0, 0.0], 800.0, np.deg2rad(yaw_deg), np.deg2rad(20.0), 0.0, PROFILES, STEP_MM
    )
    return straight_line(T_world_view, PROFILES, STEP_MM)


@pytest.fixture(scope="module")
def desk_hits():
    return SENSOR.hits(desk(DeskParams()), path_at(0.0))


def test_parts_are_connected_and_of_one_face() -> None:
    surface = np.array([[0, 0, 1, 0], [1, 1, 0, -1], [0, -1, -1, 0]])
    part = visible_parts(surface)
    assert (part == -1).tolist() == (surface == -1).tolist()
    # Faces are connected across corners, so the zeros of the first rows are one part.
    assert part.tolist() == [[0, 0, 2, 0], [2, 2, 0, -1], [1, -1, -1, 0]]


def test_true_segments_are_exact(desk_hits) -> None:
    segments, _ = true_segments(desk_hits, SENSOR.apex_mm, min_points=3)
    assert len(segments) > 100
    for i in range(0, len(segments), 17):
        k, a, b = segments.profile[i], segments.first[i], segments.last[i]
        assert len(np.unique(desk_hits.surface[k, a : b + 1])) == 1
        points = desk_hits.points_mm[k, a : b + 1]
        np.testing.assert_allclose(segments.centroid_mm[i], points.mean(axis=0), atol=1e-8)
        off = (points - segments.centroid_mm[i]) @ segments.normal[i]
        np.testing.assert_allclose(off, 0.0, atol=1e-7)
        assert segments.normal[i] @ (SENSOR.apex_mm - segments.centroid_mm[i]) > 0.0
        longer = desk_hits.surface[k, max(a - 1, 0)], desk_hits.surface[k, min(b + 1, 255)]
        face = desk_hits.surface[k, a]
        assert a == 0 or longer[0] != face
        assert b == 255 or longer[1] != face


def test_true_patches_are_exact(desk_hits) -> None:
    patches = true_patches(desk_hits, SENSOR.apex_mm, ThesisParams())
    outward = desk_hits.normal[desk_hits.valid]
    offsets = np.einsum("nj,nj->n", outward, desk_hits.points_mm[desk_hits.valid])
    planes = np.unique(np.round(np.column_stack([outward, offsets]), 6), axis=0)
    found = np.column_stack([patches.normal, patches.offset_mm])
    nearest = np.abs(planes[None] - found[:, None]).max(axis=2).min(axis=1)
    assert len(patches) > 5
    np.testing.assert_allclose(nearest, 0.0, atol=1e-4)


def test_shared_hits_are_those_that_both_views_see() -> None:
    scene, here, there = desk(DeskParams()), path_at(0.0), path_at(25.0)
    hits = SENSOR.hits(scene, here)
    both = common_points(SENSOR, scene, (hits, SENSOR.hits(scene, there)), (here, there))
    shared = only(hits, both.target)
    kept = shared.valid
    assert 0 < kept.sum() < hits.valid.sum()
    assert not (kept & ~hits.valid).any()
    world_mm = here.T_world_view.apply(hits.points_mm[hits.valid])
    visible = seen(SENSOR, scene, there, world_mm, hits.surface[hits.valid])
    np.testing.assert_array_equal(kept[hits.valid], visible)
    assert np.isnan(shared.points_mm[~kept]).all()


def test_the_truth_brings_the_pose_where_both_views_see_whole_faces() -> None:
    scene = separated_planes(SeparatedPlanesParams())
    target, source = path_at(-4.0), path_at(5.0)
    exact = exact_pose(target, source)
    params = ThesisParams()
    entered = register_with_true_patches(
        SENSOR.hits(scene, target), SENSOR.hits(scene, source), STEP_MM, SENSOR.apex_mm, params
    )
    error = pose_error(exact, entered.T_target_source)
    assert np.rad2deg(error.rotation_rad) < 1e-6
    assert error.translation_mm < STEP_MM
    scans = [
        SENSOR.scan(scene, p, np.random.default_rng(i)) for i, p in enumerate((target, source))
    ]
    turned = register_with_true_rotation(*scans, exact, params)
    assert pose_error(exact, turned.T_target_source).rotation_rad < 1e-12
