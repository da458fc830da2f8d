"""Trials on random pairs of views: what a pair is drawn from, and how."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harness.config.choices import (
    LATER,
    Chosen,
    canonical_json,
    chosen,
    chosen_methods,
    joined_json,
    kept_choice,
    list_json,
)
from harness.config.errors import ConfigError, Key
from harness.config.random_schema import Family, RandomPairsExperiment
from harness.config.schema import AimedView
from harness.recent import Recent
from harness.trials.specs import Trial, Trials, TrialSpec, keyed_rng, used_methods
from harness.trials.views import ViewSpec
from scenes import SCENES
from scenes.scene import Scene
from sensors import SENSORS
from sensors.overlap import seen
from sensors.paths import ViewPath
from sensors.sensor import Sensor

# A candidate is first judged by every few beams, then exactly; this close the first is trusted.
STRIDE, ROUGHLY = 8, 0.05
MOST_DRAWS = 500


class NoPairError(RuntimeError):
    """No pair of views within the limits was found."""


@dataclass(frozen=True)
class PairRules:
    """All that a family's pairs are drawn from; lengths in mm, angles in degrees."""

    scene: Chosen
    new_scene: bool
    aim_mm: tuple[float, float, float]
    aim_within_mm: float
    distance_mm: tuple[float, float]
    heading_within_deg: float
    yaw_within_deg: float
    pitch_deg: float
    pitch_within_deg: float
    roll_within_deg: float
    overlap: tuple[float, ...]

    @functools.cached_property
    def text(self) -> str:
        """Its canonical JSON, made once for all the trials that share it."""
        return joined_json(self)


@dataclass(frozen=True)
class DrawnFor:
    """So many profiles of a view, one every step_mm."""

    profiles: int
    step_mm: float


