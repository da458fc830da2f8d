"""An experiment as frozen trials, each with an id that is a hash of all that determines it."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, create_model
from scipy.spatial.transform import RigidTransform

from harness.config import (
    AimedView,
    Choice,
    Experiment,
    MethodChoice,
    PrintedPose,
    RelativeView,
    RotationLabels,
    Truth,
    validated,
)
from harness.config_errors import ConfigError, Key, nearest
from harness.scoring import pose_from_parameters
from registration.methods import METHODS, UnknownMethodError, find_method
from scenes import SCENES
from sensors import SENSORS
from sensors.paths import ViewPath, aimed_view, straight_line

Vector = tuple[float, float, float]

# For each reading of the labels, which printed angle is the turn about the sensor's X, Y, Z.
LABEL_ORDER: dict[RotationLabels, tuple[int, int, int]] = {
    "printed": (0, 1, 2),
    "swapped": (2, 1, 0),
    "cyclic": (2, 0, 1),
}


@dataclass(frozen=True)
class Chosen:
    """An entry of a registry with all its parameters, defaults filled in."""

    name: str
    params: Any


@dataclass(frozen=True)
class PoseStep:
    """One change of frame on the way to a view; psi, phi, theta as in (4-6), then (4-7)."""

    rotation_deg: Vector
    translation_mm: Vector
    inverted: bool

    @property
    def pose(self) -> RigidTransform:
        """The frame that is reached, in the frame before."""
        pose = pose_from_parameters(np.array(self.rotation_deg), np.array(self.translation_mm))
        return pose.inv() if self.inverted else pose


@dataclass(frozen=True)
class ViewSpec:
    """Where one view is taken from, in the numbers of the config: an aimed view and steps from it.

    The name is part of it: two views from one place are two scans.
    """

    name: str
    aim: AimedView
    steps: tuple[PoseStep, ...]

    def path(self, profiles: int, step_mm: float) -> ViewPath:
        """The straight viewing line of this view."""
        yaw_rad, pitch_rad, roll_rad = np.deg2rad(
            [self.aim.yaw_deg, self.aim.pitch_deg, self.aim.roll_deg]
        ).tolist()
        T_world_view = aimed_view(
            self.aim.aim_mm, self.aim.distance_mm, yaw_rad, pitch_rad, roll_rad, profiles, step_mm
        )
        for step in self.steps:
            T_world_view = T_world_view * step.pose
        return straight_line(T_world_view, profiles, step_mm)


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


@dataclass(frozen=True)
class Trial:
    """A trial with the names that the config gives its pair and its method."""

    spec: TrialSpec
    pair: str
    label: str

    @property
    def id(self) -> str:
        """The id of the spec: names change nothing."""
        return self.spec.id


def canonical_json(value: Any) -> str:
    """Dataclasses and plain values as JSON with sorted keys: the same text on every machine."""
    return json.dumps(value, default=_plain, sort_keys=True, separators=(",", ":"), allow_nan=False)


def build_trials(experiment: Experiment, file: Path) -> tuple[Trial, ...]:
    """All trials of an experiment, in a fixed order; raises ConfigError, naming the file and key.

    The order is by repeat, pair and method, so that scans which are shared come close together.
    """
    scene = _chosen(experiment.scene, SCENES, "scene", file)
    sensor = _chosen(experiment.sensor, SENSORS, "sensor", file)
    methods = [
        _chosen_method(choice, ("methods", index), file)
        for index, choice in enumerate(experiment.methods)
    ]
    views = {name: _view_spec(experiment, name, file) for name in experiment.views}
    scan = experiment.scan
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


def relabelled(pose: PrintedPose, labels: RotationLabels) -> tuple[Vector, Vector]:
    """psi, phi, theta in degrees and the translation in mm of a pose the thesis printed."""
    x, y, z = (pose.rotation_deg[index] for index in LABEL_ORDER[labels])
    return (x, y, z), pose.translation_mm


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, AimedView):
        return value.model_dump()
    raise TypeError(f"{type(value).__name__} cannot determine a trial")


def _chosen(choice: Choice, registry: Mapping[str, Any], key: str, file: Path) -> Chosen:
    if choice.name not in registry:
        raise ConfigError(
            file, (key, "name"), f"unknown {key} {choice.name!r}; {nearest(choice.name, registry)}"
        )
    params = checked_params(registry[choice.name].params_type, choice.params, file, (key, "params"))
    return Chosen(choice.name, params)


def _chosen_method(choice: MethodChoice, key: Key, file: Path) -> Chosen:
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
    params = _merged(preset, choice.params)
    return Chosen(choice.name, checked_params(params_type, params, file, (*key, "params")))


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
    model = create_model("Params", __config__=config, params=(params_type, ...))
    return validated(model, {"params": params}, file, key[:-1]).params


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for name, value in changes.items():
        if isinstance(value, dict) and isinstance(base.get(name), dict):
            merged[name] = _merged(base[name], value)
        else:
            merged[name] = value
    return merged


def _view_spec(experiment: Experiment, name: str, file: Path) -> ViewSpec:
    """Follow a view to the aimed view that it hangs on, in the order from there to here."""
    steps: list[PoseStep] = []
    seen = [name]
    while not isinstance(view := experiment.views[seen[-1]], AimedView):
        key = ("views", seen[-1])
        if isinstance(view, RelativeView):
            other, field = view.relative_to, "relative_to"
            step = PoseStep(view.rotation_deg, view.translation_mm, inverted=False)
        else:
            other, step = _placing(experiment, seen[-1], view.placed_by, file)
            field = "placed_by"
        if other not in experiment.views:
            message = f"unknown view {other!r}; {nearest(other, experiment.views)}"
            raise ConfigError(file, (*key, field), message)
        if other in seen:
            chain = " -> ".join([*seen, other])
            raise ConfigError(file, (*key, field), f"goes in a circle: {chain}")
        steps.insert(0, step)
        seen.append(other)
    return ViewSpec(name, view, tuple(steps))


def _placing(experiment: Experiment, name: str, pair_name: str, file: Path) -> tuple[str, PoseStep]:
    """The other view of a pair, and the printed pose as the step from it to this view."""
    key = ("views", name, "placed_by")
    if pair_name not in experiment.pairs:
        message = f"unknown pair {pair_name!r}; {nearest(pair_name, experiment.pairs)}"
        raise ConfigError(file, key, message)
    pair = experiment.pairs[pair_name]
    if name not in (pair.source, pair.target):
        raise ConfigError(file, key, f"pair {pair_name!r} does not have this view")
    if pair.printed is None:
        raise ConfigError(file, key, f"pair {pair_name!r} has no printed pose")
    rotation_deg, translation_mm = relabelled(pair.printed, experiment.rotation_labels)
    if name == pair.source:
        return pair.target, PoseStep(rotation_deg, translation_mm, inverted=False)
    return pair.source, PoseStep(rotation_deg, translation_mm, inverted=True)
