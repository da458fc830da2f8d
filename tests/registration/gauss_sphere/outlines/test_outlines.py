"""Outlines of faces, and what they decide where planes leave a pose in doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import (
    MIDDLE,
    ROOM,
    Pair,
    Plates,
    join,
    move_plates,
    plates_from,
    pose_error,
    random_view,
    scan_plates,
)
from scipy.spatial.transform import RigidTransform

from registration import RegistrationResult, register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.appeal import _fixed, appealed
from registration.gauss_sphere.judging.open_directions import uncertainty
from registration.gauss_sphere.outlines.ends import as_ends, ends_of
from registration.gauss_sphere.outlines.placing import STEPS_MM, placed, placed_by_some
from registration.gauss_sphere.outlines.telling import outlines_of
from registration.gauss_sphere.outlines.testimony import said
from registration.gauss_sphere.params import DecisionParams, GaussSphereParams, OutlineParams
from registration.gauss_sphere.refinement.chance import take_chance
from registration.gauss_sphere.refinement.matching import settle_best
from registration.gauss_sphere.refinement.refine import likelihood, widened

HOW = OutlineParams()
ALONE = [0, 1, 7]  # floor, wall and one slat near the middle
BLIND = GaussSphereParams(outlines=OutlineParams(least=10**9))


def boards(rng: np.random.Generator) -> Plates:
    """Floor and wall, which meet along the room's Y, and boards parallel to them that end in Y."""
    normals = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    places = [[-90.0, 0.0, -100.0], [100.0, 0.0, 170.0]]
    halves = [[400.0, 500.0], [400.0, 500.0]]
    for k in range(3):
        normals += [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
        y, z = rng.uniform(-40.0, 40.0), rng.uniform(-70.0, 60.0)
        places += [[60.0 - 50.0 * k, y + 90.0 * (k - 1), z], [30.0, y + 90.0 * (k - 1), z - 60.0]]
        halves += [[40.0, rng.uniform(25.0, 45.0)], [50.0, rng.uniform(25.0, 45.0)]]
    at = MIDDLE + ROOM.apply(places)
    return plates_from(ROOM.apply(normals), at, np.array(halves))


def pair_of(plates: Plates, rng: np.random.Generator) -> Pair:
    T_source_target = random_view(rng, turn_deg=12.0)
    return Pair(
        scan_plates(plates, noise=1.0, rng=rng),
        scan_plates(move_plates(plates, T_source_target), noise=1.0, rng=rng),
        T_source_target.inv(),
    )


def off(pair: Pair, result: RegistrationResult) -> tuple[float, float]:
    T_exact, T = pair.T_target_source, result.T_target_source
    assert T is not None
    turn_deg, _ = pose_error(T, T_exact)
    return turn_deg, float(np.linalg.norm(T.apply(T_exact.inv().apply(MIDDLE)) - MIDDLE))


def test_outlines_lie_where_a_face_ends_and_point_away_from_it() -> None:
    plates = join(
        plates_from(np.array([[0.0, 0.0, -1.0]]), np.array([[150.0, 0.0, 800.0]]),
                    np.array([[62.5, 80.0]])),
        plates_from(np.array([[0.0, 0.0, -1.0]]), np.array([[150.0, 0.0, 1000.0]]),
                    np.array([[400.0, 400.0]])),
    )  # fmt: skip
    view = describe(
        scan_plates(plates, noise=0.3, rng=np.random.default_rng(3)), GaussSphereParams()
    )
    seen = outlines_of(view, HOW)
    away = seen.point_mm - [150.0, 0.0, 800.0]
    assert seen.line.size > 60
    # The sides across the travel lie midway between two profiles; beams are 1.6 mm apart.
    past = (seen.outward * away).sum(axis=1) - np.abs(seen.outward @ [62.5, 0, 0])
    past -= np.abs(seen.outward @ [0.0, 80.0, 0.0])
    along_a_side = np.abs(seen.outward).max(axis=1) > 0.99
    assert np.mean(along_a_side) > 0.8
    assert np.abs(past[along_a_side]).max() < 2.0
    assert np.abs(np.median(past[along_a_side])) < 1.0


def test_more_ends_of_faces_than_there_was_room_for_at_first_are_all_found() -> None:
    plates = boards(np.random.default_rng(0))
    some, many = (
        describe(scan_plates(plates, profiles=n, step_mm=300.0 / n), GaussSphereParams())
        for n in (60, 1200)
    )
    how = HOW.behind_mm, HOW.missing_pixels, 1
    few, ends = (ends_of(view.fan, view.patches, *how) for view in (some, many))
    # Along profiles there are as many more ends as there are more profiles.
    assert len(few.point_mm) < 1024 < 2048 < len(ends.point_mm)
    for unit in (ends.outward, ends.normal):
        np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1.0)
    assert np.abs((ends.outward * ends.normal).sum(axis=1)).max() < 1e-9
    on_planes = np.abs(ends.point_mm @ many.patches.normal.T - many.patches.offset_mm).min(axis=1)
    assert on_planes.max() < 1e-6


