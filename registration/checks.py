"""Bounds of the parameters, each refused in one line that says what would have worked."""

from __future__ import annotations

import math
from typing import get_args


def within(owner: object, name: str, low: float, high: float, *, above_low: bool = False) -> None:
    """Raise ValueError, in one line, unless a number lies within its bounds."""
    value = getattr(owner, name)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if (
        not number
        or not math.isfinite(value)
        or value > high
        or value < low
        or (above_low and value == low)
    ):
        bound = f"above {low:g}" if above_low else f"at least {low:g}"
        ceiling = "" if math.isinf(high) else f" and at most {high:g}"
        raise ValueError(f"{type(owner).__name__}.{name} is {value!r}; must be {bound}{ceiling}")


def whole(owner: object, name: str, low: int) -> None:
    """Raise ValueError unless it is a whole number of at least low."""
    value = getattr(owner, name)
    if not isinstance(value, int) or isinstance(value, bool) or value < low:
        raise ValueError(
            f"{type(owner).__name__}.{name} is {value!r}; must be a whole number, at least {low}"
        )


def one_of(owner: object, name: str, choices: object) -> None:
    """Raise ValueError unless it is one of a Literal's choices."""
    value = getattr(owner, name)
    if value not in get_args(choices):
        known = ", ".join(get_args(choices))
        raise ValueError(f"{type(owner).__name__}.{name} is {value!r}; must be one of {known}")
