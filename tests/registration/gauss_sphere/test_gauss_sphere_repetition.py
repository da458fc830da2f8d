"""Scenes that repeat themselves: poses a period off question the answer, or are denied."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    ROOM,
    Pair,
    Plates,
    box_faces,
    clutter_pair,
    join,
    move_plates,
    plates_from,
    random_view,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration import register
from registration.gauss_sphere.appeal import appealed
from registration.gauss_sphere.matching import Settled, settle_best
from registration.gauss_sphere.params import GaussSphereParams, OutlineParams
from registration.gauss_sphere.pipeline import describe
from registration.gauss_sphere.testimony import denied_share
from registration.gauss_sphere.translation import search_of, shifts_at
from registration.gauss_sphere.verification import View

PERIOD_MM = 100.0
ALONG = ROOM.apply([0.0, 1.0, 0.0])
PARAMS = GaussSphereParams()


def room(*things: Plates) -> Plates:
    """Floor and wall, which meet along the room's Y, and what stands in front of them."""
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    places = np.array([[-90.0, 0.0, -100.0], [100.0, 0.0, 170.0]])
    empty = plates_from(ROOM.apply(normals), MIDDLE + ROOM.apply(places), np.full((2, 2), 500.0))
    return join(empty, *things)


def row(cubes: range) -> list[Plates]:
    """Equal cubes on the floor, an edge in front, so that two sides of each are seen."""
    turn = ROOM * Rotation.from_rotvec([np.pi / 4.0, 0.0, 0.0])
    places = [MIDDLE + ROOM.apply([-60.0, PERIOD_MM * k, 60.0]) for k in cubes]
    return [
        box_faces(RigidTransform.from_components(place, turn), np.full(3, 30.0)) for place in places
    ]


def pair_of(plates: Plates, seed: int) -> Pair:
    rng = np.random.default_rng(seed)
    T_source_target = random_view(rng, turn_deg=12.0)
    return Pair(
        scan_plates(plates, noise=1.0, rng=rng),
        scan_plates(move_plates(plates, T_source_target), noise=1.0, rng=rng),
        T_source_target.inv(),
    )


def views_of(pair: Pair) -> tuple[View, View]:
    target, source = (describe(scan, PARAMS) for scan in (pair.target, pair.source))
    return target, source


def off_by(T: RigidTransform, periods: float) -> tuple[np.ndarray, np.ndarray]:
    shift_mm = np.asarray(T.translation) + periods * PERIOD_MM * ALONG
    return np.ascontiguousarray(T.rotation.as_matrix()), shift_mm


def settled_at(target: View, source: View, r: np.ndarray, t: np.ndarray) -> Settled:
    (pose,) = settle_best(target, source, r[None], t[None], PARAMS, look_again=False)
    return pose


@pytest.mark.parametrize("seed", range(4))
def test_shifts_a_period_off_are_found(seed: int) -> None:
    pair = pair_of(room(*row(range(-6, 7))), seed)
    target, source = views_of(pair)
    for periods in (-2, -1, 0, 1, 2):
        r, t = off_by(pair.T_target_source, periods)
        found = shifts_at(target.patches, source.patches, r, search_of(PARAMS.wide, 50))
        assert np.linalg.norm(found - t, axis=1).min() < 8.0


@pytest.mark.parametrize("seed", range(4))
def test_a_settled_pose_brings_those_a_period_off_along(seed: int) -> None:
    pair = pair_of(room(*row(range(-6, 7))), seed)
    target, source = views_of(pair)
    r, t = off_by(pair.T_target_source, 0)
    found = settle_best(target, source, r[None], t[None], PARAMS)
    assert len(found) >= 3
    assert [pose.score for pose in found] == sorted((pose.score for pose in found), reverse=True)
    beside = np.array([(pose.shift_mm - t) @ ALONG / PERIOD_MM for pose in found])
    for periods in (-1, 0, 1):
        assert np.abs(beside - periods).min() < 0.02


@pytest.mark.parametrize("seed", range(4))
def test_a_row_that_never_ends_is_ambiguous(seed: int) -> None:
    pair = pair_of(room(*row(range(-6, 7))), seed)
    result = register(pair.target, pair.source)
    assert result.status == "ambiguous", result.reason


@pytest.mark.parametrize("seed", range(4))
def test_outlines_deny_a_pose_two_periods_off_where_the_row_ends(seed: int) -> None:
    pair = pair_of(room(*row(range(-1, 2))), seed)
    target, source = views_of(pair)
    right, wrong = (
        settled_at(target, source, *off_by(pair.T_target_source, periods)) for periods in (0, 2)
    )
    how = PARAMS.outlines
    shares = [
        denied_share(pose.rotation, pose.shift_mm, target, source, how) for pose in (right, wrong)
    ]
    assert shares[0] == 0.0
    assert shares[1] > how.refuted_share
    left = appealed([wrong, right], target, source, 0.0, PARAMS)
    assert len(left) == 1
    assert np.linalg.norm(left[0].shift_mm - right.shift_mm) < 5.0


def test_an_answer_that_outlines_deny_is_taken_back() -> None:
    pair = clutter_pair(0, noise=1.0)
    assert register(pair.target, pair.source).status == "ok"
    # Whatever is said is taken as a denial, and no confirmation is enough.
    harsh = OutlineParams(refuted_share=-1.0, refuting_share=-1.0, least=-1, confirmed_share=2.0)
    result = register(pair.target, pair.source, params=GaussSphereParams(outlines=harsh))
    assert (result.status, result.stage) == ("failed", "verification")
    assert result.T_target_source is None
    assert "outlines" in result.reason
    assert result.candidates
