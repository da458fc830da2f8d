"""Scans of a flat target at known places, as for the precision analysis of section 3.2.3."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from registration.calibration_fit import TargetScan
from scenes.flat_target import FlatTargetParams, flat_target
from sensors.paths import aimed_view, straight_line
from sensors.sensor import Sensor

# Larger than any field, tilted or not: a real target is carried along instead.
BOARD = FlatTargetParams(width_mm=8000.0, height_mm=8000.0)


def scan_target(
    sensor: Sensor,
    depth_mm: float,
    yaw_rad: float,
    pitch_rad: float,
    profiles: int,
    step_mm: float,
    rng: np.random.Generator,
) -> TargetScan:
    """Scan the board from this depth Z at the middle of the field.

    yaw_rad: turns the sensor about its X, the direction of motion; pitch_rad: about its Y. With
    both 0 the board is parallel to X and Y, as in figure 3.9.
    """
    board = flat_target(BOARD)
    front = next(surface for surface in board.surfaces if surface.name == "board.front")
    view = aimed_view([0.0, 0.0, 0.0], depth_mm, yaw_rad, pitch_rad, 0.0, profiles, step_mm)
    path = straight_line(view, profiles, step_mm)
    T_view_world = path.T_world_view.inv()
    normal = T_view_world.rotation.apply(front.normal)
    offset_mm = float(normal @ T_view_world.apply(1000.0 * front.polygon_m.mean(axis=0)))
    return TargetScan(sensor.scan(board, path, rng), normal, offset_mm)


def as_told(
    target: TargetScan, placement_mm: float, placement_deg: float, rng: np.random.Generator
) -> TargetScan:
    """The same scan with the place of the target as a bench tells it: not quite where it stood.

    placement_mm, placement_deg: standard deviations of its distance where it crosses the sensor's
    Z, and of its turn about either axis in its plane.
    """
    middle_mm = np.array([0.0, 0.0, target.offset_mm / target.normal[2]])
    across = np.cross(target.normal, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    tilts_rad = np.radians(placement_deg) * rng.standard_normal(2)
    turn = Rotation.from_rotvec(tilts_rad @ np.array([across, np.cross(target.normal, across)]))
    normal = turn.apply(target.normal)
    offset_mm = float(normal @ middle_mm) + placement_mm * float(rng.standard_normal())
    return TargetScan(target.scan, normal, offset_mm)
