"""Random clutter: solids at random poses on a floor before a wall, for many unseen scenes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from scenes.materials import MATERIALS
from scenes.scene import FloatArray, Scene
from scenes.solids import Solid, assemble, box, prism, turned

WALL_SIZE_M = (0.05, 1.4, 0.8)
WALL_GAP_M = 0.03  # between the hindmost corner and the wall


@dataclass(frozen=True)
class ClutterParams:
    """How many solids and how large; the seed decides everything else.

    solids: number of boxes, wedges, roofs and lecterns.
    size_min_mm, size_max_mm: each edge of a solid lies between the two.
    spread_mm: the solids' middles lie in a square of this side around the world's origin.
    tilt_max_deg: how far a solid leans from upright, its lowest corner still on the floor.
    """

    seed: int = 0
    solids: int = 14
    size_min_mm: float = 60.0
    size_max_mm: float = 170.0
    spread_mm: float = 560.0
    tilt_max_deg: float = 25.0

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; expected 0 or above")
        if self.solids < 1:
            raise ValueError(f"solids is {self.solids}; expected at least 1")
        if not 0.0 < self.size_min_mm <= self.size_max_mm < np.inf:
            raise ValueError(
                f"size_min_mm is {self.size_min_mm} and size_max_mm is {self.size_max_mm}; "
                "expected lengths above 0 mm, the maximum not below the minimum"
            )
        if not 0.0 <= self.spread_mm < np.inf:
            raise ValueError(f"spread_mm is {self.spread_mm}; expected a length of at least 0 mm")
        if not 0.0 <= self.tilt_max_deg <= 90.0:
            raise ValueError(f"tilt_max_deg is {self.tilt_max_deg}; expected 0 to 90 degrees")


@lru_cache(maxsize=16)
def clutter(params: ClutterParams) -> Scene:
    """Scatter the solids; the origin is on the floor, the wall stands behind them towards +X.

    Solids may run into each other: what is seen of them is exact all the same, and symmetric by
    accident only.
    """
    return assemble("clutter", scattered_solids(params))


def scattered_solids(params: ClutterParams) -> list[Solid]:
    """The solids of the clutter, floor and wall first."""
    rng = np.random.default_rng(params.seed)
    places_m = _places(params.solids, params.spread_mm / 2000.0, rng)
    scattered = [_random_solid(i, place_m, params, rng) for i, place_m in enumerate(places_m)]
    floor = box("floor", [1.4, 1.4, 0.03], [0.0, 0.0, -0.03], material="wood")
    wall_turn = turned(rng.uniform(-12.0, 12.0))
    backwards = wall_turn.apply([1.0, 0.0, 0.0])
    corners_m = np.concatenate([s.polygon_m for solid in scattered for s in solid.surfaces()])
    wall_m = ((corners_m @ backwards).max() + WALL_GAP_M + 0.5 * WALL_SIZE_M[0]) * backwards
    wall = box("wall", WALL_SIZE_M, wall_m, wall_turn, "white_paper")
    return [floor, wall, *scattered]


def _places(count: int, half_m: float, rng: np.random.Generator) -> FloatArray:
    """Points (count, 2) in a square, each the one of eight draws farthest from those before."""
    places_m = np.empty((count, 2))
    for k in range(count):
        draws_m = rng.uniform(-half_m, half_m, (8, 2))
        gaps_m = np.linalg.norm(draws_m[:, None] - places_m[None, :k], axis=2)
        places_m[k] = draws_m[gaps_m.min(axis=1, initial=np.inf).argmax()]
    return places_m


def _random_solid(
    number: int, place_m: FloatArray, params: ClutterParams, rng: np.random.Generator
) -> Solid:
    depth_m, width_m, height_m = rng.uniform(params.size_min_mm, params.size_max_mm, 3) / 1000.0
    tilt_deg, lean_deg = params.tilt_max_deg * rng.uniform(-1.0, 1.0, 2)
    rotation = turned(rng.uniform(-180.0, 180.0), tilt_deg, lean_deg)
    material = list(MATERIALS)[rng.integers(len(MATERIALS))]
    shape = rng.choice(["box", "box", "wedge", "roof", "lectern"])
    ridge = rng.uniform(0.3, 0.7)
    name = f"{shape}{number}"
    x_m = depth_m / 2.0
    outlines = {
        "wedge": [(-x_m, 0.0), (x_m, 0.0), (x_m, height_m)],
        "roof": [(-x_m, 0.0), (x_m, 0.0), ((2.0 * ridge - 1.0) * x_m, height_m)],
        "lectern": [(-x_m, 0.0), (x_m, 0.0), (x_m, height_m), (-x_m, ridge * height_m)],
    }

    def at(position_m: FloatArray) -> Solid:
        if shape == "box":
            return box(name, [depth_m, width_m, height_m], position_m, rotation, material)
        return prism(name, outlines[shape], width_m, position_m, rotation, material)

    lowest_m = rotation.apply(at(np.zeros(3)).corners_m)[:, 2].min()
    return at(np.array([*place_m, -lowest_m]))
