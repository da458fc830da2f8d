"""A wrong configuration as one line: file, dotted key, what is wrong and what would be right."""

from __future__ import annotations

import dataclasses
import difflib
import types
import typing
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Discriminator, Tag, ValidationError

Key = tuple[str | int, ...]
UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")  # of a model, of a dataclass

# What YAML has in place of what JSON calls them.
WORDS = {"a valid array": "a list", "a valid tuple": "a list", "an object": "keys and values"}


class ConfigError(ValueError):
    """A configuration that cannot be run; the message is the whole line that the user needs."""

    def __init__(self, file: Path | str, key: Iterable[str | int], message: str) -> None:
        dotted = ".".join(str(part) for part in key)
        super().__init__(f"{file}: {dotted}: {message}" if dotted else f"{file}: {message}")


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name closest to the one that was written, or the whole list, as an ending."""
    names = [str(entry) for entry in known]
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"known are {', '.join(names)}" if names else "none is known here"


def first_problem(error: ValidationError, model: Any) -> tuple[Key, str]:
    """The key and the message of the first thing that a validation found wrong.

    model: the pydantic model or dataclass that was validated; its fields give the nearest name.
    """
    # An unknown key often is the misspelt form of a missing one: report the unknown key then.
    problem = min(error.errors(), key=lambda found: found["type"] not in UNKNOWN_KEY)
    key, parent, kind = _walk(model, problem["loc"])
    if problem["type"] in UNKNOWN_KEY:
        where = f" where the kind is {kind!r}" if kind else ""
        return key, f"unknown key{where}; {nearest(str(key[-1]), _fields(parent))}"
    if problem["type"] in ("missing", "missing_argument"):
        return key, "is missing"
    if problem["type"] == "too_short":
        least = problem["ctx"]["min_length"]
        return key, f"needs at least {least} {'entry' if least == 1 else 'entries'}"
    message = problem["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    if message != problem["msg"].removeprefix("Value error, "):
        message = f"should be {WORDS.get(message, message)}"
    given = problem.get("input")
    if isinstance(given, str | int | float | bool) or given is None:
        shown = "nothing" if given is None else repr(given)
        message += f", not {shown}"
    return key, message


def _walk(model: Any, loc: Sequence[str | int]) -> tuple[Key, Any, str]:
    """The location without union tags, the type that holds its last part, and that one's tag."""
    key: list[str | int] = []
    here, parent, kind, tag = model, model, "", ""
    for part in loc:
        tagged = _tagged(here)
        if part in tagged:
            here, tag = tagged[str(part)], str(part)
            continue
        key.append(part)
        parent, here = here, _inside(here, part)
        kind, tag = tag, ""
    return tuple(key), parent, kind


def _tagged(annotation: Any) -> dict[str, Any]:
    """The members of a union with a callable discriminator, by tag."""
    if not any(isinstance(m, Discriminator) for m in getattr(annotation, "__metadata__", ())):
        return {}
    members: dict[str, Any] = {}
    for member in typing.get_args(typing.get_args(annotation)[0]):
        for mark in getattr(member, "__metadata__", ()):
            if isinstance(mark, Tag):
                members[mark.tag] = typing.get_args(member)[0]
    return members


def _inside(annotation: Any, part: str | int) -> Any:
    """The type of one field, item or value of a model, a dataclass or a container."""
    fields = _fields(annotation)
    if part in fields:
        return fields[str(part)]
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _inside(arguments[0], part)
    if origin in (typing.Union, types.UnionType):
        inner = [a for a in arguments if a is not type(None)]
        return _inside(inner[0], part)
    if origin is dict:
        return arguments[1]
    if origin in (tuple, list):
        return arguments[0]
    return None


def _fields(annotation: Any) -> dict[str, Any]:
    """Names and types of the fields of a model or a dataclass, through Optional."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        fields = {}
        for name, info in annotation.model_fields.items():
            kind: Any = info.annotation
            for mark in info.metadata:
                kind = typing.Annotated[kind, mark]
            fields[info.alias or name] = kind
        return fields
    if isinstance(annotation, type) and dataclasses.is_dataclass(annotation):
        hints = typing.get_type_hints(annotation)
        return {field.name: hints[field.name] for field in dataclasses.fields(annotation)}
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        inner = [a for a in typing.get_args(annotation) if a is not type(None)]
        return _fields(inner[0]) if len(inner) == 1 else {}
    return {}
