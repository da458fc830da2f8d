"""Scenes of things that people scan, of sizes of their own, for hard_scenes.py to register."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from scenes.solids import Solid, box, frustum, prism, turned

FLOOR = box("floor", [1.4, 1.4, 0.03], [0.0, 0.0, -0.03], material="wood")
WALL = box("wall", [0.05, 1.4, 0.8], [0.4, 0.0, 0.0])
Outline = list[tuple[float, float]]


def ring(radius: float, sides: int) -> Outline:
    """Corners of a prism of so many sides, at a radius in m."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angle]


def bookshelf(rng: np.random.Generator) -> list[Solid]:
    """Two boards with unequal books, some leaning."""
    solids = [box("back", [0.02, 1.4, 0.9], [0.16, 0.0, -0.25])]
    for board, z in enumerate((-0.2, 0.08)):
        solids.append(box(f"board{board}", [0.28, 1.4, 0.018], [0.02, 0.0, z - 0.018]))
        y, number = -0.55, 0
        while y < 0.55:
            width, height, depth = rng.uniform([0.012, 0.13, 0.1], [0.06, 0.24, 0.2])
            lean = rng.uniform(-12.0, 12.0) if rng.random() < 0.15 else 0.0
            if rng.random() < 0.1:
                y += rng.uniform(0.04, 0.12)
            at, turn = [0.15 - depth / 2, y + width / 2, z], turned(rng.uniform(-3, 3), 0.0, lean)
            solids.append(box(f"book{board}_{number}", [depth, width, height], at, turn))
            y += width + (0.032 if lean else 0.002)
            number += 1
    return [*solids, box("side", [0.3, 0.018, 0.9], [0.02, rng.uniform(0.3, 0.55), -0.25])]


def stairs(rng: np.random.Generator) -> list[Solid]:
    """A flight of stairs along a wall, with up to two things on it."""
    rise, run = rng.uniform(0.05, 0.09), rng.uniform(0.07, 0.12)
    steps = [box(f"step{i}", [0.9, 0.57, rise], [0.2 + i * run, 0.0, i * rise]) for i in range(8)]
    cheek = box("cheek", [1.2, 0.04, 0.8], [0.1, 0.33, 0.0], turned(rng.uniform(-4.0, 4.0)))
    things = []
    for i in range(rng.integers(0, 3)):
        step = rng.integers(0, 5)
        at = [-0.22 + step * run, rng.uniform(-0.2, 0.2), (step + 1) * rise]
        things.append(box(f"thing{i}", rng.uniform(0.04, 0.09, 3), at, turned(rng.uniform(0, 90))))
    return [FLOOR, *steps, cheek, *things]


def machine_parts(rng: np.random.Generator) -> list[Solid]:
    """Nuts, chamfered blocks, shafts and bars on a table."""
    parts: list[Solid] = []
    for i in range(12):
        x, y = rng.uniform([-0.25, -0.3], [0.25, 0.3])
        turn, kind = turned(rng.uniform(0.0, 180.0)), rng.integers(4)
        if kind == 0:
            outline = ring(rng.uniform(0.04, 0.08), 6)
            parts.append(frustum(f"nut{i}", outline, rng.uniform(0.04, 0.1), [x, y, 0.0], turn))
        elif kind == 1:
            w, h, c = rng.uniform([0.05, 0.05, 0.015], [0.1, 0.12, 0.03])
            outline = [(-w, 0), (w, 0), (w, h - c), (w - c, h), (c - w, h), (-w, h - c)]
            parts.append(prism(f"block{i}", outline, rng.uniform(0.08, 0.2), [x, y, 0.0], turn))
        elif kind == 2:
            radius, lying = rng.uniform(0.03, 0.06), turned(rng.uniform(0.0, 180.0), 90.0)
            outline, length = ring(radius, 16), rng.uniform(0.15, 0.3)
            parts.append(frustum(f"shaft{i}", outline, length, [x, y, radius], lying))
        else:
            size = rng.uniform([0.1, 0.03, 0.03], [0.25, 0.06, 0.12])
            parts.append(box(f"bar{i}", size, [x, y, 0.0], turn))
    return [FLOOR, *parts]


