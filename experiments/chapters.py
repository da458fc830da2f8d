"""The experiment `chapters`: several configs in one run, as chapter 6 of the thesis is made of."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from experiments.precision import KIND as PRECISION
from experiments.precision import PrecisionExperiment, load_precision
from experiments.profile_pairs import KIND as PROFILES
from experiments.profile_pairs import ProfilesExperiment, load_profiles
from harness.config.errors import ConfigError, nearest
from harness.config.reading import PAIRS, experiment_kind, overridden_mapping, validated
from harness.config.schema import Experiment
from harness.config.strict import Strict
from harness.results import results_folder
from harness.session import Session, open_session
from harness.trials.specs import Trial

KIND = "chapters"
CALIBRATED = "gauss_sphere calibrated"
CALIBRATION = "calibration.json"


class Part(Strict):
    """One config of a run, and what is different here.

    config: the file, relative to the folder of this one.
    methods: labels of those of its methods that run, in this order; all when not given.
    calibrated_by: an earlier part that measures the sensor; gauss_sphere runs once more, as
        "gauss_sphere calibrated", with the calibration that it wrote in this run.
    set: keys of the config with other values, nested as in the file.
    """

    config: str
    methods: tuple[str, ...] | None = Field(default=None, min_length=1)
    calibrated_by: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)


class ChaptersExperiment(Strict):
    """Configs that run one after the other, and are summed up together.

    seed: of every part, in place of its own.
    """

    experiment: Literal["chapters"]
    title: str
    description: str = ""
    parts: dict[str, Part] = Field(min_length=1)
    seed: int | None = Field(default=None, ge=0)


@dataclass(frozen=True)
class PartRun:
    """One part as it runs: the kind of its experiment, its file, its folder and its overrides.

    calibration: the file that CALIBRATED waits for, or None.
    """

    name: str
    kind: str
    file: Path
    folder: Path
    overrides: tuple[str, ...]
    seed: int | None
    calibration: Path | None = None

    @property
    def waits(self) -> bool:
        """Whether a method is left out until its calibration has been measured."""
        return self.calibration is not None and not self.calibration.is_file()

    def session(self) -> Session:
        """The part as a session of trials; raises ConfigError."""
        return open_session(self.file, self.folder, self._overrides(), self.seed)

    def profiles(self) -> tuple[ProfilesExperiment, Sequence[Trial]]:
        """The part as pairs of profiles; raises ConfigError."""
        return load_profiles(self.file, self.overrides, self.seed)

    def check(self) -> Experiment | PrecisionExperiment:
        """Read the part and check all of it; raises ConfigError."""
        if self.kind == PRECISION:
            return load_precision(self.file, self.overrides, self.seed)[0]
        if self.kind == PROFILES:
            return self.profiles()[0]
        experiment = self.session().experiment
        assert isinstance(experiment, Experiment)
        return experiment

    def _overrides(self) -> list[str]:
        if self.calibration is None or self.waits:
            return list(self.overrides)
        data = overridden_mapping(self.file, self.overrides)
        calibrated = {
            "name": "gauss_sphere",
            "label": CALIBRATED,
            "params": {"calibration": str(self.calibration)},
            "figures": False,
        }
        return [*self.overrides, _override(("methods",), [*data["methods"], calibrated])]


def load_chapters(
    path: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> tuple[ChaptersExperiment, tuple[PartRun, ...]]:
    """Read a run and check every part of it; writes nothing. Raises ConfigError with one line."""
    data = overridden_mapping(path, overrides, seed)
    experiment: ChaptersExperiment = validated(ChaptersExperiment, data, path)
    folder = results_folder(folder, path.stem)
    runs: list[PartRun] = []
    for name, part in experiment.parts.items():
        if not name.isidentifier() or name in ("tables", "figures"):
            message = f"{name!r} is to be a folder beside tables and figures: give a plain word"
            raise ConfigError(path, ("parts", name), message)
        try:
            run = _part_run(name, part, experiment.seed, path, folder, runs)
            run.check()
        except ConfigError as error:
            if str(error).startswith(f"{path}: parts."):
                raise
            raise ConfigError(path, ("parts", name), str(error)) from None
        runs.append(run)
    return experiment, tuple(runs)


def _part_run(
    name: str,
    part: Part,
    seed: int | None,
    path: Path,
    folder: Path,
    before: Sequence[PartRun],
) -> PartRun:
    file = path.parent / part.config
    kind = experiment_kind(file)
    if kind not in (PAIRS, PROFILES, PRECISION):
        message = f"{part.config} is of kind {kind!r}; a part is one of pairs, profiles, precision"
        raise ConfigError(path, ("parts", name, "config"), message)
    overrides = [_override(key, value) for key, value in _leaves(part.set)]
    if part.methods is not None:
        overrides.append(_chosen_methods(file, overrides, part.methods, path, name))
    calibration = None
    if part.calibrated_by is not None:
        measures = {run.name: run for run in before if run.kind == PRECISION}
        if kind != PAIRS or part.calibrated_by not in measures:
            message = (
                "belongs to a part that registers whole scans"
                if kind != PAIRS
                else f"{part.calibrated_by!r} is no earlier part that measures the sensor; "
                f"{nearest(part.calibrated_by, measures)}"
            )
            raise ConfigError(path, ("parts", name, "calibrated_by"), message)
        calibration = measures[part.calibrated_by].folder / CALIBRATION
    return PartRun(name, kind, file, folder / name, tuple(overrides), seed, calibration)


def _chosen_methods(
    file: Path, overrides: Sequence[str], labels: Sequence[str], path: Path, name: str
) -> str:
    """The override that leaves a config the methods of these labels."""
    data = overridden_mapping(file, overrides)
    known = {
        str(method.get("label") or method.get("name")): method
        for method in data.get("methods") or ()
        if isinstance(method, Mapping)
    }
    for index, label in enumerate(labels):
        if label not in known:
            message = f"{file} has no method {label!r}; {nearest(label, known)}"
            raise ConfigError(path, ("parts", name, "methods", index), message)
    return _override(("methods",), [known[label] for label in labels])


def _leaves(changes: Mapping[str, Any], key: tuple[str, ...] = ()) -> Iterator[tuple[Any, Any]]:
    """Every value of nested keys that is no mapping itself, with its key."""
    for name, value in changes.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, (*key, name))
        else:
            yield (*key, name), value


def _override(key: Sequence[str], value: Any) -> str:
    """A key and its value as --set takes them; JSON is YAML."""
    return f"{'.'.join(key)}={json.dumps(value)}"
