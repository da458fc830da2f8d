"""What each measurement effect of the sensor does: absent, alone, or twice as large."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from harness.config.study_schema import ALL, EFFECT_KINDS, NONE
from harness.figures.looks import GREY, INK
from harness.figures.page import add_axes, new_figure
from harness.studies.figures import COLOURS, foot_in
from harness.studies.numbers import (
    CUT,
    ERRORS,
    RIGHT,
    TRANSLATION,
    listed,
    mean_interval,
    outcomes,
    paired,
    record_formats,
    record_of,
)
from harness.tables.sweeps import PREFIX, swept_keys
from harness.tables.table import Table

LOOKS = {"only": ("o", COLOURS[0], COLOURS[0]), "all but": ("o", COLOURS[1], "white"),
         "twice": (">", COLOURS[2], COLOURS[2])}  # fmt: skip
CHANGE = "Change of translation (mm)"
LEAST_MM = 0.05  # a change that a sentence tells, as less prints as nothing


def effects_table(rows: pd.DataFrame) -> Table:
    """One line a method and named set of effects: how often right, how far off.

    rows: as store.load gives those of a sweep whose names are "none", "all", "only X", "all but X"
    or "twice X". The change is that of the mean cut translation error from "all", pair by pair.
    """
    known = outcomes(rows)
    (key,) = swept_keys(known)
    records = []
    for method, of_method in known.groupby("method", sort=False):
        whole = of_method[of_method[PREFIX + key] == ALL]
        for name, group in of_method.groupby(PREFIX + key, sort=False):
            kind, effect = _parts(str(name))
            (both,) = paired(group, whole, [ERRORS[TRANSLATION]])
            change = both[:, 0] - both[:, 1]
            low, high = mean_interval(change)
            records.append(
                {"Method": method, "Effects": name, "Kind": kind, "Effect": effect}
                | record_of(group)
                | {CHANGE: change.mean() if len(change) else np.nan}
                | {"Change low": low, "Change high": high}
            )
    formats = dict.fromkeys((CHANGE, "Change low", "Change high"), "+.1f")
    return Table(
        "study_effects",
        "Effects of the sensor",
        f"{RIGHT} {CUT} The change is that of the mean translation error from all effects, on the "
        "same pairs.",
        pd.DataFrame(records),
        record_formats() | formats,
    )


def _parts(name: str) -> tuple[str, str]:
    """Kind and effect: "all but ghosts" is ("all but", "ghosts"), "none" is ("none", "")."""
    for kind in EFFECT_KINDS:
        if name.startswith(f"{kind} "):
            return kind, name.removeprefix(f"{kind} ")
    return name, ""


def effects_conclusion(rows: pd.DataFrame, frame: pd.DataFrame) -> tuple[str, str]:
    """What leaving an effect out wins, and what one alone or doubled costs, by method.

    rows: as for the table.
    """
    known = outcomes(rows)
    (key,) = swept_keys(known)
    wins, costs = [], []
    for method, group in frame.groupby("Method", sort=False):
        means = group.set_index("Effects")[TRANSLATION]
        told = f"{method} ({_mm(means.get(ALL))} mm with all, {_mm(means.get(NONE))} with none)"
        without = group[(group["Kind"] == "all but") & (group["Change high"] < 0.0)]
        wins.append(f"{told}: {_changes(_change(without))}")
        twice = group[(group["Kind"] == "twice") & (group["Change low"] > 0.0)]
        alone = _alone(known[known["method"] == method], key)
        doubled = _change(twice)
        costs.append(f"{method} {_changes(alone)}, twice as large {_changes(doubled)}")
    first = f"Translation error falls, beyond chance (5 % each), without: {'; '.join(wins)}."
    return first, f"It grows, likewise, with one effect alone: {'; '.join(costs)}."


def _change(frame: pd.DataFrame) -> dict[str, float]:
    return dict(zip(frame["Effect"], frame[CHANGE], strict=True))


def _alone(rows: pd.DataFrame, key: str) -> dict[str, float]:
    """By effect, what it alone adds to the error without any, where that is beyond chance."""
    by_name = dict(list(rows.groupby(PREFIX + key, sort=False)))
    added = {}
    for name, group in by_name.items():
        kind, effect = _parts(str(name))
        if kind == "only" and NONE in by_name:
            (both,) = paired(group, by_name[NONE], [ERRORS[TRANSLATION]])
            change = both[:, 0] - both[:, 1]
            if mean_interval(change)[0] > 0.0:
                added[effect] = float(change.mean())
    return added


def _changes(changes: dict[str, float]) -> str:
    """Changes of the error by effect, the largest first, those that print as nothing left out."""
    large = sorted(changes.items(), key=lambda change: -abs(change[1]))
    return listed(f"{effect} ({mm:+.1f})" for effect, mm in large if abs(mm) >= LEAST_MM)


def _mm(value: Any) -> str:
    return "?" if value is None else f"{value:.1f}"


def draw_effects(frame: pd.DataFrame, note: str) -> Figure:
    """Failures and errors by effect, a row of panels a method; frame: that of the table."""
    methods = list(frame["Method"].unique())
    effects = [effect for effect in frame["Effect"].unique() if effect]
    tall, foot = 0.3 + 0.24 * len(effects), foot_in(note)
    figure = new_figure(
        "What does each effect of the sensor do?\nLines: dotted without any effect, solid with "
        "all. Means over all trials,\nerrors cut at 5 deg and 30 mm; 95 % intervals",
        1.25 + (tall + 0.75) * len(methods) + foot,
        note,
    )
    panels = {"share that fails": "Right"} | {name.lower(): name for name in ERRORS}
    for m, method in enumerate(methods):
        group = frame[frame["Method"] == method]
        for c, (label, column) in enumerate(panels.items()):
            bottom = foot + 0.5 + (tall + 0.75) * (len(methods) - 1 - m)
            ax = add_axes(figure, 1.1 + 2.65 * c, bottom, 2.4, tall)
            for name, style in ((NONE, ":"), (ALL, "-")):
                for value in _values(group[group["Effects"] == name], column)[0]:
                    ax.axvline(value, color=INK if name == ALL else GREY, ls=style, lw=1.1)
            for k, (kind, (marker, edge, face)) in enumerate(LOOKS.items()):
                of_kind = group[group["Kind"] == kind]
                places = np.array([effects.index(e) for e in of_kind["Effect"]], dtype=float)
                values, low, high = _values(of_kind, column)
                y = places + 0.22 * (k - 1)
                ax.hlines(y, low, high, color=edge, lw=1.0)
                ax.plot(values, y, marker, color=edge, mfc=face, ms=4.5)
            ax.set_ylim(len(effects) - 0.5, -0.5)
            ax.set_yticks(np.arange(len(effects)), effects if c == 0 else [""] * len(effects))
            ax.set_xlim(0.0, 1.0 if column == "Right" else None)
            ax.set_xlabel(label)
            if c == 0:
                ax.set_title(str(method), loc="left", weight="bold")
    handles = [
        Line2D([], [], ls="", marker=marker, color=edge, mfc=face, ms=5, label=f"{kind} this one")
        for kind, (marker, edge, face) in LOOKS.items()
    ]
    height = figure.get_size_inches()[1]
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(0.01, 1.0 - 0.68 / height), ncols=3
    )
    return figure


def _values(frame: pd.DataFrame, column: str) -> tuple[Any, Any, Any]:
    """Value and ends of its interval; of "Right" the share that fails."""
    value, low, high = (
        frame[name].to_numpy(dtype=float) for name in (column, f"{column} low", f"{column} high")
    )
    return (1.0 - value, 1.0 - high, 1.0 - low) if column == "Right" else (value, low, high)
