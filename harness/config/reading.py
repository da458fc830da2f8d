"""Reads, overrides and checks an experiment's file; the only place that reads YAML."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from harness.config.errors import ConfigError, Key, first_problem, nearest
from harness.config.overrides import key_path, replaced
from harness.config.random_schema import KIND, RandomPairsExperiment
from harness.config.schema import Experiment, MethodChoice
from harness.file_names import file_slug

AnyExperiment = Experiment | RandomPairsExperiment

PAIRS = "pairs"
# What `experiment` may say: those that experiments adds run as a whole or are made of parts.
KINDS = ("chapters", "discussion", PAIRS, "precision", "profiles", KIND)
LONGEST = 40  # characters of a value that a message repeats


class _Loader(yaml.SafeLoader):
    """The safe loader, refusing a key that is written twice, and telling what cannot be built."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)
            if isinstance(value, int):
                str(value)  # JSON has to write it, and there is a limit to the digits
        except (ValueError, AttributeError, LookupError, ArithmeticError):
            # As a date of month 13: what Python says of it would not help.
            text = str(node.value)
            shown = repr(text if len(text) <= LONGEST else f"{text[:LONGEST]}...")
            kind = node.tag.rpartition(":")[2]
            problem = f"{shown} cannot be read as {kind}; text goes in quotes"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark) from None
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        if not isinstance(node, yaml.MappingNode):  # `!!map` before something else
            return super().construct_mapping(node, deep)
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            line = key_node.start_mark.line + 1
            if not isinstance(key, str):
                raise yaml.MarkedYAMLError(
                    problem=f"key {key!r} in line {line} is no text; write it in quotes"
                )
            if key in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"key {key!r} is written twice, again in line {line}"
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


# YAML 1.1 takes 1e-3 for text, since it has no dot; everybody means the number.
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+"), list("-+0123456789")
)


def load_experiment(
    path: Path, overrides: Sequence[str] = (), seed: int | None = None
) -> AnyExperiment:
    """Read, override and check an experiment; raises ConfigError with one line.

    overrides: "dotted.key=value", the value in YAML, applied before anything is checked.
    seed: replaces the file's.
    """
    return checked_experiment(overridden_mapping(path, overrides, seed), path)


def checked_experiment(data: dict[str, Any], path: Path) -> AnyExperiment:
    """What a file holds as an experiment; raises ConfigError."""
    kind = _kind_of(data, path)
    if kind == KIND:
        random_pairs: RandomPairsExperiment = validated(RandomPairsExperiment, data, path)
        _check_labels(random_pairs.methods, path)
        return random_pairs
    if kind != PAIRS:
        message = f"is {kind!r}; expected {PAIRS!r} or {KIND!r} here"
        raise ConfigError(path, ("experiment",), message)
    keys = {name: value for name, value in data.items() if name != "experiment"}
    experiment: Experiment = validated(Experiment, keys, path)
    check_names(experiment, path)
    return experiment


def overridden_mapping(
    path: Path, overrides: Sequence[str] = (), seed: int | None = None
) -> dict[str, Any]:
    """What a file holds after the overrides, as for load_experiment, unchecked otherwise."""
    data = read_mapping(path)
    for override in overrides:
        data = _overridden(data, override, path)
    if seed is not None:
        data["seed"] = seed
    return data


def experiment_kind(path: Path) -> str:
    """What a file's key `experiment` says, "pairs" where it has none; raises ConfigError."""
    return _kind_of(read_mapping(path), path)


def _kind_of(data: Mapping[str, Any], path: Path) -> str:
    kind = data.get("experiment", PAIRS)
    if kind not in KINDS:
        message = f"unknown kind {kind!r}; {nearest(str(kind), KINDS)}"
        raise ConfigError(path, ("experiment",), message)
    return str(kind)


def read_mapping(path: Path) -> dict[str, Any]:
    """The mapping that a YAML file holds, unchecked but for duplicate keys; raises ConfigError."""
    try:
        data = _parsed(path.read_text(encoding="utf-8"))
    except OSError as error:
        beside = sorted(p.stem for p in path.parent.glob("*.yaml")) if path.parent.is_dir() else []
        reason = error.strerror or "cannot be read"
        hint = f"; {nearest(path.stem, beside)}" if beside else ""
        raise ConfigError(path, (), f"{reason[0].lower()}{reason[1:]}{hint}") from None
    except UnicodeDecodeError:
        raise ConfigError(path, (), "is not a text file in UTF-8") from None
    except _NotYAMLError as error:
        raise ConfigError(path, (), f"is not valid YAML: {error}") from None
    if not isinstance(data, dict):
        raise ConfigError(path, (), "should hold keys and values; see the files in configs/")
    return data


