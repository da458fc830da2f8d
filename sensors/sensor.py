"""What every sensor does, and what its rays meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from registration.scan import BoolArray, FloatArray, IntArray, Scan
from scenes.scene import Scene
from sensors.paths import ViewPath


@dataclass(frozen=True)
class Hits:
    """What the rays of a view meet, exact and without noise.

    points_mm: (profiles, pixels, 3) in the view frame, NaN where nothing returns.
    surface: (profiles, pixels) index into the scene's surfaces, -1 where nothing returns.
    normal: (profiles, pixels, 3) of that surface in the view frame, out of the object and so
        towards the sensor; NaN where nothing returns.
    origins_mm: (profiles, 3) where the sensor was, in the view frame.
    """

    points_mm: FloatArray
    surface: IntArray
    normal: FloatArray
    origins_mm: FloatArray

    @property
    def valid(self) -> BoolArray:
        """(profiles, pixels) True where something returns."""
        return self.surface >= 0


class Sensor(Protocol):
    """A scanner of profiles; X of its frame lies along the motion, Y along the profile, Z is depth.

    A class with these members and a line in SENSORS is all that a new sensor needs.
    """

    @property
    def apex_mm(self) -> FloatArray:
        """(3,) point in the sensor frame where the rays of a profile meet."""

    def scan(self, scene: Scene, path: ViewPath, rng: np.random.Generator) -> Scan:
        """Scan a view as the sensor would measure it; every random number comes from rng."""

    def hits(self, scene: Scene, path: ViewPath) -> Hits:
        """Cast every ray of a view; exact points, surfaces and normals in the view frame."""

    def in_field(self, points_mm: FloatArray) -> BoolArray:
        """Whether Y and Z of points (n, 3) in the sensor frame lie in the field and the range."""

    def outline(self, path: ViewPath) -> tuple[FloatArray, ...]:
        """What a picture shows of a view, as polylines (k, 3) in world coordinates in mm.

        First the line that the sensor travels, then borders of its field.
        """
