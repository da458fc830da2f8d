"""The overlap of two views as the harness counts it."""

from __future__ import annotations

from harness.scoring.common_points import common_points
from scenes.scene import Scene
from sensors.paths import ViewPath
from sensors.sensor import Sensor


def overlap(sensor: Sensor, scene: Scene, path_a: ViewPath, path_b: ViewPath) -> float:
    """Share of the points view a measures that view b sees too."""
    hits = sensor.hits(scene, path_a), sensor.hits(scene, path_b)
    return common_points(sensor, scene, hits, (path_a, path_b)).shares[0]
