"""An experiment as frozen trials, each with an id that is a hash of all that determines it."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import ConfigDict, create_model

from harness.config import validated
from harness.config_errors import ConfigError, Key, nearest
from harness.schema import AimedView, Choice, Experiment, MethodChoice, PlacedView, StartView, Truth
from harness.views import ArmStep, ViewSpec, view_spec
from registration.methods import METHODS, UnknownMethodError, find_method
from registration.peers import PEERS, MissingPeerError, check_installed
from scenes import SCENES
from sensors import SENSORS
from sensors.arm import ArmParams, ReachError
from sensors.paths import LineError, ViewPath


@dataclass(frozen=True)
class Chosen:
    """An entry of a registry with all its parameters, defaults filled in."""

    name: str
    params: Any


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
        return hashlib.sha256(canonical_json(self).encode()).hexdigest()[:16]

    def view_key(self, view: ViewSpec) -> str:
        """All that determines the scan of a view, the same whichever method or pair asks for it."""
        return canonical_json([self.place_key(view), self.repeat, self.seed])

    def place_key(self, view: ViewSpec) -> str:
        """All that determines what the rays of a view meet: the scan's key without its noise."""
        return canonical_json([self.scene, self.sensor, self.profiles, self.step_mm, view])

    def pair_key(self) -> str:
        """All that determines the overlap of the pair."""
        return self.place_key(self.target) + self.place_key(self.source)

    def view_rng(self, view: ViewSpec) -> np.random.Generator:
        """The random numbers of a view's scan, keyed by its coordinates and nothing else."""
        digest = hashlib.sha256(self.view_key(view).encode()).digest()
        return np.random.default_rng(np.random.SeedSequence(int.from_bytes(digest)))

    def path(self, view: ViewSpec) -> ViewPath:
        """The viewing line of one of the trial's views."""
        return view.path(self.profiles, self.step_mm)


class Spec(Protocol):
    """What a trial is determined by: a TrialSpec, or what one is drawn from (a RandomSpec)."""

    @property
    def id(self) -> str:
        """A hash of all of it."""

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
    """A trial with the names that the config gives its pair and its method."""

    spec: Spec
    pair: str
    label: str

    @property
    def id(self) -> str:
        """The id of the spec: names change nothing."""
        return self.spec.id


def full_specs(trials: Iterable[Trial]) -> list[TrialSpec]:
    """The specs that name their views, all but those of random pairs."""
    return [trial.spec for trial in trials if isinstance(trial.spec, TrialSpec)]


def canonical_json(value: Any) -> str:
    """Dataclasses and plain values as JSON with sorted keys: the same text on every machine."""
    return json.dumps(value, default=_plain, sort_keys=True, separators=(",", ":"), allow_nan=False)


def build_trials(experiment: Experiment, file: Path) -> tuple[Trial, ...]:
    """All trials of an experiment, in a fixed order; raises ConfigError, naming the file and key.

    The order is by repeat, pair and method, so that scans which are shared come close together.
    """
    scene = chosen(experiment.scene, SCENES, ("scene",), file)
    sensor = chosen(experiment.sensor, SENSORS, ("sensor",), file)
    methods = [
        chosen_method(choice, ("methods", index), file)
        for index, choice in enumerate(experiment.methods)
    ]
    scan = experiment.scan
    arm = None
    if experiment.arm is not None:
        arm = checked_params(ArmParams, experiment.arm, file, ("arm",))
    views = {
        name: _carried(view_spec(experiment, name, file), arm, experiment, file)
        for name in experiment.views
    }
    return tuple(
        Trial(
            TrialSpec(
                scene, sensor, scan.profiles, scan.step_mm, views[pair.target], views[pair.source],
                method, given, repeat, experiment.seed,
            ),
            name,
            choice.label or choice.name,
        )
        for repeat in range(experiment.repeats)
        for name, pair in experiment.pairs.items()
        for choice, method in zip(experiment.methods, methods, strict=True)
        for given in ("", *choice.given)
        # True segments and patches hold no noise: every repeat would be the same trial.
        if repeat == 0 or given in ("", "rotation")
    )  # fmt: skip


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


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        if isinstance(value, ViewSpec) and value.line is None:
            del fields["line"]  # so that trials without one keep the ids they had before lines
        return fields
    if isinstance(value, AimedView | StartView):
        return value.model_dump()
    raise TypeError(f"{type(value).__name__} cannot determine a trial")


def chosen(choice: Choice, registry: Mapping[str, Any], key: Key, file: Path) -> Chosen:
    """The entry of a registry that the config names, with checked parameters."""
    if choice.name not in registry:
        message = f"unknown {key[-1]} {choice.name!r}; {nearest(choice.name, registry)}"
        raise ConfigError(file, (*key, "name"), message)
    params_type = registry[choice.name].params_type
    return Chosen(choice.name, checked_params(params_type, choice.params, file, (*key, "params")))


def chosen_method(choice: MethodChoice, key: Key, file: Path) -> Chosen:
    """The method that the config names, with checked parameters, installed if it is a peer."""
    try:
        params_type = find_method(choice.name).params_type
    except UnknownMethodError:
        if ":" in choice.name:
            message = f"{choice.name!r} cannot be imported as package.module:function"
        else:
            message = f"unknown method {choice.name!r}; {nearest(choice.name, METHODS)}"
        raise ConfigError(file, (*key, "name"), message) from None
    if choice.given and choice.name != "thesis":
        raise ConfigError(
            file, (*key, "given"), "only method 'thesis' can be entered with the truth"
        )
    preset: dict[str, Any] = {}
    if choice.preset is not None:
        presets = _presets(params_type)
        if choice.preset not in presets:
            message = f"unknown preset {choice.preset!r}; {nearest(choice.preset, presets)}"
            raise ConfigError(file, (*key, "preset"), message)
        preset = dataclasses.asdict(getattr(params_type, choice.preset)())
    merged = _merged(preset, choice.params)
    params = checked_params(params_type, merged, file, (*key, "params"))
    calibration = getattr(params, "calibration", "")
    if calibration and not Path(calibration).is_file():
        message = f"{calibration} is no file below {Path.cwd()}; configs/precision.yaml makes one"
        raise ConfigError(file, (*key, "params", "calibration"), message)
    if choice.name in PEERS:
        try:
            check_installed(choice.name, params)
        except MissingPeerError as error:
            raise ConfigError(file, (*key, "name"), f"{choice.name}: {error}") from None
    return Chosen(choice.name, params)


def _presets(params_type: type) -> list[str]:
    """Names of the public class methods of a params type: each makes one set of parameters."""
    return [
        name
        for name, member in vars(params_type).items()
        if isinstance(member, classmethod) and not name.startswith("_")
    ]


def checked_params(params_type: type, params: dict[str, Any], file: Path | str, key: Key) -> Any:
    """Parameters as their dataclass, unknown names refused at every depth; raises ConfigError."""
    if not dataclasses.is_dataclass(params_type):
        return params
    config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    name = str(key[-1])
    fields: dict[str, Any] = {name: (params_type, ...)}
    model = create_model("Params", __config__=config, **fields)
    return getattr(validated(model, {name: params}, file, key[:-1]), name)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for name, value in changes.items():
        if isinstance(value, dict) and isinstance(base.get(name), dict):
            merged[name] = _merged(base[name], value)
        else:
            merged[name] = value
    return merged
