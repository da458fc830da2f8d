"""Dotted keys: where they point in a configuration, and what it is with another value there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from harness.config.errors import Key, nearest

Problem = Callable[[str], Exception]


def key_path(data: Any, dotted: str, problem: Problem) -> Key:
    """The steps that a dotted key takes through a configuration.

    Names that themselves hold dots ("6.4") are matched against what is there; an entry of a list
    goes by its index, a method also by its label. Steps into what is not there stay as written.
    problem: the error that a message is raised as.
    """
    path: list[str | int] = []
    here, parts = data, dotted.split(".")
    while parts:
        if isinstance(here, list):
            index, width = _entry(here, parts, problem)
            path.append(index)
            here = here[index]
        elif isinstance(here, dict) or here is None:
            width = _matching_width(here or {}, parts)
            name = ".".join(parts[:width])
            path.append(name)
            here = (here or {}).get(name)
        else:
            raise problem(f"nothing called {'.'.join(parts)!r} can lie in a value")
        parts = parts[width:]
    return tuple(path)


def replaced(data: Any, path: Sequence[str | int], value: Any) -> Any:
    """The configuration with another value at a path; what the path does not touch is shared."""
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, int):
        entries = list(data)
        entries[step] = replaced(entries[step], rest, value)
        return entries
    mapping = dict(data or {})
    mapping[step] = replaced(mapping.get(step), rest, value)
    return mapping


def looked_up(data: Any, path: Sequence[str | int]) -> Any:
    """What a configuration holds at a path, or None."""
    for step in path:
        inside = isinstance(data, dict) and step in data
        if not inside and not (isinstance(data, list) and isinstance(step, int)):
            return None
        data = data[step]
    return data


def _matching_width(here: dict[str, Any], parts: list[str]) -> int:
    for width in range(len(parts), 1, -1):
        if ".".join(parts[:width]) in here:
            return width
    return 1


def _entry(here: list[Any], parts: list[str], problem: Problem) -> tuple[int, int]:
    """The index of an entry of a list, and how many parts name it."""
    if parts[0].isdecimal() and int(parts[0]) < len(here):
        return int(parts[0]), 1
    labels = [
        str(entry.get("label", entry.get("name"))) if isinstance(entry, dict) else ""
        for entry in here
    ]
    for width in range(len(parts), 0, -1):
        name = ".".join(parts[:width])
        if name in labels:
            return labels.index(name), width
    known = [] if parts[0].isdecimal() else [label for label in labels if label]
    by_name = f", nor a label; {nearest(parts[0], known)}" if known else ""
    raise problem(f"{parts[0]!r} is no index from 0 to {len(here) - 1}{by_name}")
