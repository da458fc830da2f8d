"""A configuration with every default written out, as it is kept beside the results."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Any

from harness.config.overrides import key_path
from harness.config.reading import AnyExperiment
from harness.trials.random_pairs import RandomSpec, family_of
from harness.trials.specs import Trial, full_specs


def resolved_config(experiment: AnyExperiment, base: Sequence[Trial]) -> dict[str, Any]:
    """The configuration with every default and preset written out; it makes the same trials.

    base: the trials of the experiment without its sweep. Where a sweep chooses another scene,
    sensor, method or preset, the parameters stay as they were written: those of one are no others'.
    """
    full = with_defaults(experiment, base)
    if experiment.sweep is None:
        return full
    if full["scan"].get("low_mm") is not None:
        del full["scan"]["profiles"]  # they are counted between the heights of each point
    written = experiment.model_dump(mode="json", exclude_none=True, by_alias=True)
    for dotted in experiment.sweep.over:
        path = key_path(written, dotted, ValueError)
        if path[-1] in ("name", "preset"):
            path = path[:-1]
        if "params" not in path and path[0] in written:
            full = _as_written(full, written, path)
    return full


def with_defaults(experiment: AnyExperiment, base: Sequence[Trial]) -> dict[str, Any]:
    """The configuration with every default and preset written out, whatever a sweep changes."""
    data = experiment.model_dump(mode="json", exclude_none=True, by_alias=True)
    data["sensor"]["params"] = _plain(base[0].spec.sensor.params)
    for trial in base:
        if isinstance(trial.spec, RandomSpec):
            family = data["families"][family_of(trial.pair)]
            family["scene"]["params"] = _plain(trial.spec.rules.scene.params)
    specs = full_specs(base)
    if specs:
        data["scene"]["params"] = _plain(specs[0].scene.params)
    arms = [view.arm for spec in specs for view in (spec.source, spec.target) if view.arm]
    if arms:
        data["arm"] = _plain(arms[0])
    params = {trial.label: trial.spec.method.params for trial in base}
    for method in data["methods"]:
        method.pop("preset", None)
        method["params"] = _plain(params[method.get("label", method["name"])])
    return data


def _as_written(full: Any, written: Any, path: Sequence[str | int]) -> Any:
    """The full configuration with one part of it as the file had it."""
    if not path or not isinstance(full, dict | list):
        return written
    step, rest = path[0], path[1:]
    if isinstance(full, list):
        return [
            _as_written(each, written[i], rest) if i == step else each
            for i, each in enumerate(full)
        ]
    if step not in written:
        return full
    return full | {step: _as_written(full[step], written[step], rest)}


def _plain(params: Any) -> Any:
    if not dataclasses.is_dataclass(params) or isinstance(params, type):
        return params
    return json.loads(json.dumps(dataclasses.asdict(params)))