def validated(model: Any, data: Any, file: Path | str, key: Key = ()) -> Any:
    """The data as an instance of a pydantic model, without lax conversions; raises ConfigError."""
    try:
        text = json.dumps(data, allow_nan=False)
    except (TypeError, ValueError):
        try:
            where, value = next(_not_json(data, key))
        except RecursionError:
            raise ConfigError(file, key, "holds an anchor that refers to itself") from None
        raise ConfigError(file, where, f"should be text or a finite number, not {value}") from None
    try:
        return model.model_validate_json(text, strict=True)
    except ValidationError as error:
        inner, message = first_problem(error, model)
        raise ConfigError(file, (*key, *inner), message) from None


def dump_yaml(data: Any) -> str:
    """Plain data as YAML, keys in the given order."""
    text: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100)
    return text


def _not_json(data: Any, key: Key) -> Iterator[tuple[Key, Any]]:
    """What YAML can write and JSON can't, dates and infinities, with their keys."""
    if isinstance(data, dict):
        for name, value in data.items():
            yield from _not_json(value, (*key, name))
    elif isinstance(data, list):
        for index, value in enumerate(data):
            yield from _not_json(value, (*key, index))
    elif isinstance(data, float):
        if not math.isfinite(data):
            yield key, data
    elif not isinstance(data, str | int | None):
        yield key, data


class _NotYAMLError(Exception):
    """A text that YAML cannot read; the message is part of a line."""


def _parsed(text: str) -> Any:
    """What a text in YAML holds; raises _NotYAMLError."""
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise _NotYAMLError(_one_line(error)) from None
    except RecursionError:
        raise _NotYAMLError("it nests too deep") from None


def _one_line(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError):
        where = f" (line {error.problem_mark.line + 1})" if error.problem_mark else ""
        return f"{error.problem}{where}"
    return " ".join(str(error).split())


def _overridden(data: dict[str, Any], override: str, path: Path) -> dict[str, Any]:
    """The mapping with one dotted key set, as "key=value" says."""
    dotted, equals, text = override.partition("=")
    if not equals or not dotted:
        raise ConfigError(
            path, (), f"--set {override!r} should read key=value, as scan.profiles=40"
        )
    try:
        value = _parsed(text)
    except _NotYAMLError as error:
        raise ConfigError(path, (dotted,), f"--set: is not valid YAML: {error}") from None

    def problem(message: str) -> ConfigError:
        return ConfigError(path, (dotted,), f"--set: {message}")

    changed: dict[str, Any] = replaced(data, key_path(data, dotted, problem), value)
    return changed


def check_names(experiment: Experiment, path: Path) -> None:
    """Every view and pair that is referred to exists, and labels are told apart."""
    for name, pair in experiment.pairs.items():
        for role in ("source", "target"):
            view = getattr(pair, role)
            if view not in experiment.views:
                raise ConfigError(
                    path,
                    ("pairs", name, role),
                    f"unknown view {view!r}; {nearest(view, experiment.views)}",
                )
        if pair.source == pair.target:
            raise ConfigError(path, ("pairs", name), "source and target are the same view")
    for name in experiment.compaction:
        if name not in experiment.views:
            message = f"unknown view {name!r}; {nearest(name, experiment.views)}"
            raise ConfigError(path, ("compaction", name), message)
    for section in ("views", "pairs"):
        names = getattr(experiment, section)
        _check_files((((section, name), name, name) for name in names), path)
    _check_labels(experiment.methods, path)
    labels = [method.called for method in experiment.methods]
    whole = itertools.product(experiment.pairs, labels)
    _check_files(((("pairs", p), f"{p} by {m}", f"{p}_{m}") for p, m in whole), path)


def _check_labels(methods: Sequence[MethodChoice], path: Path) -> None:
    labels: set[str] = set()
    for index, method in enumerate(methods):
        label = method.called
        if label in labels:
            raise ConfigError(
                path,
                ("methods", index, "label"),
                f"{label!r} names two methods; give each a label of its own",
            )
        labels.add(label)
    named = enumerate(method.called for method in methods)
    _check_files(((("methods", i, "label"), label, label) for i, label in named), path)


def _check_files(names: Iterable[tuple[Key, str, str]], path: Path) -> None:
    """Refuse names that would overwrite each other's files: key, what to call it, the file's."""
    taken: dict[str, str] = {}
    for key, shown, name in names:
        slug = file_slug(name)
        other = taken.setdefault(slug, shown)
        if other != shown:
            message = f"{shown!r} and {other!r} would have the same files, {slug}; rename one"
            raise ConfigError(path, key, message)
