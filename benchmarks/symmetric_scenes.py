"""Scenes of things that look the same some turns further, for hard_scenes.py to register.

Most have a part that tells, in half of the scenes: a key, a porch, a stair that is missing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from everyday_scenes import FLOOR, ring
from scipy.spatial.transform import Rotation

from scenes.solids import Solid, box, frustum, prism, turned


def _around(yaw: Rotation, number: int) -> list[Rotation]:
    return [yaw * turned(360.0 * k / number) for k in range(number)]


def _gabled(half: float, wall: float, roof: float) -> list[tuple[float, float]]:
    return [(-half, 0.0), (half, 0.0), (half, wall), (0.0, wall + roof), (-half, wall)]


def flange(rng: np.random.Generator) -> list[Solid]:
    """A round plate with a hub and four to eight bolts, and perhaps a key."""
    radius, yaw = rng.uniform(0.16, 0.24), turned(rng.uniform(0.0, 90.0))
    top = [0.0, 0.0, 0.025]
    solids = [
        FLOOR,
        frustum("plate", ring(radius, 24), 0.025, [0, 0, 0], yaw),
        frustum("hub", ring(0.4 * radius, 24), rng.uniform(0.05, 0.12), top, yaw, top_scale=0.8),
    ]
    for i, turn in enumerate(_around(yaw, int(rng.integers(4, 9)))):
        at = turn.apply([0.75 * radius, 0.0, 0.025])
        solids.append(frustum(f"bolt{i}", ring(0.025, 6), 0.025, at, turn))
    if rng.random() < 0.5:
        turn = yaw * turned(rng.uniform(0.0, 360.0))
        at = turn.apply([0.5 * radius, 0.0, 0.025])
        solids.append(box("key", [0.06, 0.025, 0.03], at, turn))
    return solids


def gear(rng: np.random.Generator) -> list[Solid]:
    """A wheel of six to fourteen teeth, and perhaps a stop beside it."""
    teeth, yaw = int(rng.integers(6, 15)), turned(rng.uniform(0.0, 90.0))
    radius, height = rng.uniform([0.14, 0.03], [0.22, 0.06])
    half = 1.2 * radius / teeth
    outline = [(-0.02, -half), (0.05, -0.6 * half), (0.05, 0.6 * half), (-0.02, half)]
    solids = [
        FLOOR,
        frustum("wheel", ring(radius, 2 * teeth), height, [0, 0, 0], yaw),
        frustum("hub", ring(0.35 * radius, 6), 0.06, [0, 0, height], yaw),
    ]
    for i, turn in enumerate(_around(yaw, teeth)):
        at = turn.apply([radius, 0.0, 0.0])
        solids.append(frustum(f"tooth{i}", outline, height, at, turn))
    if rng.random() < 0.5:
        at = [rng.uniform(-0.3, 0.1), rng.choice([-0.3, 0.3]), 0.0]
        solids.append(box("stop", [0.08, 0.05, 0.1], at, turned(rng.uniform(0.0, 90.0))))
    return solids


def ring_of_blocks(rng: np.random.Generator) -> list[Solid]:
    """Four to seven equal blocks around a spindle, of which one may be missing."""
    radius, yaw = rng.uniform(0.16, 0.25), turned(rng.uniform(0.0, 360.0))
    sides, lean = rng.uniform([0.05, 0.06, 0.05], [0.09, 0.1, 0.12]), rng.choice([0.0, 20.0])
    solids = [FLOOR, frustum("spindle", ring(0.05, 24), 0.08, [0, 0, 0])]
    turns = _around(yaw, int(rng.integers(4, 8)))
    for i, turn in enumerate(turns[rng.integers(0, 2) :]):
        at = turn.apply([radius, 0.0, 0.0])
        solids.append(box(f"block{i}", sides, at, turn * turned(0.0, lean)))
    return solids


def pinwheel(rng: np.random.Generator) -> list[Solid]:
    """Three, four or six equal L parts about the middle, with a post in it or without."""
    long, short, height, away = rng.uniform([0.12, 0.05, 0.04, 0.1], [0.18, 0.09, 0.1, 0.15])
    solids = [FLOOR]
    for k, turn in enumerate(_around(turned(rng.uniform(0.0, 90.0)), int(rng.choice([3, 4, 6])))):
        beside = [away + 0.5 * short + 0.02, 0.055 - 0.5 * long, 0.0]
        at = turn.apply([away, 0.04, 0.0])
        solids.append(box(f"long{k}", [0.04, long, height], at, turn))
        solids.append(box(f"short{k}", [short, 0.03, 0.6 * height], turn.apply(beside), turn))
    if rng.random() < 0.5:
        solids.append(frustum("post", ring(0.04, 24), rng.uniform(0.05, 0.2), [0, 0, 0]))
    return solids


def cross_building(rng: np.random.Generator) -> list[Solid]:
    """Four gabled wings, equal or in pairs, and perhaps a porch."""
    yaw = turned(rng.uniform(0.0, 90.0))
    half, wall, roof, long = rng.uniform([0.05, 0.06, 0.03, 0.16], [0.08, 0.12, 0.07, 0.26])
    outline, other = _gabled(half, wall, roof), long * rng.choice([0.8, 1.0])
    solids = [
        FLOOR,
        prism("nave", outline, 2.0 * long, [0, 0, 0], yaw),
        prism("cross", outline, 2.0 * other, [0, 0, 0], yaw * turned(90.0)),
    ]
    if rng.random() < 0.5:
        at = yaw.apply([half + 0.03, 0.6 * long, 0.0])
        solids.append(box("porch", [0.06, 0.05, 0.05], at, yaw))
    return solids


def tower(rng: np.random.Generator) -> list[Solid]:
    """A tower of four, five, six or eight sides with buttresses, and perhaps a hut beside it."""
    sides, yaw = int(rng.choice([4, 5, 6, 8])), turned(rng.uniform(0.0, 90.0))
    radius, height, slim = rng.uniform([0.12, 0.12, 0.7], [0.2, 0.25, 1.0])
    buttress = [(0.0, 0.0), (0.09, 0.0), (0.0, 0.7 * height)]
    solids = [
        FLOOR,
        frustum("tower", ring(radius, sides), height, [0, 0, 0], yaw, top_scale=slim),
        frustum("roof", ring(0.75 * radius, sides), 0.06, [0, 0, height], yaw, top_scale=0.2),
    ]
    for k, turn in enumerate(_around(yaw, sides)):
        at = turn.apply([0.9 * radius, 0.0, 0.0])
        solids.append(prism(f"buttress{k}", buttress, 0.04, at, turn))
    if rng.random() < 0.5:
        at = [rng.uniform(-0.3, -0.22), rng.uniform(-0.2, 0.2), 0.0]
        solids.append(box("hut", rng.uniform(0.05, 0.1, 3), at, turned(rng.uniform(0.0, 90.0))))
    return solids


def ziggurat(rng: np.random.Generator) -> list[Solid]:
    """Three to five square tiers with a stair on each side, or on all but one."""
    tiers, yaw = int(rng.integers(3, 6)), turned(rng.uniform(0.0, 90.0))
    width, rise = rng.uniform([0.36, 0.03], [0.5, 0.06])
    run = width / (tiers + 0.5)
    stair = [(0.0, 0.0), (0.5 * tiers * run, 0.0), (0.5 * tiers * run, 0.95 * tiers * rise)]
    solids = [FLOOR]
    for i in range(tiers):
        side = width - i * run
        solids.append(box(f"tier{i}", [side, side, rise], [0.0, 0.0, i * rise], yaw))
    for k, turn in enumerate(_around(yaw, 4)[rng.integers(0, 2) :]):
        at = turn.apply([-0.5 * width - 0.01, 0.0, 0.0])
        solids.append(prism(f"stair{k}", stair, 0.06, at, turn))
    return solids


def dormers(rng: np.random.Generator) -> list[Solid]:
    """A long roof with five equal dormers, and up to two chimneys."""
    half, wall, slope = 0.22, rng.uniform(0.06, 0.12), np.tan(np.deg2rad(rng.uniform(30.0, 45.0)))
    solids = [FLOOR, prism("house", _gabled(half, wall, half * slope), 1.2, [0.1, 0.0, 0.0])]
    apart, wide = rng.uniform([0.2, 0.05], [0.3, 0.07])
    for i in range(5):
        at = [0.1 - 0.35 * half, (i - 2) * apart, wall + 0.25 * half * slope]
        solids.append(prism(f"dormer{i}", _gabled(wide, 0.06, wide), 0.2, at, turned(90.0)))
    for i in range(rng.integers(0, 3)):
        sides = [0.05, rng.uniform(0.04, 0.09), half * slope + 0.08]
        at = [*rng.uniform([0.0, -0.4], [0.2, 0.4]), wall]
        solids.append(box(f"chimney{i}", sides, at))
    return solids


def cubicles(rng: np.random.Generator) -> list[Solid]:
    """Two rows of equal desks back to back between screens, and a chair at some."""
    width, deep, high = rng.uniform([0.2, 0.16, 0.1], [0.3, 0.22, 0.16])
    yaw, solids = turned(rng.uniform(-90.0, 90.0)), [FLOOR]

    def put(name: str, sides: list[float], at: list[float]) -> None:
        solids.append(box(name, sides, yaw.apply(at), yaw))

    put("spine", [0.012, 3.2 * width, high], [0.0, 0.0, 0.0])
    for k in range(4):
        put(f"screen{k}", [2.0 * deep, 0.012, high], [0.0, (k - 1.5) * width, 0.0])
    for k in range(3):
        for side in (-1, 1):
            y = (k - 1) * width
            put(f"desk{k}{side}", [0.08, width - 0.02, 0.012], [side * 0.05, y, 0.6 * high])
            if rng.random() < 0.4:
                x, off = rng.uniform([0.12, -0.04], [0.18, 0.04])
                put(f"chair{k}{side}", [0.06, 0.06, 0.05], [side * x, y + off, 0.0])
    return solids


SYMMETRIC: dict[str, Callable[[np.random.Generator], list[Solid]]] = {
    kind.__name__: kind
    for kind in (
        flange, gear, ring_of_blocks, pinwheel, cross_building, tower, ziggurat, dormers, cubicles,
    )
}  # fmt: skip
