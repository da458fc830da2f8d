"""An experiment as frozen trials, each with an id that is a hash of all that determines it."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from harness.config.choices import (
    Chosen,
    canonical_json,
    checked_params,
    chosen_methods,
    joined_json,
    kept_choice,
    list_json,
)
from harness.config.errors import ConfigError
from harness.config.schema import Experiment, PlacedView, StartView, Truth
from harness.recent import Recent
from harness.trials.lazy import Lazy
from harness.trials.points import Point
from harness.trials.views import ArmStep, ViewSpec, view_spec
from scenes import SCENES
from sensors import SENSORS
from sensors.arm import ArmParams, ReachError
from sensors.paths import LineError, ViewPath


@dataclass(frozen=True)
class TrialSpec:
    """Everything that determines one trial.

    given: the stage of method `thesis` whose result is replaced by the truth, or "".
    """

    scene: Chosen
    sensor: Chosen
    profiles: int
    step_mm: float
    target: ViewSpec
    source: ViewSpec
    method: Chosen
    given: Truth | str
    repeat: int
    seed: int

    @functools.cached_property
    def id(self) -> str:
        """The first 16 hexadecimal digits of the SHA-256 of the canonical JSON."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]

    @property
    def text(self) -> str:
        """Its canonical JSON."""
        return joined_json(self)

    def view_key(self, view: ViewSpec) -> str:
        """All that determines the scan of a view, the same whichever method or pair asks for it."""
        return canonical_json([self.place_key(view), self.repeat, self.seed])

    def place_key(self, view: ViewSpec) -> str:
        """All that determines what the rays of a view meet: the scan's key without its noise."""
        return list_json([self.scene, self.sensor, self.profiles, self.step_mm, view])

    def pair_key(self) -> str:
        """All that determines the overlap of the pair."""
        return self.place_key(self.target) + self.place_key(self.source)

    @property
    def scan_key(self) -> Hashable:
        """Trials with equal ones share both scans; made of texts that are at hand."""
        views = self.target.text, self.source.text, self.repeat, self.seed
        return self.scene.text, self.sensor.text, self.profiles, self.step_mm, views

    def view_rng(self, view: ViewSpec) -> np.random.Generator:
        """The random numbers of a view's scan, keyed by its coordinates and nothing else."""
        return keyed_rng(self.view_key(view))

    def path(self, view: ViewSpec) -> ViewPath:
        """The viewing line of one of the trial's views."""
        return view.path(self.profiles, self.step_mm)

    @property
    def paths(self) -> tuple[ViewPath, ViewPath]:
        """The viewing lines of target and source."""
        return self.path(self.target), self.path(self.source)


def keyed_rng(key: str) -> np.random.Generator:
    """The random numbers of a key, whatever else is drawn before or beside."""
    return np.random.default_rng(int.from_bytes(hashlib.sha256(key.encode()).digest()))


class Spec(Protocol):
    """What a trial is determined by: a TrialSpec, or what one is drawn from (a RandomSpec)."""

    @property
    def id(self) -> str:
        """A hash of all of it."""

    @property
    def text(self) -> str:
        """The canonical JSON of all of it."""

    @property
    def scan_key(self) -> Hashable:
        """Trials with equal ones share both scans."""

    @property
    def sensor(self) -> Chosen:
        """The sensor of both views."""

    @property
    def method(self) -> Chosen:
        """The method, with its parameters."""

    @property
    def given(self) -> str:
        """The stage whose result is replaced by the truth, or ""."""

    @property
    def repeat(self) -> int:
        """The number of the repeat, or of a random pair."""


@dataclass(frozen=True)
class Trial:
    """A trial with the names that the config gives its pair and its method.

    point: the point of the sweep that it belongs to, if there is a sweep.
    """

    spec: Spec
    pair: str
    label: str
    point: Point | None = None

    @property
    def id(self) -> str:
        """The id of the spec: names change nothing."""
        return self.spec.id


class Trials(Lazy[Trial]):
    """All trials of a checked experiment, each made when it is asked for.

    used: the methods by name, each with the calibration that it reads or "".
    """

    def __init__(
        self, length: int, make: Callable[[int], Trial], used: frozenset[tuple[str, str]]
    ) -> None:
        super().__init__(length, make)
        self.used = used


def used_methods(methods: Iterable[Chosen]) -> frozenset[tuple[str, str]]:
    """The methods as Trials notes them."""
    return frozenset((m.name, str(getattr(m.params, "calibration", ""))) for m in methods)


