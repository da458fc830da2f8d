"""Numbers that stand for no return, and wild points: they are left out, or told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_scans import (
    APEX_BEHIND_MM,
    Pair,
    clutter_pair,
    join,
    plates_from,
    random_clutter,
    scan_plates,
)

from registration import Scan, register
from registration.gauss_sphere.fan.beams import Fan, fan_of, measured, seems_turned_around


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
    "mark", [0.0, -300.0, 99999.0, [0.0, 0.0, -9999.0], [3e3, 0.0, 900.0], [-50.0, 10.0, 1e7]]
)
def test_a_mark_of_no_return_is_none(pair: Pair, mark: float | list[float], number: int) -> None:
    where = some_of(pair.target, number)
    assert_same(
        fan_of(measured(marked(pair.target, where, mark))),
        fan_of(measured(marked(pair.target, where, np.nan))),
    )


@pytest.mark.parametrize("z_mm", [-9999.0, -300.0, -100.0, 0.0, 5000.0, 99999.0])
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


@pytest.mark.parametrize("share", [0.5, 0.6, 0.75])
@pytest.mark.parametrize("mark", [[0.0, 0.0, -9999.0], [0.0, 0.0, 99999.0], [-9999.0] * 3])
def test_marks_may_outnumber_points(pair: Pair, mark: list[float], share: float) -> None:
    where = np.random.default_rng(7).random(pair.target.points_mm.shape[:2]) < share
    gaps = fan_of(measured(marked(pair.target, where, np.nan)))
    assert_same(fan_of(measured(marked(pair.target, where, mark))), gaps)
    assert np.isfinite(gaps.depth_mm).sum() == (~where & pair.target.valid).sum()


def test_a_far_surface_is_kept_behind_a_near_one_that_fills_most_of_the_view() -> None:
    near = plates_from(
        np.array([[0.0, 0.2, -1.0]]) / np.hypot(1.0, 0.2),
        np.array([[150.0, -60.0, 700.0]]),
        np.array([[400.0, 190.0]]),
    )
    normals = np.array([[0.0, -0.6, -0.8], [-0.6, 0.0, -0.8], [0.0, 0.0, -1.0]])
    places = np.array([[150.0, 700.0, 2600.0], [600.0, 600.0, 2700.0], [100.0, 500.0, 2900.0]])
    far = plates_from(normals, places, np.array([[900.0, 700.0]] * 3))
    scan = scan_plates(join(near, far), noise=0.5, rng=np.random.default_rng(4))
    depth_mm = fan_of(measured(scan)).depth_mm
    share = (depth_mm > 2000.0).sum() / np.isfinite(depth_mm).sum()
    assert 0.1 < share < 0.45
    assert np.isfinite(depth_mm).sum() >= scan.n_valid - 5


def test_pixels_of_any_number_tell_where_the_scene_lies(pair: Pair) -> None:
    # Every tenth of 1000 profiles of 999 pixels and one would be the same pixel each time.
    points_mm = np.full((100, 999, 3), np.nan)
    points_mm[:60, 1:257] = pair.target.points_mm
    plain = fan_of(measured(Scan.from_points(points_mm, 5.0)))
    points_mm[10:50:4, 300] = [0.0, 0.0, -9999.0]
    assert_same(plain, fan_of(measured(Scan.from_points(points_mm, 5.0))))


def test_views_of_an_array_are_taken(pair: Pair) -> None:
    thinned = pair.target.points_mm[:, ::2]
    assert_same(
        fan_of(measured(replace(pair.target, points_mm=thinned))),
        fan_of(measured(Scan.from_points(thinned, 5.0, apex_mm=pair.target.apex_mm))),
    )
    turned = np.asfortranarray(pair.target.points_mm)
    assert_same(
        fan_of(measured(replace(pair.target, points_mm=turned))), fan_of(measured(pair.target))
    )


def test_a_wild_point_behind_the_apex_is_left_out_in_a_frame_far_ahead_of_the_sensor() -> None:
    rng = np.random.default_rng(0)
    scan = scan_plates(random_clutter(rng), profiles=120, noise=1.0, rng=rng)
    points_mm = scan.points_mm - [0.0, 0.0, 2000.0]
    points_mm[1, 7] = [5.0, 0.0, -2000.0 - APEX_BEHIND_MM - 1.0]  # of a profile not looked at
    fan = fan_of(measured(replace(scan, points_mm=points_mm, apex_mm=None)))
    assert fan.apex_mm[2] == pytest.approx(-2000.0 - APEX_BEHIND_MM, abs=1e-6)
    assert np.isnan(fan.depth_mm[1, 7])


def test_a_surface_behind_the_apex_says_that_it_is_none(pair: Pair) -> None:
    where = np.zeros(pair.target.points_mm.shape[:2], np.bool_)
    where[20:30] = pair.target.valid[20:30]
    points_mm = pair.target.points_mm.copy()
    behind_mm = np.random.default_rng(9).uniform(340.0, 345.0, where.sum())
    points_mm[where, 2] = -APEX_BEHIND_MM - behind_mm
    fan = fan_of(measured(replace(pair.target, points_mm=points_mm, apex_mm=None)))
    assert fan.apex_mm[2] < -1e4
    assert np.isfinite(fan.depth_mm[where]).sum() >= where.sum() - 1  # the least may be a mark


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


def test_profiles_that_stand_at_one_x_are_told_where_no_plane_is_found(pair: Pair) -> None:
    unmoved = replace(pair.target, points_mm=pair.target.points_mm * [0.0, 1.0, 1.0])
    result = register(unmoved, pair.source)
    assert result.status == "failed"
    assert "all profiles lie at one X" in result.reason
    empty = Scan.from_points(np.full((5, 8, 3), np.nan), step_mm=5.0)
    assert "one X" not in register(empty, pair.source).reason


def test_beams_that_are_nearly_parallel_are_not_taken_for_turned_around() -> None:
    rng = np.random.default_rng(6)
    x, y = np.meshgrid(5.0 * np.arange(40), np.linspace(-80.0, 80.0, 120), indexing="ij")
    z = 600.0 + 15.0 * np.sin(x / 20.0) + 15.0 * np.cos(y / 15.0) + rng.normal(0.0, 0.05, x.shape)
    for seed in range(5):
        aside = np.random.default_rng(seed).normal(0.0, 0.02, y.shape)
        scan = Scan.from_points(np.stack([x, y + aside, z], axis=2), 5.0)
        assert not seems_turned_around(fan_of(measured(scan)))
