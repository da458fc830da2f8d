"""How much two views have in common, counted exactly on the surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from registration.scan import FloatArray, IntArray
from scenes.rays import cast_fans
from scenes.scene import Scene
from sensors.jupiter import Jupiter
from sensors.paths import ViewPath


def overlap(sensor: Jupiter, scene: Scene, path_a: ViewPath, path_b: ViewPath) -> float:
    """Share of the points view a measures that view b sees too; 0 when a measures nothing.

    Free of noise: points are where the rays of view a meet the surfaces.
    """
    hits = sensor.hits(scene, path_a)
    measured = hits.valid
    if not measured.any():
        return 0.0
    points_mm = path_a.T_world_view.apply(hits.points_mm[measured])
    return float(seen(sensor, scene, path_b, points_mm, hits.surface[measured]).mean())


def seen(
    sensor: Jupiter, scene: Scene, path: ViewPath, points_mm: FloatArray, surface: IntArray
) -> NDArray[np.bool_]:
    """Whether a view sees each point: in its swept field and range, and not occluded.

    points_mm: (n, 3) world coordinates on the scene's surfaces; surface: (n,) index of each.
    The field is taken as swept without gaps: between two profiles a point is looked at from
    between them, and the sweep ends half a step beyond the first and the last profile.
    """
    params = sensor.params
    profile, x_mm = _nearest_profile(path, points_mm)
    T_world_profile = path.T_world_profile[profile]
    local_mm = T_world_profile.inv().apply(points_mm)
    depth_mm = local_mm[:, 2] + params.apex_depth_mm
    inside = (np.abs(x_mm) <= 0.5 * path.step_mm) & (depth_mm > 0.0)
    inside &= np.abs(local_mm[:, 1]) <= params.edge_slope * (1.0 + 1e-9) * depth_mm
    if params.range_limits:
        inside &= (local_mm[:, 2] >= params.near_mm) & (local_mm[:, 2] <= params.far_mm)
    chosen = np.flatnonzero(inside)
    if len(chosen) == 0:
        return inside
    apex_mm = np.repeat(sensor.apex_mm[None], len(chosen), axis=0)
    apex_mm[:, 0] = x_mm[chosen]
    apex_mm = T_world_profile[chosen].apply(apex_mm)
    distance, met = cast_fans(scene, apex_mm / 1000.0, (points_mm[chosen] - apex_mm)[:, None] / 1e3)
    # A ray at the very edge of a face may meet the neighbour that shares the edge.
    inside[chosen] = (met[:, 0] == surface[chosen]) | (np.abs(distance[:, 0] - 1.0) < 1e-9)
    return inside


def _nearest_profile(path: ViewPath, points_mm: FloatArray) -> tuple[IntArray, FloatArray]:
    """The profile whose plane is nearest to each point, and the point's X in its frame."""
    along = path.T_world_profile.rotation.as_matrix()[:, :, 0]
    x_mm = points_mm @ along.T - np.einsum("ki,ki->k", along, path.T_world_profile.translation)
    profile = np.abs(x_mm).argmin(axis=1)
    return profile, np.take_along_axis(x_mm, profile[:, None], axis=1)[:, 0]
