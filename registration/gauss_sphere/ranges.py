"""Which numbers parameters may be: no compiled loop is given one that it cannot run with."""

from __future__ import annotations

import math
from dataclasses import fields

from registration.checks import whole, within

# With 0 these allow nothing, or leave something out; all others count, measure or divide.
MAY_BE_ZERO = frozenset(
    (
        "max_gap_pixels", "split_gain", "tolerance_sigma", "join_gain", "edge_pixels", "starts",
        "contradiction_weight", "worth_settling", "worth_refining", "widest_mm", "missing_pixels",
        "least_support", "weak_support", "most_contradiction", "sure_planes", "large_support",
        "plain_contradiction", "appeal_support", "appeal_planes", "turned_planes", "turned_denied",
        "rival_share", "repeat_share", "repeat_planes", "repeat_contradiction", "sliding_planes",
        "sliding_contradiction", "consistent_share", "most_floor_mm", "floor_share", "rounds",
        "moved_distance2", "refuted_share", "refuting_share", "confirmed_share", "denied_share",
        "dropped_share", "silent_planes", "silent_share", "peak_share", "carried_mm", "least_mm",
        "flat_to_mm", "sure",
    )
)  # fmt: skip


class Checked:
    """A stage's parameters, refused in one line where a number is none that it may be.

    8 becomes 8.0 where numbers need not be whole: for another kind, loops would compile anew.
    """

    def __post_init__(self) -> None:
        _check(self)


def _check(stage: object) -> None:
    """Raise ValueError unless each number is one that it may be.

    Numbers are like the defaults: whole or not, alone or several. Where a stage has several lists,
    their entries belong together.
    """
    several = {}
    for field in fields(stage):  # type: ignore[arg-type]  # each heir of Checked is a dataclass
        name, default = field.name, field.default
        if isinstance(default, tuple):
            several[name] = _numbers(stage, name, isinstance(default[0], int))
        elif isinstance(default, int):
            whole(stage, name, 0 if name in MAY_BE_ZERO else 1)
        elif isinstance(default, float):
            within(stage, name, 0.0, math.inf, above_low=name not in MAY_BE_ZERO)
            object.__setattr__(stage, name, float(getattr(stage, name)))
    if len(set(several.values())) > 1:
        counts = ", ".join(f"{name} {count}" for name, count in several.items())
        raise ValueError(f"{type(stage).__name__} has {counts} numbers; must be as many of each")


def _numbers(stage: object, name: str, are_whole: bool) -> int:
    """How many numbers a list holds; raises ValueError unless these are above 0, one at least."""
    value, kind = getattr(stage, name), int if are_whole else int | float
    good = isinstance(value, tuple) and value and all(
        isinstance(one, kind) and not isinstance(one, bool) and 0 < one < math.inf for one in value
    )  # fmt: skip
    if not good:
        wanted = f"a tuple of {'whole ' if are_whole else ''}numbers above 0"
        raise ValueError(f"{type(stage).__name__}.{name} is {value!r}; must be {wanted}")
    if not are_whole:
        object.__setattr__(stage, name, tuple(map(float, value)))
    return len(value)
