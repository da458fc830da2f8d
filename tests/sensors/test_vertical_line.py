"""A pitched sensor that moves along the vertical, as appendix B drives it."""

from __future__ import annotations

import numpy as np
import pytest
from seen_share import overlap

from registration import Scan, register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.fan.beams import fan_of, measured
from registration.gauss_sphere.params import GaussSphereParams
from registration.scan import ScanError
from scenes import SCENES
from scenes.scene import Scene
from sensors import f3, threedx
from sensors.arm import ArmParams, start_view, viewing_line
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import NoiseParams
from sensors.paths import LineError, ViewPath, aimed_view, straight_line, travel_of

SENSOR = Jupiter(JupiterParams(noise=NoiseParams(enabled=False)))
PROFILES, STEP_MM = 80, 5.0
LINES = [("sensor_x", "up"), ("vertical", "up"), ("vertical", "down")]


def _scene(name: str) -> Scene:
    return SCENES[name].builder(SCENES[name].params_type())


def _path(line: str, direction: str, yaw_deg: float, roll_deg: float = 0.0) -> ViewPath:
    angles_rad = np.deg2rad([yaw_deg, 25.0, roll_deg])
    size = PROFILES, STEP_MM
    view = aimed_view([0.0, 0.0, 100.0], 950.0, *angles_rad, *size, line, direction)
    return straight_line(view, *size, travel_of(view, line, direction))


@pytest.mark.parametrize(("line", "direction"), LINES)
def test_a_vertical_line_climbs_or_sinks_and_does_nothing_else(line: str, direction: str) -> None:
    path = _path(line, direction, 30.0, 10.0)
    steps_mm = np.diff(path.T_world_profile.translation, axis=0)
    assert np.linalg.norm(steps_mm, axis=1) == pytest.approx(STEP_MM)
    if line == "vertical":
        up = 1.0 if direction == "up" else -1.0
        assert steps_mm == pytest.approx(np.tile([0, 0, up * STEP_MM], (PROFILES - 1, 1)), abs=1e-9)


