"""Numbers that stand for no return, and wild points: they are left out, or told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import APEX_BEHIND_MM, Pair, clutter_pair

from registration import Scan, register
from registration.gauss_sphere.beams import Fan, fan_of


@pytest.fixture(scope="module")
def pair() -> Pair:
    return clutter_pair(3, noise=1.0)


def marked(scan: Scan, where: np.ndarray, mark: float | list[float]) -> Scan:
    points_mm = scan.points_mm.copy()
    points_mm[where] = mark
    return replace(scan, points_mm=points_mm, apex_mm=None)


def some_of(scan: Scan, number: int, seed: int = 0) -> np.ndarray:
    """(profiles, pixels) with so many of the measured points."""
    rng, where = np.random.default_rng(seed), np.zeros(scan.points_mm.shape[:2], np.bool_)
    places = np.flatnonzero(scan.valid)
    where.flat[rng.choice(places, number, replace=False)] = True
    return where


def assert_same(one: Fan, other: Fan) -> None:
    for name, a, b in zip(Fan._fields, one, other, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


@pytest.mark.parametrize("number", [1, 20, 4000])
@pytest.mark.parametrize(
    "mark", [0.0, -9999.0, 99999.0, [0.0, 0.0, -9999.0], [3e3, 0.0, 900.0], [-50.0, 10.0, 1e7]]
)
def test_a_mark_of_no_return_is_none(pair: Pair, mark: float | list[float], number: int) -> None:
    where = some_of(pair.target, number)
    assert_same(
        fan_of(marked(pair.target, where, mark)), fan_of(marked(pair.target, where, np.nan))
    )


@pytest.mark.parametrize("z_mm", [-9999.0, 0.0, 5000.0, 99999.0])
def test_one_wild_point_changes_nothing_but_itself(pair: Pair, z_mm: float) -> None:
    where = some_of(pair.target, 1)
    target = pair.target.points_mm.copy()
    target[where, 2] = z_mm
    result = register(replace(pair.target, points_mm=target, apex_mm=None), pair.source)
    plain = register(replace(pair.target, apex_mm=None), pair.source)
    assert result.status == plain.status == "ok"
    off = (result.T_target_source * plain.T_target_source.inv()).as_matrix() - np.eye(4)
    assert abs(off[:3, :3]).max() < 1e-3
    assert abs(off[:3, 3]).max() < 0.5


@pytest.mark.parametrize("z_mm", [-9999.0, 99999.0])
def test_marks_may_outnumber_points(pair: Pair, z_mm: float) -> None:
    where = np.random.default_rng(7).random(pair.target.points_mm.shape[:2]) < 0.6
    marks, gaps = (marked(pair.target, where, [0.0, 0.0, mark]) for mark in (z_mm, np.nan))
    assert where.sum() > (~where & pair.target.valid).sum()
    np.testing.assert_array_equal(fan_of(marks).depth_mm, fan_of(gaps).depth_mm)


def test_few_points_behind_the_apex_are_left_out_many_say_that_it_is_none(pair: Pair) -> None:
    scan = replace(pair.target, apex_mm=None)
    depth_mm = fan_of(scan).depth_mm
    for number, few in ((3, True), (scan.n_valid // 20, False)):
        where = some_of(scan, number)
        fan = fan_of(marked(scan, where, [0.0, 5.0, -APEX_BEHIND_MM - 40.0]))
        assert np.isnan(fan.depth_mm[where]).all() == few
        assert (fan.apex_mm[2] > -1e4) == few
        if few:
            np.testing.assert_allclose(fan.depth_mm[~where], depth_mm[~where], rtol=0.02)


def test_profiles_with_next_to_no_return_are_as_ones_not_taken(pair: Pair) -> None:
    lost, rng = np.arange(2, 58, 3), np.random.default_rng(5)
    scans = []
    for scan in (pair.target, pair.source):
        points_mm = scan.points_mm.copy()
        for p in lost:
            kept = rng.choice(np.flatnonzero(scan.valid[p]), 3, replace=False)
            points_mm[p, np.delete(np.arange(points_mm.shape[1]), kept)] = np.nan
        scans.append((replace(scan, points_mm=points_mm), np.delete(scan.points_mm, lost, axis=0)))
    nearly_empty = register(*(scan for scan, _ in scans))
    closed = register(*(replace(scan, points_mm=taken) for scan, taken in scans))
    assert nearly_empty.status == closed.status == "ok"
    pose, same = (r.T_target_source.as_matrix() for r in (nearly_empty, closed))
    np.testing.assert_array_equal(pose, same)


def test_height_in_place_of_depth_is_told_where_no_answer_is_found(pair: Pair) -> None:
    turned = [1.0, -1.0, -1.0]
    unrelated = clutter_pair(11, noise=1.0)
    heights = [replace(s, points_mm=s.points_mm * turned + [0.0, 0.0, 1300.0], apex_mm=None)
               for s in (pair.target, unrelated.source)]  # fmt: skip
    depths = [replace(s, apex_mm=None) for s in (pair.target, unrelated.source)]
    assert any("Z is height" in note for note in register(*heights).notes)
    assert not any("Z is height" in note for note in register(*depths).notes)