def full_specs(trials: Iterable[Trial]) -> list[TrialSpec]:
    """The specs that name their views, all but those of random pairs."""
    return [trial.spec for trial in trials if isinstance(trial.spec, TrialSpec)]


def build_trials(experiment: Experiment, file: Path, kept: Recent | None = None) -> Trials:
    """All trials of an experiment, in a fixed order; raises ConfigError, naming the file and key.

    The order is by repeat, pair and method, so that scans which are shared come close together.
    kept: what was checked for experiments that differ in little.
    """
    kept = kept or Recent(len(experiment.methods) + 3)
    scene = kept_choice(experiment.scene, SCENES, "scene", file, kept)
    sensor = kept_choice(experiment.sensor, SENSORS, "sensor", file, kept)
    methods = chosen_methods(experiment.methods, file, kept)
    scan, views = experiment.scan, _views(experiment, file, kept)
    combinations = [
        (name, pair, choice.called, method, given)
        for name, pair in experiment.pairs.items()
        for choice, method in zip(experiment.methods, methods, strict=True)
        for given in ("", *choice.given)
    ]
    # True segments and patches hold no noise: every repeat would be the same trial.
    repeated = [each for each in combinations if each[-1] in ("", "rotation")]

    def trial(index: int) -> Trial:
        repeat, place = 0, index
        if index >= len(combinations):
            repeat, place = divmod(index - len(combinations), len(repeated))
            repeat += 1
        name, pair, label, method, given = (repeated if repeat else combinations)[place]
        spec = TrialSpec(
            scene, sensor, scan.profiles, scan.step_mm, views[pair.target], views[pair.source],
            method, given, repeat, experiment.seed,
        )  # fmt: skip
        return Trial(spec, name, label)

    count = len(combinations) + (experiment.repeats - 1) * len(repeated)
    return Trials(count, trial, used_methods(methods))


def _views(experiment: Experiment, file: Path, kept: Recent) -> dict[str, ViewSpec]:
    """Every view by its name; the arm is driven along each."""
    e = experiment
    parts = (e.views, e.pairs, e.arm, e.rotation_labels, e.scan, e.seed)

    def make() -> dict[str, ViewSpec]:
        arm = None
        if e.arm is not None:
            arm = checked_params(ArmParams, e.arm, file, ("arm",))
        return {name: _carried(view_spec(e, name, file), arm, e, file) for name in e.views}

    return kept.same("views", parts, lambda: kept.get(f"views {canonical_json(parts)}", make))


def beyond_reach(experiment: Experiment, trials: Iterable[Trial]) -> dict[str, str]:
    """Why the arm cannot follow a view that is scanned without it, by the view's name."""
    reasons: dict[str, str] = {}
    if experiment.arm is None:
        return reasons
    arm = checked_params(ArmParams, experiment.arm, "", ("arm",))
    for spec in full_specs(trials):
        for view in (spec.target, spec.source):
            if view.arm is None and view.name not in reasons:
                try:
                    replace(view, arm=arm).path(spec.profiles, spec.step_mm)
                except ReachError as error:
                    reasons[view.name] = str(error)
    return reasons


def _carried(view: ViewSpec, arm: ArmParams | None, experiment: Experiment, file: Path) -> ViewSpec:
    """A view on the arm, driven once so that one out of reach is told before any scan."""
    if arm is None:
        try:
            view.path(experiment.scan.profiles, experiment.scan.step_mm)
        except LineError as error:
            raise ConfigError(file, ("views", view.name), str(error)) from None
        return view
    digest = hashlib.sha256(canonical_json([experiment.seed, view.name]).encode()).digest()
    carried = replace(view, arm=arm, rest_seed=int.from_bytes(digest[:6]))
    try:
        carried.path(experiment.scan.profiles, experiment.scan.step_mm)
    except ReachError as error:
        chosen = experiment.views[view.name]
        leave = chosen.beyond_reach if isinstance(chosen, PlacedView) else "refuse"
        by_arm = isinstance(view.aim, StartView)
        if by_arm or any(isinstance(step, ArmStep) for step in view.steps):
            leave = "refuse"  # without an arm nothing says where it is
        misread = experiment.rotation_labels != "swapped"
        if leave == "straight_line" or (leave == "straight_line_unless_swapped" and misread):
            return view
        raise ConfigError(file, ("views", view.name), f"out of the arm's reach: {error}") from None
    except LineError as error:
        raise ConfigError(file, ("views", view.name), str(error)) from None
    return carried