@dataclass(frozen=True)
class RandomSpec:
    """Everything that determines a trial on a random pair; `repeat` is the number of the pair.

    drawn_for: the scan for which the pair is drawn where that is not the trial's own.
    The pair itself is drawn where the trial runs: see drawn_spec.
    """

    rules: PairRules
    sensor: Chosen
    profiles: int
    step_mm: float
    method: Chosen
    repeat: int
    seed: int
    given: str = ""
    drawn_for: DrawnFor | None = field(default=None, metadata=LATER)

    @functools.cached_property
    def id(self) -> str:
        """The first 16 hexadecimal digits of the SHA-256 of the canonical JSON."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]

    @property
    def text(self) -> str:
        """Its canonical JSON."""
        return joined_json(self)

    @property
    def scan_key(self) -> Hashable:
        """Trials with equal ones share their pair and both scans."""
        scan = self.profiles, self.step_mm, self.repeat, self.seed
        return self.rules.text, self.sensor.text, scan

    @property
    def line(self) -> DrawnFor:
        """The profiles for which the pair is drawn."""
        return self.drawn_for or DrawnFor(self.profiles, self.step_mm)

    def pair_key(self) -> str:
        """All that determines the pair: not the method, nor the noise of the sensor."""
        sensor, line = self.sensor.noiseless, self.line
        parts = [self.rules, sensor, line.profiles, line.step_mm, self.repeat, self.seed]
        return list_json(parts)


def build_random_trials(
    experiment: RandomPairsExperiment, file: Path, kept: Recent | None = None
) -> Trials:
    """All trials, by number, family and method; raises ConfigError, naming the file and key.

    kept: what was checked for experiments that differ in little.
    """
    kept = kept or Recent(len(experiment.methods) + len(experiment.families) + 1)
    sensor = kept_choice(experiment.sensor, SENSORS, "sensor", file, kept)
    methods = chosen_methods(experiment.methods, file, kept)
    families = {
        name: (_rules(experiment, family, ("families", name), file, kept), family.pairs)
        for name, family in experiment.families.items()
    }
    line = experiment.drawn_for
    drawn_for = None if line is None else DrawnFor(line.profiles, line.step_mm)
    counts = np.array([pairs for _, pairs in families.values()])
    # How many trials there are up to each number: families end at numbers of their own.
    ends = len(methods) * np.cumsum([(counts > n).sum() for n in range(counts.max())])

    def trial(index: int) -> Trial:
        number = int(np.searchsorted(ends, index, side="right"))
        place = index - (int(ends[number - 1]) if number else 0)
        present = [name for name, (_, pairs) in families.items() if number < pairs]
        of_family, of_method = divmod(place, len(methods))
        name, choice = present[of_family], experiment.methods[of_method]
        spec = RandomSpec(
            families[name][0], sensor, experiment.scan.profiles, experiment.scan.step_mm,
            methods[of_method], number, experiment.seed, drawn_for=drawn_for,
        )  # fmt: skip
        return Trial(spec, f"{name} {number}", choice.called)

    return Trials(int(ends[-1]), trial, used_methods(methods))


def drawn_spec(spec: RandomSpec, shares: Callable[[TrialSpec], tuple[float, float]]) -> TrialSpec:
    """Draw the pair of a spec; the same spec gives the same pair, whatever the method or noise.

    Its profiles are those for which it is drawn.
    shares: exact shares of either view's points that the other sees. Raises NoPairError.
    """
    rules, line = spec.rules, spec.line
    rng = keyed_rng(spec.pair_key())
    sensor: Sensor = SENSORS[spec.sensor.name].factory(spec.sensor.params)
    scene = rules.scene
    if rules.new_scene:
        params = dataclasses.replace(scene.params, seed=int(rng.integers(2**31)))
        scene = Chosen(scene.name, params)
    built = SCENES[scene.name].builder(scene.params)
    turn = spec.repeat % (len(rules.overlap) - 1)
    least, most = rules.overlap[turn : turn + 2]
    for _ in range(MOST_DRAWS):
        target, source = _draw_views(rules, rng)
        pair = TrialSpec(
            scene, spec.sensor, line.profiles, line.step_mm, target, source, spec.method,
            "", spec.repeat, spec.seed,
        )  # fmt: skip
        rough = min(_rough_shares(sensor, built, *pair.paths))
        if least - ROUGHLY <= rough <= most + ROUGHLY and least <= min(shares(pair)) <= most:
            return pair
    raise NoPairError(
        f"{MOST_DRAWS} pairs of views of {scene.name} were drawn and none overlaps by "
        f"{least:.0%} to {most:.0%}; aim closer, or widen the limits"
    )


def _draw_views(rules: PairRules, rng: np.random.Generator) -> tuple[ViewSpec, ViewSpec]:
    heading_deg = rng.uniform(-rules.heading_within_deg, rules.heading_within_deg)
    apart_deg = rng.uniform(-rules.yaw_within_deg, rules.yaw_within_deg)
    views = []
    for name, side in (("target", -0.5), ("source", 0.5)):
        aim_mm = np.array(rules.aim_mm) + rng.uniform(-1.0, 1.0, 3) * rules.aim_within_mm
        pitch_deg, roll_deg = rng.uniform(-1.0, 1.0, 2) * (
            rules.pitch_within_deg,
            rules.roll_within_deg,
        )
        x_mm, y_mm, z_mm = aim_mm.tolist()
        aimed = AimedView(
            aim_mm=(x_mm, y_mm, z_mm),
            distance_mm=rng.uniform(*rules.distance_mm),
            yaw_deg=heading_deg + side * apart_deg,
            pitch_deg=rules.pitch_deg + pitch_deg,
            roll_deg=roll_deg,
        )
        views.append(ViewSpec(name, aimed, ()))
    return views[0], views[1]


def _rough_shares(
    sensor: Sensor, scene: Scene, target: ViewPath, source: ViewPath
) -> tuple[float, float]:
    """Shares of either view's points that the other sees, from every STRIDE-th profile and beam."""
    paths = [
        ViewPath(path.T_world_profile[::STRIDE], STRIDE * path.step_mm, travel=path.travel)
        for path in (target, source)
    ]
    shares = []
    for one, other in (paths, paths[::-1]):
        hits = sensor.hits(scene, one)
        points_mm, surface = hits.points_mm[:, ::STRIDE], hits.surface[:, ::STRIDE]
        measured = surface >= 0
        world_mm = one.T_world_view.apply(points_mm[measured])
        common = seen(sensor, scene, other, world_mm, surface[measured])
        shares.append(float(common.sum() / max(len(common), 1)))
    return shares[0], shares[1]


def _rules(
    experiment: RandomPairsExperiment, family: Family, key: Key, file: Path, kept: Recent
) -> PairRules:
    e = experiment
    limits = (e.heading_within_deg, e.yaw_within_deg, e.pitch_within_deg, e.roll_within_deg)

    def make() -> PairRules:
        scene = chosen(family.scene, SCENES, (*key, "scene"), file)
        if family.new_scene and not hasattr(scene.params, "seed"):
            message = f"scene {scene.name!r} has no seed to draw; leave new_scene out"
            raise ConfigError(file, (*key, "new_scene"), message)
        return PairRules(
            scene=scene,
            new_scene=family.new_scene,
            aim_mm=family.aim_mm,
            aim_within_mm=family.aim_within_mm,
            distance_mm=family.distance_mm,
            heading_within_deg=e.heading_within_deg,
            yaw_within_deg=e.yaw_within_deg,
            pitch_deg=family.pitch_deg,
            pitch_within_deg=e.pitch_within_deg,
            roll_within_deg=e.roll_within_deg,
            overlap=e.overlap,
        )

    return kept.get(f"rules {canonical_json([family, limits, e.overlap])}", make)


def family_of(pair: Any) -> str:
    """The family of a pair by its name."""
    return str(pair).rpartition(" ")[0]
