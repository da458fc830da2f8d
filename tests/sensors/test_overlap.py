import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from seen_share import overlap

from scenes import SCENES
from scenes.flat_target import FlatTargetParams, flat_target
from scenes.scene import Scene
from scenes.solids import assemble, box
from sensors.jupiter import Jupiter, JupiterParams
from sensors.overlap import seen
from sensors.paths import ViewPath, aimed_view, straight_line

SENSOR = Jupiter()
BOARD = flat_target(FlatTargetParams(width_mm=2000.0, height_mm=2000.0))
DISTANCE_MM = 800.0


def _scene(name: str) -> Scene:
    builder, params_type = SCENES[name]
    return builder(params_type())


def _path(yaw_deg: float = 0.0, aim_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> ViewPath:
    view = aimed_view(aim_mm, DISTANCE_MM, np.radians(yaw_deg), 0.0, 0.0, 40, 5.0)
    return straight_line(view, 40, 5.0)


@pytest.mark.parametrize("name", SCENES)
def test_a_view_sees_all_of_what_it_measures(name: str) -> None:
    view = aimed_view([0.0, 0.0, 100.0], 900.0, 0.2, 0.4, 0.1, 30, 6.0)
    path = straight_line(view, 30, 6.0)
    assert overlap(SENSOR, _scene(name), path, path) == 1.0


@pytest.mark.parametrize("steps", [-40, -13, 0, 10, 39])
def test_along_the_motion_whole_profiles_are_shared(steps: int) -> None:
    shifted = _path(aim_mm=(0.0, 0.0, 5.0 * steps))
    expected = 1.0 - abs(steps) / 40.0
    assert overlap(SENSOR, BOARD, _path(), shifted) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("shift_mm", [0.0, 57.3, -200.0, 430.0])
def test_across_the_motion_the_points_inside_both_fields_are_shared(shift_mm: float) -> None:
    params = SENSOR.params
    y_mm = params.slopes * (DISTANCE_MM + params.apex_depth_mm)
    # The world's +Y is the sensor's left.
    inside = np.abs(y_mm + shift_mm) <= y_mm[-1] * (1.0 + 1e-9)
    share = overlap(SENSOR, BOARD, _path(), _path(aim_mm=(0.0, shift_mm, 0.0)))
    assert share == pytest.approx(inside.mean(), abs=1e-12)


def test_a_view_of_the_other_side_shares_nothing() -> None:
    assert overlap(SENSOR, BOARD, _path(), _path(yaw_deg=180.0)) == 0.0


def test_what_is_hidden_from_the_other_view_is_not_shared() -> None:
    wall = box("wall", [0.02, 2.0, 2.0], [0.0, 0.0, -1.0])
    screen = box("screen", [0.02, 0.3, 2.0], [-0.45, -0.30, -1.0])
    a, b = _path(), _path(yaw_deg=30.0)
    open_share = overlap(SENSOR, assemble("open", [wall]), a, b)
    hidden_share = overlap(SENSOR, assemble("hidden", [wall, screen]), a, b)
    # From 30 degrees to the right the screen stands before all that view a sees of the wall.
    assert open_share > 0.5
    assert hidden_share == 0.0


def test_range_limits_end_the_overlap() -> None:
    near = ViewPath(
        RigidTransform.from_translation([-700.0, 0.0, 0.0]) * _path().T_world_profile, 5.0
    )
    unlimited = Jupiter(JupiterParams(range_limits=False))
    assert overlap(unlimited, BOARD, _path(), near) == 1.0
    assert overlap(SENSOR, BOARD, _path(), near) == 0.0


def test_a_view_that_measures_nothing_overlaps_nothing() -> None:
    away = _path(yaw_deg=90.0, aim_mm=(-2000.0, 3000.0, 0.0))
    assert overlap(SENSOR, BOARD, away, _path()) == 0.0
    assert overlap(SENSOR, BOARD, _path(), away) == 0.0


def test_two_views_see_each_of_the_separated_planes_whole() -> None:
    scene = _scene("separated_planes")
    for yaw_deg, pitch_deg in ((0.0, 0.0), (-12.0, 8.0), (15.0, -5.0)):
        angles_rad = np.radians([yaw_deg, pitch_deg, 5.0])
        path = straight_line(aimed_view([0.0, 0.0, 0.0], 800.0, *angles_rad, 80, 5.0), 80, 5.0)
        for index, surface in enumerate(scene.surfaces):
            if not surface.name.endswith(".front"):
                continue
            inset = surface.polygon_m.mean(axis=0) * 1e-6 + surface.polygon_m * (1.0 - 1e-6)
            rim_m = np.concatenate(
                [np.linspace(a, b, 9) for a, b in zip(inset, np.roll(inset, -1, 0), strict=True)]
            )
            which = np.full(len(rim_m), index)
            assert seen(SENSOR, scene, path, 1000.0 * rim_m, which).all(), surface.name
