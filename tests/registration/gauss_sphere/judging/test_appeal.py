"""What ends of faces prefer to poses of more surface, and poses of which they say nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    ROOM,
    Pair,
    Plates,
    clutter_pair,
    move_plates,
    pose_error,
    random_view,
    scan_plates,
    stairs,
    stairs_pair,
)
from scipy.spatial.transform import RigidTransform

from registration import register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.appeal import outscoring
from registration.gauss_sphere.judging.further_along import unsaid_along
from registration.gauss_sphere.outlines.ends import Ends, as_ends
from registration.gauss_sphere.outlines.telling import outlines_of
from registration.gauss_sphere.outlines.testimony import said_along
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.view import View

PARAMS = GaussSphereParams()
ALONG = ROOM.apply([0.0, 1.0, 0.0])


def stairs_with_boards(seed: int) -> Pair:
    """Stairs that look the same all along, but for two boards that end across."""
    lower = ([-50.0, -110.0, -90.0], "riser", [20.0, 17.0])
    upper = ([45.0, 95.0, -60.0], "riser", [20.0, 30.0])
    return stairs_pair(stairs(lower, upper), seed)


def described(pair: Pair) -> tuple[View, View]:
    return describe(pair.target, PARAMS), describe(pair.source, PARAMS)


def ends_of(target: View, source: View) -> tuple[Ends, Ends]:
    of_target, of_source = (as_ends(outlines_of(v, PARAMS.outlines)) for v in (target, source))
    return of_target, of_source


def at(T: RigidTransform, target: View, source: View) -> Settled:
    r, t = T.rotation.as_matrix()[None], np.asarray(T.translation)[None]
    return settle_best(target, source, r, t, PARAMS, look_again=False)[0]


def row_of_boxes(missing: tuple[int, ...] = ()) -> Plates:
    """A wall, a floor and equal boxes in a row, 170 mm apart."""
    up, along, away = np.eye(3)
    plates = [
        ([20.0, 0.0, 60.0], (up, along, -away), [250.0, 900.0]),
        ([-110.0, 0.0, -60.0], (away, along, up), [160.0, 900.0]),
    ]
    for k in set(range(-4, 5)) - set(missing):
        y = 170.0 * k
        plates += [
            ([40.0, y, 0.0], (away, along, up), [60.0, 25.0]),
            ([0.0, y, -60.0], (up, along, -away), [40.0, 25.0]),
            ([0.0, y - 25.0, 0.0], (up, away, -along), [40.0, 60.0]),
            ([0.0, y + 25.0, 0.0], (up, away, along), [40.0, 60.0]),
        ]
    places, axes, halves = zip(*plates, strict=True)
    turned = ROOM.apply(np.reshape(axes, (-1, 3))).reshape(-1, 3, 3)
    return Plates(MIDDLE + ROOM.apply(places), turned, np.array(halves))


@pytest.mark.parametrize("seed", [7, 11])
def test_a_box_taken_from_a_row_between_the_scans_leaves_the_next_in_doubt(seed: int) -> None:
    """Ends deny the true pose where it was, and confirm the one that is a box further."""
    rng = np.random.default_rng(seed)
    T = random_view(rng, turn_deg=12.0)
    slid = np.asarray(T.translation) + rng.uniform(-60.0, 60.0) * T.rotation.apply(ALONG)
    T = RigidTransform.from_components(slid, T.rotation)
    target, source = (
        scan_plates(plates, profiles=90, step_mm=3.0, noise=1.0, rng=rng)
        for plates in (row_of_boxes(), move_plates(row_of_boxes(missing=(1,)), T))
    )
    result = register(target, source)
    assert result.status == "ambiguous", result.reason
    assert "a thing may have been moved" in result.reason
    assert result.T_target_source is not None
    possible = [result.T_target_source, *(c.T_target_source for c in result.candidates)]
    errors = [pose_error(pose, T.inv()) for pose in possible]
    assert any(turn_deg < 0.5 and off_mm < 10.0 for turn_deg, off_mm in errors)


def test_poses_of_more_surface_and_as_many_planes_speak_against_an_answer() -> None:
    pair = clutter_pair(0, noise=1.0)
    target, source = described(pair)
    best = at(pair.T_target_source, target, source)
    answer = best._replace(shift_mm=best.shift_mm + 90.0 * ALONG, score=0.9 * best.score)

    def against(pose: Settled) -> bool:
        return bool(outscoring([pose], answer, target, source, PARAMS.decision))

    assert against(best)
    assert not against(best._replace(score=0.8 * best.score))
    assert not against(best._replace(pairs=best.pairs[:2], distance2=best.distance2[:2]))
    assert not against(best._replace(shift_mm=answer.shift_mm + 1.0))


def test_a_pose_that_slides_speaks_against_an_answer_along_there_by_much_surface_only() -> None:
    pair = stairs_with_boards(1)
    target, source = described(pair)
    slides = at(pair.T_target_source, target, source)
    along, across = (
        slides._replace(shift_mm=slides.shift_mm + 90.0 * way, score=0.9 * slides.score)
        for way in (ALONG, ROOM.apply([0.0, 0.0, 1.0]))
    )
    assert not outscoring([slides], along, target, source, PARAMS.decision)
    assert outscoring([slides], across, target, source, PARAMS.decision)
    less = along._replace(score=0.5 * slides.score)
    assert outscoring([slides], less, target, source, PARAMS.decision)


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_an_answer_that_only_ends_place_names_a_pose_further_along(seed: int) -> None:
    pair = stairs_with_boards(seed)
    result = register(pair.target, pair.source)
    assert result.status == "ok", result.reason
    assert any(note.startswith("moved by 3") for note in result.notes)
    views = described(pair)
    away_mm = [
        c.T_target_source.apply(pair.T_target_source.inv().apply(MIDDLE)) - MIDDLE
        for c in result.candidates
    ]
    assert any(abs(d @ ALONG) > 300.0 for d in away_mm)
    ends = ends_of(*views)
    pose = at(pair.T_target_source, *views)
    found = unsaid_along(pose, *views, ends, 0.0, PARAMS)
    assert len(found) == 1
    for there in found:
        moved_mm = there.shift_mm - pose.shift_mm
        assert abs(moved_mm @ ALONG) == pytest.approx(np.linalg.norm(moved_mm), abs=1.0)
        here = there.rotation, there.shift_mm, ALONG, np.zeros(1)
        assert said_along(*here, *views, ends, PARAMS.outlines).sum() < PARAMS.outlines.least
        assert there.score > PARAMS.decision.repeat_share * pose.score


def test_no_pose_further_along_is_named_that_shares_little_or_that_planes_forbid() -> None:
    pair = stairs_with_boards(1)
    views = described(pair)
    pose, ends = at(pair.T_target_source, *views), ends_of(*views)
    more_asked = replace(PARAMS, decision=replace(PARAMS.decision, repeat_share=0.8))
    assert unsaid_along(pose, *views, ends, 0.0, PARAMS)
    assert not unsaid_along(pose, *views, ends, 0.0, more_asked)
    clutter = clutter_pair(0, noise=1.0)
    views = described(clutter)
    fixed = at(clutter.T_target_source, *views)
    assert not unsaid_along(fixed, *views, ends_of(*views), 0.0, PARAMS)
