"""Scenes that repeat themselves, are symmetric or have three directions: what methods make of them.

python benchmarks/hard_scenes.py [--pairs N] [--seed N] [--everyday | --symmetric] [--only KIND ...]
                                 [--pitch DEG] [--yaw DEG] [--overlap LIMIT ...] [--little-noise]
                                 [--ablation]

--everyday: book shelves, stairs, pipes and other things that people scan, in their place.
--symmetric: flanges, wheels, towers and others that look the same some turns or things further.
--pitch: of the sensor, within 10 degrees; 90 looks straight down.
--yaw: by which two views differ at most; from opposite sides, with --overlap 0.05 0.4 0.6 1, they
see other sides of a table, which looks the same from both. --overlap: ranges between these limits,
that pairs take turns in; with 0 0.03 they share next to nothing, and no answer is to be had.
--little-noise: 0.1 mm of white noise and no other effect of the sensor. So planes are known so well
that few decide, and those of a box seen from two sides may be taken for each other.
--ablation: the methods of configs/ablation.yaml, all kinds of scenes together.

Every pair has a scene of its own. A wrong answer is marked "ok" and off by more than 5 degrees or
30 mm: on a shelf a whole compartment, say. Where no answer is to be had, a method should say so.
"In doubt": a note of the answer names another pose.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

import argparse  # noqa: E402
from collections import Counter, defaultdict  # noqa: E402
from collections.abc import Callable, Iterable  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
from everyday_scenes import EVERYDAY, FLOOR, WALL  # noqa: E402
from symmetric_scenes import SYMMETRIC  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.config.choices import chosen_method  # noqa: E402
from harness.config.reading import load_experiment  # noqa: E402
from harness.execution import full_spec, scan_view  # noqa: E402
from harness.scoring.poses import COARSE, exact_pose, is_success, pose_error  # noqa: E402
from harness.trials.random_pairs import build_random_trials  # noqa: E402
from registration import register  # noqa: E402
from registration.gauss_sphere.params import GaussSphereParams  # noqa: E402
from scenes import SCENES, SceneEntry  # noqa: E402
from scenes.rays import RayError  # noqa: E402
from scenes.scene import Scene  # noqa: E402
from scenes.solids import Solid, assemble, box, frustum, prism, turned  # noqa: E402
from sensors.noise import SWITCHES  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
CONFIG, ABLATION = (ROOT / "configs" / f"{name}.yaml" for name in ("random_pairs", "ablation"))
CALIBRATION = str(ROOT / "configs" / "calibration" / "jupiter.json")
LITTLE_NOISE = {
    **dict.fromkeys(SWITCHES, False), "bulge": "none", "gaussian": True,
    # The noise grows with the distance, so the far one must be the larger.
    "sigma_near_mm": 0.1, "sigma_far_mm": 0.1001, "sigma_incidence": 0.0,
}  # fmt: skip
STATUSES = ("ambiguous", "underdetermined", "failed")


def shelf(rng: np.random.Generator) -> list[Solid]:
    """Equal compartments without end."""
    width, height = rng.uniform(0.12, 0.2), rng.uniform(0.1, 0.18)
    back = box("back", [0.02, 1.6, 1.0], [0.12, 0.0, -0.3])
    uprights = [box(f"upright{i}", [0.2, 0.015, 1.0], [0.0, i * width, -0.3]) for i in range(-6, 7)]
    boards = [box(f"board{i}", [0.2, 1.6, 0.015], [0.0, 0.0, i * height]) for i in range(-3, 5)]
    return [back, *uprights, *boards]


def grid(rng: np.random.Generator) -> list[Solid]:
    """Equal cubes in rows and columns."""
    size, yaw = rng.uniform(0.05, 0.09), turned(rng.uniform(0.0, 45.0))
    gap = size * rng.uniform(1.5, 2.0)
    places = [(i, k) for i in range(-3, 4) for k in range(-3, 4)]
    cubes = [
        box(f"cube{i}_{k}", [size] * 3, yaw.apply([i * gap, k * gap, 0.0]), yaw) for i, k in places
    ]
    return [FLOOR, *cubes]


def louvre(rng: np.random.Generator) -> list[Solid]:
    """Equal slats, and one post across them."""
    pitch = rng.uniform(0.05, 0.06)
    slat = [0.07, 1.0, 0.01]
    slats = [box(f"slat{i}", slat, [0.0, 0.0, i * pitch], turned(0.0, 35.0)) for i in range(-5, 12)]
    back = box("back", [0.02, 1.2, 0.9], [0.1, 0.0, -0.2])
    return [back, *slats, box("post", [0.1, 0.05, 0.9], [-0.02, 0.2, -0.2])]


def cube(rng: np.random.Generator) -> list[Solid]:
    """A cube on the floor."""
    return [FLOOR, box("cube", [rng.uniform(0.15, 0.3)] * 3, [0, 0, 0], turned(rng.uniform(0, 90)))]


def one_box(rng: np.random.Generator) -> list[Solid]:
    """A box on the floor, and nothing else: half a turn looks the same, or a quarter if square."""
    size = rng.uniform(0.15, 0.3, 2)
    square = rng.random() < 0.5
    sides = [size[0], size[0] if square else size[1], rng.uniform(0.06, 0.2)]
    return [FLOOR, box("box", sides, [0, 0, 0], turned(rng.uniform(0, 90)))]


def two_boxes(rng: np.random.Generator) -> list[Solid]:
    """Two equal boxes, turned alike: half a turn of both looks the same."""
    sides, yaw = rng.uniform(0.08, 0.2, 3), turned(rng.uniform(0, 90))
    away = rng.uniform(0.1, 0.15, 2)
    places = enumerate(([*-away, 0.0], [*away, 0.0]))
    return [FLOOR, *(box(f"box{i}", sides, place, yaw) for i, place in places)]


def tiers(rng: np.random.Generator) -> list[Solid]:
    """Three boxes on each other, each narrower than the one below: half a turn looks the same."""
    yaw, slimmer, heights = (
        turned(rng.uniform(0, 90)),
        rng.uniform(0.7, 1.0),
        rng.uniform(0.03, 0.06, 3),
    )
    return [
        FLOOR,
        *(
            box(f"tier{i}", [width, slimmer * width, heights[i]], [0, 0, heights[:i].sum()], yaw)
            for i, width in enumerate((0.28, 0.19, 0.1))
        ),
    ]


def corner(rng: np.random.Generator) -> list[Solid]:
    """A room of its own mirror image, with a cube turned by 45 degrees."""
    sides = [box(f"side{i}", [1.0, 0.05, 0.8], [0.0, 0.5 * i, 0.0]) for i in (-1, 1)]
    return [
        FLOOR,
        WALL,
        *sides,
        box("cube", [rng.uniform(0.15, 0.25)] * 3, [0.05, 0, 0], turned(45)),
    ]


def _boxes(rng: np.random.Generator, yaws_deg: list[float]) -> list[Solid]:
    return [
        box(
            f"box{i}",
            rng.uniform(0.06, 0.2, 3),
            [rng.uniform(-0.25, 0.25), rng.uniform(-0.3, 0.3), 0.0],
            turned(rng.choice(yaws_deg)),
        )
        for i in range(10)
    ]


def three_directions(rng: np.random.Generator) -> list[Solid]:
    """Boxes along the axes of a room, whose sides are hardly seen."""
    return [FLOOR, WALL, *_boxes(rng, [0.0])]


def upright(rng: np.random.Generator) -> list[Solid]:
    """Boxes upright in a room, turned by 0, 30 or 45 degrees."""
    return [FLOOR, WALL, *_boxes(rng, [0.0, 30.0, 45.0])]


def roofs(rng: np.random.Generator) -> list[Solid]:
    """Equal roofs side by side, and three boxes among them."""
    width = rng.uniform(0.1, 0.16)
    outline = [(-width / 2, 0.0), (width / 2, 0.0), (0.0, 0.6 * width)]
    rows = [prism(f"roof{i}", outline, 0.6, [i * width, 0.0, 0.0]) for i in range(-3, 4)]
    boxes = [
        box(
            f"box{i}",
            rng.uniform(0.05, 0.12, 3),
            [*rng.uniform(-0.2, 0.2, 2), 0.05],
            turned(*rng.uniform(-25.0, 25.0, 3)),
        )
        for i in range(3)
    ]
    return [FLOOR, *rows, *boxes]


def round_things(rng: np.random.Generator) -> list[Solid]:
    """Cones and cylinders of 24 sides."""
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    things = []
    for i in range(9):
        ring = rng.uniform(0.03, 0.09) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        outline = [(float(x), float(y)) for x, y in ring]
        place = [rng.uniform(-0.25, 0.3), rng.uniform(-0.35, 0.35), 0.0]
        turn = turned(0.0, *rng.uniform(-15.0, 15.0, 2))
        narrower = rng.uniform(0.5, 1.0)
        height = rng.uniform(0.08, 0.3)
        things.append(frustum(f"round{i}", outline, height, place, turn, top_scale=narrower))
    return [FLOOR, WALL, *things]


def brackets(rng: np.random.Generator) -> list[Solid]:
    """Three equal L brackets in a row: a view may see others of them than the next view."""
    long, short, height, apart = rng.uniform([0.1, 0.03, 0.05, 0.2], [0.16, 0.06, 0.1, 0.3])
    turn, solids = turned(rng.uniform(-30.0, 30.0)), [FLOOR]
    for i in range(3):
        place = np.array([0.0, (i - 1) * apart, 0.0])
        beside = place + np.array([0.5 * long - 0.025, 0.5 * short + 0.025, 0.0])
        solids.append(box(f"long{i}", [long, 0.05, height], turn.apply(place), turn))
        solids.append(box(f"short{i}", [0.05, short, height], turn.apply(beside), turn))
    return solids


def gables(rng: np.random.Generator) -> list[Solid]:
    """Three to five equal houses in a row, their ridges along it."""
    half, wall, roof, deep, apart = rng.uniform(
        [0.05, 0.05, 0.03, 0.1, 0.2], [0.08, 0.1, 0.06, 0.18, 0.3]
    )
    ridge, turn = rng.uniform(-0.4, 0.4) * half, turned(rng.uniform(-30.0, 30.0))
    number = int(rng.integers(3, 6))
    outline = [(-half, 0.0), (half, 0.0), (half, wall), (ridge, wall + roof), (-half, wall)]
    places = (turn.apply([0.0, (i - 0.5 * (number - 1)) * apart, 0.0]) for i in range(number))
    return [FLOOR, *(prism(f"house{i}", outline, deep, at, turn) for i, at in enumerate(places))]


KINDS: dict[str, Callable[[np.random.Generator], list[Solid]]] = {
    kind.__name__: kind
    for kind in (
        shelf, grid, louvre, cube, one_box, two_boxes, corner, three_directions, upright, roofs,
        round_things, tiers, brackets, gables,
    )
}  # fmt: skip


@dataclass(frozen=True)
class HardParams:
    """kind: one of KINDS, EVERYDAY or SYMMETRIC; the seed decides its sizes."""

    kind: str = "shelf"
    seed: int = 0


def hard(params: HardParams) -> Scene:
    """Build a scene that is hard to register."""
    kinds = KINDS | EVERYDAY | SYMMETRIC
    return assemble(params.kind, kinds[params.kind](np.random.default_rng(params.seed)))


def families_of(
    scene: str, kinds: Iterable[str], pairs: int, pitch_deg: float = 25.0
) -> dict[str, dict[str, object]]:
    """The families of a config, one of so many pairs for each kind of a scene."""
    return {
        kind: {
            "scene": {"name": scene, "params": {"kind": kind}}, "new_scene": True,
            "pairs": pairs, "aim_mm": [0, 0, 60], "aim_within_mm": 150,
            "distance_mm": [700, 1000], "pitch_deg": pitch_deg,
        }
        for kind in kinds
    }  # fmt: skip


def methods_compared(ablation: bool) -> dict[str, GaussSphereParams]:
    """Parameters of gauss_sphere by the label of a method."""
    if not ablation:
        return {
            "gauss_sphere": GaussSphereParams(calibration=CALIBRATION),
            "gauss_sphere without calibration": GaussSphereParams(),
        }
    choices = load_experiment(ABLATION).methods
    return {
        choice.called: chosen_method(choice, ("methods", index), ABLATION).params
        for index, choice in enumerate(choices)
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=30, help="of each kind")
    parser.add_argument("--seed", type=int, default=301)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--everyday", action="store_true")
    which.add_argument("--symmetric", action="store_true")
    which.add_argument("--only", nargs="+", choices=[*KINDS, *EVERYDAY, *SYMMETRIC])
    parser.add_argument("--pitch", type=float, default=25.0, help="of the sensor, in degrees")
    parser.add_argument("--yaw", type=float, default=40.0, help="by which views differ at most")
    parser.add_argument(
        "--overlap", type=float, nargs="+", default=[0.2, 0.4, 0.6, 1.0], help="limits of ranges"
    )
    parser.add_argument("--little-noise", action="store_true")
    parser.add_argument("--ablation", action="store_true", help="with one part off at a time")
    options = parser.parse_args()
    several = EVERYDAY if options.everyday else SYMMETRIC if options.symmetric else KINDS
    kinds = options.only or list(several)
    SCENES["hard"] = SceneEntry(hard, HardParams)
    families = families_of("hard", kinds, options.pairs, options.pitch)
    overrides = ["methods=[{name: gauss_sphere}]", f"families={families}"]
    overrides.append(f"yaw_within_deg={options.yaw}")
    overrides.append(f"overlap={options.overlap}")
    if options.little_noise:
        overrides.append(f"sensor.params.noise={LITTLE_NOISE}")
    experiment = load_experiment(CONFIG, overrides, options.seed)
    methods = methods_compared(options.ablation)
    counts = defaultdict[tuple[str, str], Counter[str]](Counter)
    for trial in build_random_trials(experiment, CONFIG):
        group = "all" if options.ablation else trial.pair.split()[0]
        try:
            spec = full_spec(trial)
            target, source = (scan_view(spec, view) for view in (spec.target, spec.source))
        except RayError:
            continue  # the sensor would stand inside of a solid
        T_exact = exact_pose(*spec.paths)
        for label, params in methods.items():
            result, count = register(target, source, params=params), counts[group, label]
            count["pairs"] += 1
            pose = result.T_target_source
            right = pose is not None and is_success(pose_error(T_exact, pose), COARSE)
            count["right"] += right
            name = result.status
            if name == "ok":
                name = "ok, right" if right else "ok, wrong"
                count[f"told {right}"] += any("which is right" in note for note in result.notes)
            count[name] += 1
    columns = ("pairs", "ok, right", "told True", "ok, wrong", "told False", *STATUSES, "right")
    rows = [[kind, label, *(count[c] for c in columns)] for (kind, label), count in counts.items()]
    headers = ["scenes", "method", "pairs", "ok, right", "in doubt", "ok, wrong", "in doubt",
               *STATUSES, "first pose right, whatever the status"]  # fmt: skip
    print(tabulate(rows, headers, "github"))


if __name__ == "__main__":
    main()
