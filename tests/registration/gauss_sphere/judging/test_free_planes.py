"""Poses that put a whole plane of one view where the other saw free space."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import (
    ROOM,
    Pair,
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
from registration.gauss_sphere.judging.free_planes import has_free_plane
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.view import View

PARAMS = GaussSphereParams()


def stairs_with_panels(seed: int) -> Pair:
    """Stairs with two panels across them."""
    large = ([-20.0, 150.0, -60.0], "side", [60.0, 70.0])
    small = ([60.0, -140.0, -40.0], "side", [35.0, 45.0])
    return stairs_pair(stairs(large, small), seed)


def described(pair: Pair) -> tuple[View, View]:
    return describe(pair.target, PARAMS), describe(pair.source, PARAMS)


def at(T: RigidTransform, target: View, source: View) -> Settled:
    r, t = T.rotation.as_matrix(), np.asarray(T.translation)
    settled = settle_best(target, source, r[None], t[None], PARAMS, look_again=False)[0]
    return settled._replace(rotation=np.ascontiguousarray(r), shift_mm=t)


@pytest.mark.parametrize("seed", range(8))
def test_the_true_pose_puts_no_plane_in_free_space(seed: int) -> None:
    for pair in (clutter_pair(seed, noise=1.0), stairs_with_panels(seed)):
        target, source = described(pair)
        assert not has_free_plane(at(pair.T_target_source, target, source), target, source, PARAMS)


@pytest.mark.parametrize("off_mm", [-70.0, 70.0])
def test_a_pose_slid_along_stairs_puts_a_panel_there_from_either_view(off_mm: float) -> None:
    pair = stairs_with_panels(0)
    target, source = described(pair)
    pose = at(pair.T_target_source, target, source)
    slid = pose._replace(shift_mm=pose.shift_mm + off_mm * ROOM.apply([0.0, 1.0, 0.0]))
    assert has_free_plane(slid, target, source, PARAMS)
    back = slid._replace(rotation=slid.rotation.T.copy(), shift_mm=-slid.rotation.T @ slid.shift_mm)
    assert has_free_plane(back, source, target, PARAMS)


@pytest.mark.parametrize("seed", range(4))
def test_poses_slid_along_stairs_are_no_rivals_where_a_panel_stands_across(seed: int) -> None:
    pair = stairs_with_panels(seed)
    result = register(pair.target, pair.source)
    assert result.status == "ok", result.reason
    turn_deg, off_mm = pose_error(result.T_target_source, pair.T_target_source)
    assert turn_deg < 0.1
    assert off_mm < 2.0


@pytest.mark.parametrize(("moved_mm", "seed"), [(4.0, 8), (7.0, 5), (7.0, 6)])
def test_a_panel_that_was_moved_does_not_rule_out_the_best_pose(moved_mm: float, seed: int) -> None:
    """A small one stands a little elsewhere later on; two others lie alike, 170 mm apart."""
    others = [([-20.0, 150.0, -60.0], "side", [60.0, 70.0])]
    others.append(([-70.0, -20.0, -95.0], "side", [30.0, 40.0]))
    rng = np.random.default_rng(seed)
    T_source_target = random_view(rng, turn_deg=12.0)
    before, after = (
        stairs(*others, ([60.0, y, -40.0], "side", [35.0, 45.0]))
        for y in (-140.0, moved_mm - 140.0)
    )
    target, source = (
        scan_plates(each, profiles=90, step_mm=3.0, noise=0.3, rng=rng)
        for each in (before, move_plates(after, T_source_target))
    )
    pair = Pair(target, source, T_source_target.inv())
    views = described(pair)
    assert has_free_plane(at(pair.T_target_source, *views), *views, PARAMS)
    result = register(pair.target, pair.source)
    assert result.status in ("ok", "ambiguous")
    turn_deg, off_mm = pose_error(result.T_target_source, pair.T_target_source)
    assert turn_deg < 0.5
    assert off_mm < 5.0