def test_columns_that_never_return_do_not_cost_the_others_their_outlines() -> None:
    rng = np.random.default_rng(0)
    scan = scan_plates(boards(rng), noise=1.0, rng=rng)
    points_mm = scan.points_mm.copy()
    points_mm[:, :3] = points_mm[:, -3:] = np.nan
    whole, cut = (
        outlines_of(describe(each, GaussSphereParams()), HOW)
        for each in (scan, replace(scan, points_mm=points_mm))
    )
    assert cut.line.size > 0.8 * whole.line.size > 0


def test_of_very_many_outlines_some_from_all_over_are_asked() -> None:
    rng = np.random.default_rng(0)
    view = describe(scan_plates(boards(rng), noise=1.0, rng=rng), GaussSphereParams())
    every, some = outlines_of(view, HOW), outlines_of(view, replace(HOW, most_points=50))
    assert 25 <= some.line.size <= 50 < every.line.size
    assert set(some.line) >= {n for n in set(every.line) if (every.line == n).sum() > 20}


@pytest.mark.parametrize("seed", range(4))
def test_views_confirm_outlines_under_the_true_pose_and_deny_them_beside_it(seed: int) -> None:
    pair = pair_of(boards(np.random.default_rng(seed)), np.random.default_rng(seed))
    target, source = (describe(scan, GaussSphereParams()) for scan in (pair.target, pair.source))
    T = pair.T_target_source
    ends = as_ends(outlines_of(target, HOW)), as_ends(outlines_of(source, HOW))

    def words(shift_mm: float) -> tuple[int, int]:
        r = np.ascontiguousarray(T.rotation.as_matrix())
        t = np.asarray(T.translation) + shift_mm * ROOM.apply([0.0, 1.0, 0.0])
        return said(r, t, target, source, ends, HOW)

    confirmed, denied = words(0.0)
    assert confirmed > 50
    assert denied < 0.05 * confirmed
    confirmed, denied = words(30.0)
    assert denied > 0.3 * confirmed


