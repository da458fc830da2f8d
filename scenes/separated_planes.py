"""Tilted rectangles side by side, for tests of exactness: nothing occludes, nothing touches."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from scenes.scene import Scene
from scenes.solids import assemble, plate, turned


@dataclass(frozen=True)
class SeparatedPlanesParams:
    """The rectangles have nothing to choose."""


@lru_cache(maxsize=1)
def separated_planes(params: SeparatedPlanesParams) -> Scene:
    """Hang seven rectangles around the world's origin, looking towards -X in general directions.

    No two normals are within 11 degrees of each other. The rectangles fit a square of 0.33 m, so
    views aimed at the origin from nearly the same side see each one whole.
    """
    rows = [
        # width and height, place (x, y, z), then yaw, tilt and lean in degrees
        ((0.085, 0.080), (0.010, 0.115, 0.105), (31.0, 17.0, 8.0)),
        ((0.090, 0.075), (-0.015, 0.005, 0.115), (-22.0, 33.0, -11.0)),
        ((0.080, 0.085), (0.020, -0.115, 0.110), (-38.0, -14.0, 15.0)),
        ((0.100, 0.090), (0.000, -0.065, 0.000), (12.0, -27.0, -6.0)),
        ((0.095, 0.085), (-0.020, 0.070, -0.005), (-9.0, 6.0, 21.0)),
        ((0.085, 0.090), (0.015, 0.080, -0.115), (24.0, -36.0, -18.0)),
        ((0.100, 0.085), (-0.010, -0.080, -0.115), (-30.0, 24.0, 4.0)),
    ]
    plates = [
        plate(f"plate{i}", size_m, position_m, turned(*angles_deg))
        for i, (size_m, position_m, angles_deg) in enumerate(rows)
    ]
    return assemble("separated_planes", plates)
