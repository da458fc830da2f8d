"""Poses whose planes fix them, but for a few that are taken for others a little beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import clutter_pair

from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.judging.misfits import without_misfits
from registration.gauss_sphere.judging.open_directions import open_directions_of
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.refinement.refine import distances2, likelihood
from registration.gauss_sphere.refinement.verification import CONTRADICTION, SUPPORT
from registration.gauss_sphere.view import View

PARAMS = GaussSphereParams()


def settled(seed: int) -> tuple[View, View, Settled]:
    pair = clutter_pair(seed, noise=1.0)
    target, source = (describe(scan, PARAMS) for scan in (pair.target, pair.source))
    T = pair.T_target_source
    r, t = T.rotation.as_matrix()[None], np.asarray(T.translation)[None]
    return target, source, settle_best(target, source, r, t, PARAMS, look_again=False)[0]


def with_false_pairs(pose: Settled, target: View, source: View, n: int) -> Settled:
    """The pose with more pairs, of planes that do not fit, and sure of nothing for it."""
    matched = {tuple(pair) for pair in pose.pairs}
    every = [(i, k) for i in range(target.patches.n_points.size)
             for k in range(source.patches.n_points.size) if (i, k) not in matched]  # fmt: skip
    pairs = np.concatenate([pose.pairs, np.array(every)[:n]])
    far = distances2(
        target.patches, source.patches, pairs, likelihood(PARAMS.refine), pose.floor_mm,
        pose.rotation, pose.shift_mm,
    )  # fmt: skip
    far[len(pose.pairs) :] = np.maximum(far[len(pose.pairs) :], 1e3)
    return pose._replace(pairs=pairs, distance2=far, sure=np.zeros((6, 6)))


@pytest.mark.parametrize("seed", range(3))
def test_pairs_that_do_not_fit_no_longer_leave_a_pose_open(seed: int) -> None:
    target, source, pose = settled(seed)
    assert not open_directions_of(pose, target, PARAMS.decision).size
    vague = with_false_pairs(pose, target, source, 2)
    fitting = without_misfits(vague, target, source, PARAMS)
    assert {tuple(pair) for pair in fitting.pairs} <= {tuple(pair) for pair in pose.pairs}
    assert not open_directions_of(fitting, target, PARAMS.decision).size
    np.testing.assert_allclose(fitting.rotation, pose.rotation, atol=1e-3)
    np.testing.assert_allclose(fitting.shift_mm, pose.shift_mm, atol=1.0)
    # No surer than the planes that fit make it.
    assert np.linalg.slogdet(fitting.sure)[1] <= np.linalg.slogdet(pose.sure)[1] + 1.0


def test_a_pose_that_moves_is_scored_where_it_goes() -> None:
    target, source, pose = settled(0)
    vague = with_false_pairs(pose, target, source, 2)
    away_mm = np.array([0.0, 5.0, 3.0])
    away = vague._replace(shift_mm=vague.shift_mm + away_mm, areas=np.zeros(2), score=0.0)
    fitting = without_misfits(away, target, source, PARAMS)
    assert fitting.score == pytest.approx(pose.score, rel=0.01)
    np.testing.assert_allclose(fitting.areas, pose.areas, rtol=0.01, atol=1.0)


def test_most_pairs_may_not_fit_where_nothing_is_in_free_space() -> None:
    target, source, pose = settled(0)
    many = with_false_pairs(pose, target, source, 2 * len(pose.pairs))
    plain = many._replace(areas=np.where(np.arange(2) == CONTRADICTION, 0.0, pose.areas))
    fitting = without_misfits(plain, target, source, PARAMS)
    assert not open_directions_of(fitting, target, PARAMS.decision).size
    np.testing.assert_allclose(fitting.shift_mm, pose.shift_mm, atol=1.0)


def test_a_large_systematic_error_asks_for_most_pairs() -> None:
    target, source, pose = settled(0)
    coarse = replace(PARAMS, refine=replace(PARAMS.refine, floors_mm=(0.005, 0.5)))
    far = replace(coarse, refine=replace(coarse.refine, consistent_distance2=1e-9))
    plain = np.where(np.arange(2) == CONTRADICTION, 0.0, pose.areas)
    many = with_false_pairs(pose, target, source, 2 * len(pose.pairs))._replace(areas=plain)
    assert without_misfits(many, target, source, coarse) is not many
    assert without_misfits(many, target, source, far) is many  # only the larger one explains them
    few = with_false_pairs(pose, target, source, 2)._replace(areas=plain)
    assert without_misfits(few, target, source, far) is not few


def test_a_pose_stays_where_nothing_is_open_or_too_many_do_not_fit() -> None:
    target, source, pose = settled(0)
    assert without_misfits(pose, target, source, PARAMS) is pose
    against = 0.1 * pose.areas[SUPPORT]
    areas = np.where(np.arange(2) == CONTRADICTION, against, pose.areas)
    many = with_false_pairs(pose, target, source, len(pose.pairs))._replace(areas=areas)
    assert without_misfits(many, target, source, PARAMS) is many
    few = with_false_pairs(pose, target, source, 2)._replace(areas=areas)
    assert without_misfits(few, target, source, PARAMS) is not few
    more_asked = replace(PARAMS, decision=replace(PARAMS.decision, sure_planes=100))
    assert without_misfits(few, target, source, more_asked) is few
