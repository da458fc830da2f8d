"""Poses that put a whole plane of one view where the other saw free space."""

from __future__ import annotations

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
)
from scipy.spatial.transform import RigidTransform

from registration import register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.free_planes import has_free_plane
from registration.gauss_sphere.matching import Settled, settle_best
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.view import View

PARAMS = GaussSphereParams()


def stairs_with_panels(seed: int) -> Pair:
    """Stairs along the room's Y, no two steps alike, and two panels across them."""
    up, along, away = np.eye(3)
    tread, riser, side = (away, along, up), (up, along, -away), (up, away, -along)
    plates = [
        ([-20.0, 150.0, -60.0], side, [60.0, 70.0]),
        ([60.0, -140.0, -40.0], side, [35.0, 45.0]),
    ]
    x, z = -110.0, -60.0
    for rise, run in ((30.0, 70.0), (52.0, 34.0), (41.0, 58.0), (64.0, 45.0)):
        plates.append(([x, 0.0, z + 0.5 * run], tread, [0.5 * run, 900.0]))
        plates.append(([x + 0.5 * rise, 0.0, z + run], riser, [0.5 * rise, 900.0]))
        x, z = x + rise, z + run
    centres, axes, halves = zip(*plates, strict=True)
    turned = ROOM.apply(np.array(axes).reshape(-1, 3)).reshape(-1, 3, 3)
    scene = Plates(MIDDLE + ROOM.apply(centres), turned, np.array(halves))
    rng = np.random.default_rng(seed)
    T_source_target = random_view(rng, turn_deg=12.0)
    target, source = (
        scan_plates(each, profiles=90, step_mm=3.0, noise=1.0, rng=rng)
        for each in (scene, move_plates(scene, T_source_target))
    )
    return Pair(target, source, T_source_target.inv())


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
