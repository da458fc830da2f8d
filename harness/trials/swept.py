"""The trials of all points of a sweep; what points have in common is checked and kept once."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from harness.config.errors import ConfigError, Key
from harness.config.overrides import key_path, looked_up, replaced
from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import AnyExperiment, checked_experiment
from harness.config.sweep_schema import Named, Sweep
from harness.recent import Recent
from harness.trials.points import MOST_POINTS, Point, point_count, shown_value, sweep_points
from harness.trials.random_pairs import build_random_trials
from harness.trials.specs import Trial, Trials, build_trials

# Pieces of configurations, and whole ones without their parameters, that are kept while building.
KEPT = 4096
KEPT_POINTS = 1024  # of which trials are taken in turn where several share their scans
AS_IT_IS = "as it is"  # a section of the configuration that a point leaves alone


def build_swept_trials(
    data: dict[str, Any], sweep: Sweep, defaults: dict[str, Any], file: Path
) -> Trials:
    """The trials of every point, point by point; raises ConfigError, naming file, point and key.

    data: the configuration as its file holds it, overrides applied. defaults: the same with every
    default written out, for what one_at_a_time leaves as it is.
    """
    count = point_count(sweep)
    if count > MOST_POINTS:
        raise ConfigError(file, ("sweep",), f"makes {count} points; expected {MOST_POINTS} at most")
    base = {name: value for name, value in data.items() if name not in ("sweep", "study")}
    paths = {
        key: [_path(base, each, file) for each in (key, *sweep.along.get(key, ()))]
        for key in sweep.over
    }
    _check_apart(paths, file)
    unchanged = {
        key: _as_it_is(values, looked_up(data, paths[key][0]), looked_up(defaults, paths[key][0]))
        for key, values in sweep.over.items()
    }
    builder = _Builder(file)
    try:
        points = sweep_points(sweep)
    except ValueError as error:
        raise ConfigError(file, ("sweep", "over"), str(error)) from None

    def of_point(number: int) -> tuple[Point, Trials]:
        point, changed = points[number], base
        try:
            for key, value in point.values.items():
                for path in paths[key]:
                    changed = replaced(changed, path, value)
        except (IndexError, TypeError, ValueError):
            message = f"{key} points nowhere once the keys before it are set"
            raise _at(point, file, message) from None
        if point.varied or not point.values:
            point = Point(point.number, point.varied, point.values, unchanged | point.shown)
        try:
            return point, builder.trials(changed)
        except ConfigError as error:
            raise _at(point, file, str(error).removeprefix(f"{file}: ")) from None

    return _joined(len(points), of_point)


def _joined(count: int, of_point: Callable[[int], tuple[Point, Trials]]) -> Trials:
    """The trials of so many points, one after the other; each point is checked at once."""
    lengths = np.zeros(count, dtype=np.int64)
    used: set[tuple[str, str]] = set()
    for number in range(count):
        _, trials = of_point(number)
        lengths[number] = len(trials)
        used |= trials.used
    ends = np.cumsum(lengths)
    recent = Recent(KEPT_POINTS)

    def trial(index: int) -> Trial:
        number = int(np.searchsorted(ends, index, side="right"))
        point, trials = recent.get(str(number), lambda: of_point(number))
        made = trials[index - int(ends[number] - lengths[number])]
        return Trial(made.spec, made.pair, made.label, point)

    return Trials(int(ends[-1]), trial, frozenset(used))


def _check_apart(paths: dict[str, list[Key]], file: Path) -> None:
    """Refuse keys of which the later one would undo the earlier one."""
    before: dict[Key, str] = {}
    for key, targets in paths.items():
        for path in targets:
            undone = next((name for earlier, name in before.items() if _begins(earlier, path)), "")
            if undone:
                message = f"sets again what {undone} has set; leave one of them out"
                if undone != key:
                    message += ", or sweep the larger section first"
                raise ConfigError(file, ("sweep", "over", key), message)
            before[path] = key


def _begins(path: Key, section: Key) -> bool:
    return path[: len(section)] == section


def _as_it_is(values: Any, written: Any, whole: Any) -> Any:
    """What a table calls a value that the experiment has: itself, or of a section its name.

    written, whole: as the file has it, and with every default.
    """
    if isinstance(values, Named):
        names = (name for name, value in values.named.items() if value in (written, whole))
        return next(names, AS_IT_IS if isinstance(whole, dict | list) else shown_value(whole))
    return AS_IT_IS if isinstance(whole, dict | list) else shown_value(whole)


def _at(point: Point, file: Path, message: str) -> ConfigError:
    told = ", ".join(f"{key}={point.shown[key]}" for key in point.values)
    where = f"point {point.number} ({told})" if told else f"point {point.number}"
    return ConfigError(file, ("sweep", "over"), f"{where}: {message}")


def _path(data: dict[str, Any], key: str, file: Path) -> Key:
    def problem(message: str) -> ConfigError:
        return ConfigError(file, ("sweep", "over", key), message)

    path = key_path(data, key, problem)
    if path[0] in ("sweep", "study", "title", "description", "experiment", "limits"):
        raise problem(f"{path[0]!r} cannot be swept")
    return path


class _Builder:
    """Builds trials of configurations that differ in little."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._outlines = Recent(KEPT)
        self._pieces = Recent(KEPT)

    def trials(self, data: dict[str, Any]) -> Trials:
        experiment = self._experiment(data)
        if isinstance(experiment, RandomPairsExperiment):
            return build_random_trials(experiment, self._file, self._pieces)
        return build_trials(experiment, self._file, self._pieces)

    def _experiment(self, data: dict[str, Any]) -> AnyExperiment:
        """The checked configuration; its outline without any parameters is checked once only."""
        sections = _with_params(data)
        params = {path: looked_up(data, path) for path in sections}
        if not all(isinstance(each, dict) for each in params.values()):
            return checked_experiment(data, self._file)  # it says what is wrong
        outline = data
        for path in sections:
            outline = replaced(outline, path, {})
        try:
            text = json.dumps(outline)
        except (TypeError, ValueError):
            return checked_experiment(data, self._file)
        experiment = self._outlines.get(text, lambda: checked_experiment(outline, self._file))
        filled: AnyExperiment = _filled(experiment, params)
        return filled


def _with_params(data: dict[str, Any]) -> list[Key]:
    """Where a configuration holds parameters, which their own dataclasses check."""
    choices: list[Key] = [("scene",), ("sensor",)]
    if isinstance(data.get("methods"), list):
        choices += [("methods", index) for index in range(len(data["methods"]))]
    if isinstance(data.get("families"), dict):
        choices += [("families", name, "scene") for name in data["families"]]
    found = []
    for choice in choices:
        section = looked_up(data, choice)
        if isinstance(section, dict) and "params" in section:
            found.append((*choice, "params"))
    return found


def _filled(experiment: Any, params: dict[Key, dict[str, Any]]) -> Any:
    """A checked outline with its parameters, which are checked where they are used."""
    for path, values in params.items():
        experiment = _copied(experiment, path, values)
    return experiment


def _copied(part: Any, path: Key, value: Any) -> Any:
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, int):
        return (*part[:step], _copied(part[step], rest, value), *part[step + 1 :])
    if isinstance(part, dict):
        return part | {step: _copied(part[step], rest, value)}
    return part.model_copy(update={step: _copied(getattr(part, str(step)), rest, value)})