@pytest.mark.parametrize("off_mm", [-21.0, 18.0])
@pytest.mark.parametrize("seed", range(4))
def test_ends_of_faces_place_a_pose_where_planes_leave_it_open(seed: int, off_mm: float) -> None:
    pair = pair_of(boards(np.random.default_rng(seed)), np.random.default_rng(seed))
    target, source = (describe(scan, GaussSphereParams()) for scan in (pair.target, pair.source))
    r = np.ascontiguousarray(pair.T_target_source.rotation.as_matrix())
    open_way, other = ROOM.apply([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    exact = np.asarray(pair.T_target_source.translation)
    start, along = exact + off_mm * open_way, np.array([open_way, other])
    ends = as_ends(outlines_of(target, HOW)), as_ends(outlines_of(source, HOW))
    before = said(r, start, target, source, ends, HOW)

    given = start.copy()
    there, *words = placed(target, source, ends, r, start, along, HOW)

    np.testing.assert_array_equal(start, given)
    assert tuple(words) == said(r, there, target, source, ends, HOW)
    assert words[0] - words[1] > before[0] - before[1]
    # Ends tell places apart that are more than off_mm away from them, on either side.
    assert abs((there - exact) @ open_way) < HOW.off_mm + STEPS_MM[-1]


@pytest.mark.parametrize("seed", range(4))
def test_some_ends_of_faces_place_a_pose_as_all_do(seed: int) -> None:
    pair = pair_of(boards(np.random.default_rng(seed)), np.random.default_rng(seed))
    views = tuple(describe(scan, GaussSphereParams()) for scan in (pair.target, pair.source))
    r = np.ascontiguousarray(pair.T_target_source.rotation.as_matrix())
    along, how = ROOM.apply([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), (HOW.behind_mm, HOW.missing_pixels)
    some = tuple(ends_of(view.fan, view.patches, *how, HOW.every) for view in views)
    starts = np.asarray(pair.T_target_source.translation) + np.outer([-21.0, 0.0, 150.0], along[0])

    words, n_ends = placed_by_some(*views, np.array([r] * 3), starts, np.array([along] * 3), HOW)

    assert n_ends == sum(len(ends.point_mm) for ends in some)
    for t, (confirmed, denied, most) in zip(starts, words, strict=True):
        assert (confirmed, denied) == placed(*views, some, r, t, along, HOW)[1:]
        assert max(confirmed, said(r, t, *views, some, HOW)[0]) <= most <= n_ends


@pytest.mark.parametrize("seed", range(4))
def test_outlines_fix_the_shift_that_planes_leave_open(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pair = pair_of(boards(rng), rng)
    result = register(pair.target, pair.source)
    assert result.status == "ok", result.reason
    turn_deg, off_mm = off(pair, result)
    assert turn_deg < 0.5
    assert off_mm < 5.0
    error = pair.T_target_source * result.T_target_source.inv()
    step = np.concatenate([error.rotation.as_rotvec(), error.translation])
    assert step @ np.linalg.solve(result.covariance, step) < 22.5  # 99.9 % of six
    assert register(pair.target, pair.source, params=BLIND).status == "underdetermined"


def test_few_planes_on_little_surface_are_not_placed_by_outlines() -> None:
    rng = np.random.default_rng(0)
    pair, asked = pair_of(boards(rng), rng), DecisionParams(sure_planes=20, appeal_support=2.0)
    result = register(pair.target, pair.source, params=GaussSphereParams(decision=asked))
    assert result.status == "underdetermined"
    for enough in (replace(asked, sure_planes=2), replace(asked, appeal_support=0.3)):
        placed = register(pair.target, pair.source, params=GaussSphereParams(decision=enough))
        assert placed.status == "ok", placed.reason
    more_planes = replace(asked, appeal_support=0.3, appeal_planes=20)
    result = register(pair.target, pair.source, params=GaussSphereParams(decision=more_planes))
    assert result.status == "underdetermined"


def test_a_bias_of_the_planes_does_not_undo_what_outlines_fix() -> None:
    rng = np.random.default_rng(0)
    pair, params = pair_of(boards(rng), rng), GaussSphereParams()
    target, source = (describe(scan, params) for scan in (pair.target, pair.source))
    T = pair.T_target_source
    rotation, shift_mm = T.rotation.as_matrix()[None], np.asarray(T.translation)[None]
    settled = settle_best(target, source, rotation, shift_mm, params, look_again=False)
    outlines = outlines_of(target, params.outlines), outlines_of(source, params.outlines)
    exact, biased = (
        appealed(settled, target, source, outlines, bias_mm, params)[0] for bias_mm in (0.0, 3.0)
    )
    for pose in (exact, biased):
        assert not uncertainty(pose, pose.sure, target, params.decision)[1].size
    assert np.linalg.slogdet(biased.sure)[1] < np.linalg.slogdet(exact.sure)[1] - 2.0
    open_directions = uncertainty(settled[0], settled[0].sure, target, params.decision)[1]
    assert len(open_directions) == 1


def test_a_pose_of_which_nothing_is_known_stays() -> None:
    rng = np.random.default_rng(0)
    pair, params = pair_of(boards(rng), rng), GaussSphereParams()
    target, source = (describe(scan, params) for scan in (pair.target, pair.source))
    T = pair.T_target_source
    r, t = T.rotation.as_matrix(), np.asarray(T.translation)
    settled = settle_best(target, source, r[None], t[None], params, look_again=False)
    outlines = outlines_of(target, params.outlines), outlines_of(source, params.outlines)
    # Chance was larger than what its planes say, and no outlines lie on each other where it is.
    nothing = settled[0]._replace(sure=-np.eye(6), shift_mm=t + np.array([0.0, 5e3, 0.0]))
    assert _fixed(nothing, target, source, outlines, params) is nothing


def test_outlines_that_repeat_themselves_do_not_fix_it() -> None:
    y = np.arange(-440.0, 441.0, 80.0)
    slats = np.stack([0.0 * y, y, 0.0 * y + 60.0], axis=1)
    normals = np.concatenate([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], [[0.0, 0.0, -1.0]] * y.size])
    places = np.concatenate([[[-90.0, 0.0, -100.0], [100.0, 0.0, 170.0]], slats])
    halves = np.concatenate([[[400.0, 900.0]] * 2, [[70.0, 22.0]] * y.size])
    plates = plates_from(ROOM.apply(normals), MIDDLE + ROOM.apply(places), halves)
    for seed in range(3):
        pair = pair_of(plates, np.random.default_rng(seed))
        result = register(pair.target, pair.source)
        assert result.status in ("underdetermined", "ambiguous"), result.reason
        alone = plates_from(ROOM.apply(normals[ALONE]), plates.centre_mm[ALONE], halves[ALONE])
        single = pair_of(alone, np.random.default_rng(seed))
        assert register(single.target, single.source).status == "ok"


def test_chance_is_taken_under_the_systematic_error_that_the_information_has() -> None:
    rng = np.random.default_rng(5)
    angle = np.linspace(-1.2, 1.2, 15)
    normals = np.stack([0.5 * np.cos(3.0 * angle), np.sin(angle), -np.cos(angle)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    spread = np.stack([rng.uniform(-80, 80, 15), 130.0 * angle, rng.uniform(-60, 60, 15)], axis=1)
    plates = plates_from(normals, MIDDLE + spread, np.full((15, 2), 28.0))
    T = RigidTransform.identity()
    # In the other view each plate has moved by itself: the planes disagree.
    shaken = replace(plates, centre_mm=plates.centre_mm + rng.normal(0.0, 2.0, (15, 3)))
    params = GaussSphereParams()
    target, source = (
        describe(scan_plates(p, noise=0.5, rng=rng), params) for p in (plates, shaken)
    )
    rotation, shift_mm = T.as_matrix()[None, :3, :3].copy(), np.zeros((1, 3))
    (pose,) = settle_best(target, source, rotation, shift_mm, params, look_again=False)

    def left(of_wide: bool) -> np.ndarray:
        how = (target.patches, source.patches, pose.pairs, likelihood(params.refine))
        information = np.empty((6, 6))
        wide_mm = widened(*how, pose.floor_mm, pose.rotation, pose.shift_mm, information, 0.0)
        assert wide_mm > 2.0 * pose.floor_mm
        floor_mm = wide_mm if of_wide else pose.floor_mm
        take_chance(*how, floor_mm, pose.rotation, pose.shift_mm, information)
        return information

    np.testing.assert_allclose(pose.sure, left(of_wide=True), rtol=1e-9)
    assert np.linalg.eigvalsh(left(of_wide=True))[0] > 0.0
    assert not np.allclose(left(of_wide=False), left(of_wide=True), rtol=1e-6)
