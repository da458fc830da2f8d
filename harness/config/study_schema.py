"""What the key `study` of an experiment may say: the question it answers, and how it is drawn."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from harness.config.strict import Strict
from harness.config.sweep_schema import Design, Named, Range, Sweep

Kind = Literal["curves", "indices", "overlap", "effects", "grid", "ranking"]

# The design of the sweep that a kind of study reads; None for one without a sweep.
DESIGNS: dict[Kind, Design | None] = {
    "curves": "one_at_a_time",
    "indices": "saltelli",
    "overlap": None,
    "effects": "product",
    "grid": "product",
    "ranking": None,
}

# What the values of a study of effects are called: without any, with all, and by effect.
NONE, ALL = "none", "all"
EFFECT_KINDS = ("only", "all but", "twice")


class Study(Strict):
    """The question of an experiment.

    kind: "curves", how success and error run with each key of a sweep one_at_a_time; "indices",
        Sobol' indices of the keys of a saltelli sweep; "overlap", success and error against the
        overlap of the views; "effects", what each of the named values of the only swept key does
        (none, all, "only X", "all but X", "twice X"); "grid", a map of failures over scan.profiles
        and scan.step_mm; "ranking", every method side by side.
    names: by swept key, what figures and tables call it, with its unit.
    profiles_per_s: for "grid": how fast the sensor takes profiles.
    """

    kind: Kind
    names: dict[str, str] = Field(default_factory=dict)
    profiles_per_s: float = Field(default=40.0, gt=0.0)

    def check(self, sweep: Sweep | None) -> None:
        """Whether a study of this kind can be made of the sweep; raises ValueError."""
        wanted = DESIGNS[self.kind]
        if wanted is None:
            if sweep is not None:
                raise ValueError(f"a study of kind {self.kind} has no sweep; take `sweep` out")
            if self.names:
                raise ValueError(f"`names` says nothing to a study of kind {self.kind}")
            return
        if sweep is None or sweep.design != wanted:
            found = "there is none" if sweep is None else f"not {sweep.design}"
            raise ValueError(
                f"a study of kind {self.kind} needs a sweep of design {wanted}, {found}"
            )
        unknown = [key for key in self.names if key not in sweep.over]
        if unknown:
            raise ValueError(f"`names` has {unknown[0]}, which is not swept")
        if self.kind == "effects" and len(sweep.over) != 1:
            raise ValueError(f"a study of kind effects sweeps one key, not {len(sweep.over)}")
        if self.kind == "indices" and len(sweep.over) < 2:
            raise ValueError("a study of kind indices sweeps two keys or more: of one, it is all")
        if self.kind == "grid" and set(sweep.over) != {"scan.profiles", "scan.step_mm"}:
            raise ValueError("a study of kind grid sweeps scan.profiles and scan.step_mm")
        # Told now, not when thousands of trials have ended.
        for key, values in sweep.over.items():
            if self.kind == "effects":
                _check_effects(key, values)
            elif self.kind in ("curves", "grid"):
                _check_numbers(self.kind, key, values)


def _check_effects(key: str, values: Any) -> None:
    names = list(values.named) if isinstance(values, Named) else []
    known = [
        name in (NONE, ALL) or any(name.startswith(f"{kind} ") for kind in EFFECT_KINDS)
        for name in names
    ]
    if ALL not in names or not all(known):
        wrong = f"not {names[known.index(False)]!r}" if not all(known) else f"{ALL!r} among them"
        raise ValueError(
            f"a study of kind effects needs values of {key} named {NONE!r}, {ALL!r}, "
            f"{', '.join(repr(f'{kind} X') for kind in EFFECT_KINDS)}, {wrong}"
        )


def _check_numbers(kind: Kind, key: str, values: Any) -> None:
    if isinstance(values, Range):
        return
    named = isinstance(values, Named)
    for value in values.named if named and kind == "curves" else [values] if named else values:
        try:
            number = not isinstance(value, bool | Named) and float(value)
        except (TypeError, ValueError, OverflowError):
            number = False
        if number is False:
            shown = repr(value) if not isinstance(value, Named) else "names"
            or_names = ", or names that are," if kind == "curves" else ""
            raise ValueError(
                f"a study of kind {kind} needs numbers{or_names} of {key}, not {shown}"
            )
