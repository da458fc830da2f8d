from __future__ import annotations

import numpy as np
import pytest

from harness.scoring import exact_pose
from harness.scoring.common_points import common_points
from harness.scoring.diagnosis import only
from harness.scoring.face_gaps import FaceGaps, centroid_gaps, gaps_in_words
from registration.thesis.params import ThesisParams
from scenes.separated_planes import SeparatedPlanesParams, separated_planes
from sensors.jupiter import Jupiter
from sensors.paths import ViewPath, aimed_view, straight_line

SENSOR, SCENE = Jupiter(), separated_planes(SeparatedPlanesParams())
STEP_MM = 5.0


def path_at(yaw_deg: float, profiles: int = 60) -> ViewPath:
    start = aimed_view(
        [0.0, 0.0, 0.0], 700.0, np.deg2rad(yaw_deg), np.deg2rad(5.0), 0.0, profiles, STEP_MM
    )
    return straight_line(start, profiles, STEP_MM)


def gaps_of(target: ViewPath, source: ViewPath, shared: bool = False) -> np.ndarray:
    paths = target, source
    hits = SENSOR.hits(SCENE, target), SENSOR.hits(SCENE, source)
    if shared:
        both = common_points(SENSOR, SCENE, hits, paths)
        hits = only(hits[0], both.target), only(hits[1], both.source)
    return centroid_gaps(*hits, exact_pose(*paths), SENSOR.apex_mm, ThesisParams())


def test_a_view_and_itself_have_the_same_centroids() -> None:
    gaps = gaps_of(path_at(8.0), path_at(8.0))
    assert len(gaps) >= 3
    np.testing.assert_allclose(gaps, 0.0, atol=1e-9)


def test_a_line_that_ends_early_parts_centroids_along_the_motion() -> None:
    whole = path_at(0.0)
    early = straight_line(whole.T_world_view, 25, STEP_MM)
    gaps = gaps_of(whole, early)
    moved = np.abs(gaps).max(axis=0)
    assert np.median(gaps[:, 0]) > 1.0
    assert moved[0] > moved[1]
    np.testing.assert_allclose(gaps_of(whole, early, shared=True)[:, 0], 0.0, atol=STEP_MM)


def test_exchanging_the_views_turns_the_gaps_round() -> None:
    one, other = path_at(-8.0), path_at(8.0)
    there, back = gaps_of(one, other), gaps_of(other, one)
    rotation = exact_pose(one, other).rotation
    assert len(there) >= 3
    np.testing.assert_allclose(there, -rotation.apply(back), atol=1e-8)


def test_cut_to_what_both_see_centroids_nearly_agree() -> None:
    one, other = path_at(-8.0), path_at(8.0)
    shared = np.linalg.norm(gaps_of(one, other, shared=True), axis=1)
    assert np.median(shared) < STEP_MM


def test_the_sentence_names_the_largest_part() -> None:
    gaps = FaceGaps(np.array([[30.0, 1.0, 0.0], [40.0, 0.0, 9.0]]), np.zeros((0, 3)))
    text = gaps_in_words(gaps)
    assert "2 faces" in text
    assert f"{(30.0167 + 41) / 2:.1f} mm apart" in text
    assert "mostly along X" in text
    assert "cut to" not in text
    assert gaps_in_words(FaceGaps(np.zeros((0, 3)), np.zeros((0, 3)))) == ""


@pytest.mark.parametrize("kept", [0.0, 1.0])
def test_chosen_hits_are_unchanged_and_the_rest_gone(kept: float) -> None:
    hits = SENSOR.hits(SCENE, path_at(0.0, 10))
    chosen = only(hits, np.full(hits.surface.shape, bool(kept)))
    np.testing.assert_array_equal(chosen.valid, hits.valid & bool(kept))
    if kept:
        np.testing.assert_array_equal(chosen.points_mm, hits.points_mm)
