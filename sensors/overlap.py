"""How much two views have in common, counted exactly on the surfaces."""

from __future__ import annotations

import numpy as np

from registration.scan import BoolArray, FloatArray, IntArray
from scenes.rays import cast_rays
from scenes.scene import Scene
from sensors.paths import ViewPath
from sensors.sensor import Sensor


def seen(
    sensor: Sensor, scene: Scene, path: ViewPath, points_mm: FloatArray, surface: IntArray
) -> BoolArray:
    """Whether a view sees each point: in its swept field and range, and not occluded.

    points_mm: (n, 3) world coordinates on the scene's surfaces; surface: (n,) index of each.
    The field is taken as swept without gaps: a point between two profiles is looked at from the
    nearer one, and the sweep ends half a step beyond the first and the last profile.
    """
    profile, x_mm = _nearest_profile(path, points_mm)
    local_mm = path.T_world_profile[profile].inv().apply(points_mm)
    # Between profiles the field has no gaps, however unevenly the sensor stepped.
    steps = x_mm / (path.step_mm * path.travel[0])
    beyond = (profile == 0) & (steps < -0.5)
    beyond |= (profile == path.profiles - 1) & (steps > 0.5)
    inside: BoolArray = ~beyond & sensor.in_field(local_mm)
    chosen = np.flatnonzero(inside)
    chosen = chosen[np.argsort(profile[chosen], kind="stable")]
    apexes_mm = path.T_world_profile.apply(sensor.apex_mm)
    rays_mm = points_mm[chosen] - apexes_mm[profile[chosen]]
    # In units of the ray's length the point itself is at distance 1.
    distance, met = cast_rays(scene, apexes_mm / 1000.0, rays_mm / 1000.0, profile[chosen])
    # A ray at the very edge of a face may meet the neighbour that shares the edge.
    inside[chosen] = (met == surface[chosen]) | (np.abs(distance - 1.0) < 1e-9)
    return inside


def _nearest_profile(path: ViewPath, points_mm: FloatArray) -> tuple[IntArray, FloatArray]:
    """The profile whose plane is nearest to each point, and the point's X in its frame."""
    along = path.T_world_profile.rotation.as_matrix()[:, :, 0]
    offset_mm = np.einsum("ki,ki->k", along, path.T_world_profile.translation)
    profile = np.empty(len(points_mm), dtype=np.int64)
    for first in range(0, len(points_mm), 1024):  # in blocks that stay in the processor's cache
        block = slice(first, first + 1024)
        profile[block] = np.abs(points_mm[block] @ along.T - offset_mm).argmin(axis=1)
    x_mm = np.einsum("ni,ni->n", points_mm, along[profile]) - offset_mm[profile]
    return profile, x_mm