def _four_legged(size: Sequence[float], at: ArrayLike, turn: Rotation) -> list[Solid]:
    """A table of this depth, width and height."""
    (depth, width, height), middle = size, np.asarray(at)
    legs = [
        box(
            f"leg{i}",
            [0.02, 0.02, height],
            middle + turn.apply([x * (depth / 2 - 0.015), y * (width / 2 - 0.015), 0.0]),
            turn,
        )
        for i, (x, y) in enumerate([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    ]
    top = box("top", [depth, width, 0.015], middle + np.array([0.0, 0.0, height]), turn)
    return [top, *legs]


def furniture(rng: np.random.Generator) -> list[Solid]:
    """The corner of a room with a table, a cabinet and a stool, along the walls or a little off."""
    turns = [turned(rng.choice([0.0, 0.0, rng.uniform(-20.0, 20.0)])) for _ in range(3)]
    depth, width, height = rng.uniform([0.15, 0.2, 0.15], [0.25, 0.35, 0.25])
    at = np.array([rng.uniform(-0.05, 0.15), rng.uniform(-0.15, 0.15), 0.0])
    cabinet, stool = rng.uniform([0.1, 0.12, 0.2], [0.18, 0.25, 0.4]), rng.uniform(0.06, 0.12)
    picture = [0.015, *rng.uniform(0.1, 0.25, 2)]
    beside = rng.uniform(-0.3, 0.3, 3)
    return [
        FLOOR,
        WALL,
        box("other wall", [1.4, 0.05, 0.8], [0.0, rng.choice([-0.45, 0.45]), 0.0]),
        *_four_legged([depth, width, height], at, turns[0]),
        box("cabinet", cabinet, [0.28, beside[0], 0.0], turns[1]),
        box("stool", [0.1, 0.12, stool], [rng.uniform(-0.3, -0.1), beside[1], 0.0], turns[2]),
        box("picture", picture, [0.37, beside[2], rng.uniform(0.3, 0.45)]),
    ]


def houses(rng: np.random.Generator) -> list[Solid]:
    """Houses with slanted roofs, each of its own size and direction."""
    solids = [FLOOR]
    for i in range(8):
        w, h, roof = rng.uniform([0.05, 0.04, 0.02], [0.09, 0.12, 0.08])
        ridge = rng.uniform(-0.5, 0.5) * w
        x, y = np.array([0.2 * (i // 3) - 0.2, 0.22 * (i % 3) - 0.22]) + rng.uniform(-0.04, 0.04, 2)
        turn = turned(rng.choice([0.0, 90.0, rng.uniform(0.0, 180.0)]))
        outline = [(-w, 0), (w, 0), (w, h), (ridge, h + roof), (-w, h)]
        solids.append(prism(f"house{i}", outline, rng.uniform(0.08, 0.18), [x, y, 0.0], turn))
    return solids


def pipes(rng: np.random.Generator) -> list[Solid]:
    """Pipes upright and along a wall, with brackets."""
    solids = [WALL, FLOOR]
    for i in range(4):
        outline = ring(rng.uniform(0.025, 0.06), 20)
        x, y, z = rng.uniform([0.0, -0.3, 0.06], [0.3, 0.3, 0.4])
        if i % 2:
            solids.append(frustum(f"pipe{i}", outline, 0.7, [x, y, 0.0]))
        else:
            solids.append(frustum(f"pipe{i}", outline, 1.0, [x, -0.5, z], turned(0.0, 0.0, -90.0)))
    for i in range(5):
        at = rng.uniform([0.1, -0.3, 0.0], [0.36, 0.3, 0.4])
        turn = turned(rng.choice([0.0, 45.0, rng.uniform(-40.0, 40.0)]))
        solids.append(box(f"bracket{i}", rng.uniform(0.03, 0.12, 3), at, turn))
    return solids


def open_boxes(rng: np.random.Generator) -> list[Solid]:
    """Open crates with up to two things inside."""
    solids = [FLOOR]
    for i in range(3):
        turn, wall = turned(rng.uniform(-60.0, 60.0)), 0.008
        depth, width, height = rng.uniform([0.14, 0.14, 0.06], [0.28, 0.28, 0.14])
        at = np.array([rng.uniform(-0.2, 0.2), 0.25 * i - 0.25, 0.0])
        for k, side in enumerate((-1, 1)):
            front, flank = [side * depth / 2, 0.0, 0.0], [0.0, side * width / 2, 0.0]
            solids.append(box(f"front{i}_{k}", [wall, width, height], at + turn.apply(front), turn))
            solids.append(box(f"flank{i}_{k}", [depth, wall, height], at + turn.apply(flank), turn))
        for k in range(rng.integers(0, 3)):
            inside = at + turn.apply([*rng.uniform(-0.05, 0.05, 2), 0.0])
            tilt = turned(rng.uniform(0.0, 90.0), *rng.uniform(-15.0, 15.0, 2))
            solids.append(box(f"thing{i}_{k}", rng.uniform(0.03, 0.09, 3), inside, tilt))
    return solids


def table(rng: np.random.Generator) -> list[Solid]:
    """A table alone, with up to three things on it: from behind it looks the same but for these."""
    size, turn = rng.uniform([0.3, 0.4, 0.25], [0.5, 0.6, 0.4]), turned(rng.uniform(0.0, 90.0))
    solids = [FLOOR, *_four_legged(size, np.zeros(3), turn)]
    for i in range(rng.integers(0, 4)):
        at = turn.apply([*rng.uniform(-0.3, 0.3, 2) * size[:2], size[2] + 0.015])
        thing = rng.uniform(0.03, 0.12, 3)
        solids.append(box(f"thing{i}", thing, at, turned(rng.uniform(0.0, 90.0))))
    return solids


EVERYDAY: dict[str, Callable[[np.random.Generator], list[Solid]]] = {
    kind.__name__: kind
    for kind in (bookshelf, stairs, machine_parts, furniture, houses, pipes, open_boxes, table)
}