@pytest.mark.parametrize(("line", "direction"), LINES)
def test_a_scan_stands_where_the_sensor_was_and_does_not_shear(line: str, direction: str) -> None:
    scene, path = _scene("desk"), _path(line, direction, 15.0, 8.0)
    hits, scan = SENSOR.hits(scene, path), SENSOR.scan(scene, path, np.random.default_rng(0))
    np.testing.assert_allclose(scan.points_mm, hits.points_mm, atol=1e-9)
    np.testing.assert_allclose(scan.origins_mm, hits.origins_mm, atol=1e-9)
    # Every profile lies in its own laser plane, and its beams meet where the sensor's do.
    np.testing.assert_allclose(scan.in_profiles_mm[scan.valid][:, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(fan_of(measured(scan)).apex_mm, SENSOR.apex_mm, atol=1e-3)


@pytest.mark.parametrize("method", ["gauss_sphere", "thesis"])
@pytest.mark.parametrize(("line", "direction"), LINES)
def test_methods_find_the_pose_whichever_way_the_sensor_moved(
    method: str, line: str, direction: str
) -> None:
    # The thesis's shifts come from centroids, which are those of the same faces where both views
    # see them whole.
    scene = _scene("desk" if method == "gauss_sphere" else "separated_planes")
    paths = [_path(line, direction, yaw, roll) for yaw, roll in ((-4.0, 0.0), (5.0, 3.0))]
    target, source = (SENSOR.scan(scene, p, np.random.default_rng(0)) for p in paths)
    result = register(target, source, method)
    assert result.status == "ok", result.reason
    assert result.T_target_source is not None
    exact = paths[0].T_world_view.inv() * paths[1].T_world_view
    off = exact.inv() * result.T_target_source
    close_deg, close_mm = (1e-3, 1e-2) if method == "gauss_sphere" else (0.1, STEP_MM)
    assert np.rad2deg(off.rotation.magnitude()) < close_deg
    assert np.linalg.norm(off.translation) < close_mm


def test_views_that_moved_differently_register_to_each_other() -> None:
    scene = _scene("desk")
    paths = [_path(*LINES[0], -8.0), _path(*LINES[2], 9.0, 6.0)]
    target, source = (SENSOR.scan(scene, p, np.random.default_rng(0)) for p in paths)
    result = register(target, source)
    assert result.T_target_source is not None
    off = result.T_target_source.inv() * paths[0].T_world_view.inv() * paths[1].T_world_view
    assert np.rad2deg(off.rotation.magnitude()) < 1e-3
    assert np.linalg.norm(off.translation) < 1e-2


@pytest.mark.parametrize(("line", "direction"), LINES)
def test_planes_are_the_scene_s_own(line: str, direction: str) -> None:
    """Fitted patches lie on the exact faces, and their areas are those of the faces swept."""
    scene, path = _scene("desk"), _path(line, direction, 12.0, 7.0)
    scan = SENSOR.scan(scene, path, np.random.default_rng(0))
    hits = SENSOR.hits(scene, path)
    view = describe(scan, GaussSphereParams())
    patches = view.patches
    assert len(patches.n_points) >= 5
    for i in range(5):
        on = patches.label == i
        np.testing.assert_allclose(hits.normal[on] @ patches.normal[i], 1.0, atol=1e-9)
        np.testing.assert_allclose(scan.points_mm[on] @ patches.normal[i], patches.offset_mm[i])
        # What a beam stands for, between those beside and below it; area_mm2 takes the spacing of
        # the beams as even, which widens by a tenth from the middle of the field to its edges.
        corner, right, below = scan.points_mm[:-1, :-1], scan.points_mm[:-1, 1:], scan.points_mm[1:]
        cells = np.cross(right - corner, below[:, :-1] - corner)
        whole = on[:-1, :-1] & on[:-1, 1:] & on[1:, :-1]
        area_mm2 = np.linalg.norm(cells[whole], axis=1).mean() * on.sum()
        assert patches.area_mm2[i] == pytest.approx(area_mm2, rel=0.1)
    fan = fan_of(measured(scan))
    assert fan.lean == pytest.approx(scan.travel[1:] / scan.travel[0])


def test_overlap_sweeps_the_same_space_in_both_directions() -> None:
    scene = _scene("desk")
    other = _path("vertical", "up", -10.0)
    shares = [overlap(SENSOR, scene, _path("vertical", d, 5.0), other) for d in ("up", "down")]
    assert 0.2 < shares[0] < 1.0
    assert shares[0] == pytest.approx(shares[1], abs=1e-3)


def test_the_arm_drives_the_vertical_and_the_scan_shears_by_the_bracket_alone() -> None:
    angles_rad = np.deg2rad([0.0, 25.0, 0.0])
    view = aimed_view([0, 0, 120], 1030.0, *angles_rad, 60, 5.0, "vertical", "up")
    travel = travel_of(view, "vertical", "up")
    turn_deg = (0.2, -0.3, 0.1)
    for bracket_deg, off_deg in (((0.0, 0.0, 0.0), 0.0), (turn_deg, None)):
        path = viewing_line(view, 60, 5.0, ArmParams(bracket_deg=bracket_deg), travel=travel)
        climbs_mm = path.T_world_encoder.translation[-1] - path.T_world_encoder.translation[0]
        assert climbs_mm == pytest.approx([0.0, 0.0, 295.0], abs=0.15)
        assert path.travel == pytest.approx(travel)
        moved = (path.T_world_view.inv() * path.T_world_profile[-1]).translation
        angle_deg = np.rad2deg(np.arccos(np.clip(moved @ travel / np.linalg.norm(moved), -1, 1)))
        most_deg = 0.03 if off_deg == 0.0 else float(np.linalg.norm(turn_deg)) + 0.03
        assert angle_deg <= most_deg


def test_start_view_is_where_the_joints_hold_the_sensor() -> None:
    view = aimed_view([0, 0, 120], 1030.0, *np.deg2rad([0.0, 25.0, 0.0]), 2, 5.0)
    path = viewing_line(view, 2, 5.0, ArmParams())
    joints = f3.from_pulses(path.counts)[0]
    T_world_sensor = start_view(np.rad2deg(joints[1:]).tolist(), joints[0], ArmParams())
    np.testing.assert_allclose(
        T_world_sensor.as_matrix(), path.T_world_encoder_view.as_matrix(), atol=1e-9
    )


def test_a_laser_plane_that_stands_upright_cannot_be_moved_along_the_vertical() -> None:
    view = aimed_view([0, 0, 0], 900.0, 0.0, 0.0, np.deg2rad(90.0), 2, 5.0)
    with pytest.raises(LineError, match="laser plane of the sensor is nearly upright"):
        travel_of(view, "vertical", "up")


@pytest.mark.parametrize("travel", [[0, 0, 0], [0.0, 0.0, 1.0], [1, 0], [np.nan, 0, 0]])
def test_a_scan_refuses_a_motion_that_sweeps_nothing(travel: list[float]) -> None:
    with pytest.raises(ScanError, match=r"travel is .*; expected three numbers"):
        Scan.from_points(np.zeros((2, 2, 3)), 5.0, travel=travel)


def test_travel_is_a_unit_vector_that_nobody_can_change() -> None:
    scan = Scan.from_points(np.zeros((3, 2, 3)), 5.0, travel=[3.0, 0.0, -4.0])
    np.testing.assert_allclose(scan.travel, [0.6, 0.0, -0.8])
    np.testing.assert_allclose(scan.origins_mm[2], [6.0, 0.0, -8.0])
    assert not scan.travel.flags.writeable


def test_a_file_keeps_profiles_however_they_moved() -> None:
    scene, path = _scene("desk"), _path("vertical", "up", 10.0, 5.0)
    scan = SENSOR.scan(scene, path, np.random.default_rng(0))
    again = threedx.to_scan(threedx.from_scan(scan), STEP_MM, scan.travel)
    np.testing.assert_allclose(again.points_mm, scan.points_mm, atol=0.0501)
