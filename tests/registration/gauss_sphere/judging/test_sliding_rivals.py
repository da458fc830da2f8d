"""Poses that slide on two planes, beside those that planes of a third direction fix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    ROOM,
    Plates,
    box_faces,
    join,
    move_plates,
    plates_from,
    random_view,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform, Rotation

from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.decision import agreeing_planes, fixed_first, is_rival, judge
from registration.gauss_sphere.judging.judged import judged
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.view import View

PARAMS = GaussSphereParams()
DECISION = PARAMS.decision
ALONG = ROOM.apply([0.0, 1.0, 0.0])  # where floor and wall meet
OFF_MM = 45.0  # farther than planes are matched


def room(*things: Plates) -> Plates:
    """Floor and wall, and what stands in front of them."""
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    places = np.array([[-90.0, 0.0, -100.0], [100.0, 0.0, 170.0]])
    empty = plates_from(ROOM.apply(normals), MIDDLE + ROOM.apply(places), np.full((2, 2), 500.0))
    return join(empty, *things)


def cube() -> Plates:
    """A cube on the floor, an edge in front."""
    turn = ROOM * Rotation.from_rotvec([np.pi / 4.0, 0.0, 0.0])
    place = MIDDLE + ROOM.apply([-50.0, 0.0, 60.0])
    return box_faces(RigidTransform.from_components(place, turn), np.full(3, 40.0))


def board() -> Plates:
    """A board that leans on the wall, and looks aside."""
    normal, place = ROOM.apply([[0.0, -0.6, -0.8]]), MIDDLE + ROOM.apply([[0.0, 0.0, 100.0]])
    return plates_from(normal, place, np.array([[60.0, 60.0]]))


def views(plates: Plates, seed: int) -> tuple[View, View, RigidTransform]:
    rng = np.random.default_rng(seed)
    T_source_target = random_view(rng, turn_deg=10.0)
    target = scan_plates(plates, noise=0.3, rng=rng)
    source = scan_plates(move_plates(plates, T_source_target), noise=0.3, rng=rng)
    return describe(target, PARAMS), describe(source, PARAMS), T_source_target.inv()


def settled_at(target: View, source: View, T: RigidTransform, off_mm: float = 0.0) -> list[Settled]:
    r, t = T.rotation.as_matrix()[None], np.asarray(T.translation)[None] + off_mm * ALONG
    return settle_best(target, source, r, t, PARAMS, look_again=False)


def sliding_and_fixed(thing: Plates, seed: int) -> tuple[View, View, Settled, Settled]:
    target, source, T = views(room(thing), seed)
    (slid,), (fixed,) = settled_at(target, source, T, OFF_MM), settled_at(target, source, T)
    assert agreeing_planes(fixed, target, DECISION) > agreeing_planes(slid, target, DECISION)
    return target, source, slid, fixed


@pytest.mark.parametrize("seed", range(3))
def test_what_many_planes_fix_goes_before_what_slides_on_a_little_more_surface(seed: int) -> None:
    def first(*poses: Settled) -> Settled:
        ordered = fixed_first([*poses], target, source, DECISION)
        assert {id(pose) for pose in ordered} == {id(pose) for pose in poses}
        return ordered[0]

    target, source, slid, fixed = sliding_and_fixed(cube(), seed)
    more = slid._replace(score=1.2 * fixed.score)
    assert first(more, fixed) is fixed
    much_more = slid._replace(score=1.5 * fixed.score)
    assert first(much_more, fixed) is much_more
    assert first(fixed, slid) is fixed
    denied = fixed._replace(areas=np.array([fixed.areas[0], 0.2 * fixed.areas[0]]))
    assert first(more, denied) is more  # which puts too much in free space to be an answer
    vague = fixed._replace(sure=slid.sure, information=slid.information)
    assert first(more, vague) is more
    few = fixed._replace(pairs=slid.pairs, distance2=slid.distance2)
    assert first(more, few) is more
    target, source, slid, fixed = sliding_and_fixed(board(), seed)
    more = slid._replace(score=1.2 * fixed.score)
    assert first(more, fixed) is more  # three planes are those of any corner


@pytest.mark.parametrize("seed", range(3))
def test_what_slides_questions_an_answer_unless_many_planes_agree_on_it(seed: int) -> None:
    for thing, questioned in ((board(), True), (cube(), False)):
        target, source, slid, fixed = sliding_and_fixed(thing, seed)
        rival = slid._replace(score=0.5 * fixed.score)
        assert is_rival(rival, fixed, target, DECISION, appeal=True) is questioned
        status = judge([fixed, rival], target, source, DECISION, appeal=True).status
        assert status == ("ambiguous" if questioned else "ok")
        # One that as many planes agree on is another place, whatever the number.
        alike = fixed._replace(score=rival.score, shift_mm=fixed.shift_mm + OFF_MM * ALONG)
        assert is_rival(alike, fixed, target, DECISION, appeal=True)


@pytest.mark.parametrize("seed", range(3))
def test_what_scores_more_leaves_an_answer_in_doubt_that_more_planes_fix(seed: int) -> None:
    target, source, slid, fixed = sliding_and_fixed(cube(), seed)
    silent = replace(PARAMS, outlines=replace(PARAMS.outlines, least=1_000_000))
    more = slid._replace(score=1.2 * fixed.score)
    poses, verdict, _ = judged([more, fixed], target, source, 0.0, silent)
    assert np.linalg.norm(poses[0].shift_mm - fixed.shift_mm) < 1.0
    assert verdict.status == "ambiguous"
    assert "another, which leaves a direction open" in verdict.reason
