"""How success and errors run with each parameter that a sweep changes one at a time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.figures.looks import GREY
from harness.figures.page import add_axes, new_figure
from harness.scoring.chance import LEVEL
from harness.studies.figures import colours_of, foot_in, method_legend, ticks, with_interval
from harness.studies.numbers import (
    CUT,
    ERRORS,
    RESAMPLES,
    RIGHT,
    beyond_chance,
    gained_lost,
    listed,
    outcomes,
    record_formats,
    record_of,
    without_unit,
)
from harness.tables.sweeps import PREFIX, swept_keys
from harness.tables.table import Table
from harness.trials.points import short_names
from registration.scan import FloatArray

COLUMNS = 3  # of panels


def curves_table(rows: pd.DataFrame, names: Mapping[str, str]) -> Table:
    """One line a parameter, value and method: how often right, how far off, beside the printed.

    rows: as store.load gives those of a sweep one_at_a_time. names: by swept key, what to call it.
    "As it is" marks the value that the experiment has; gained and lost are pairs that only this
    value, or only that one, has right, p the chance of so uneven a split (exact sign test).
    """
    known = outcomes(rows)
    keys = swept_keys(known)
    called = short_names(keys) | dict(names)
    records = []
    for method, of_method in known.groupby("method", sort=False):
        base = of_method[of_method["sweep.varied"] == ""]
        for key in keys:
            for value, group in _points(of_method, base, key):
                gained, lost, p = gained_lost(group, base)
                same = bool(set(group["id"]) == set(base["id"]))
                records.append(
                    {"Method": method, "Parameter": called[key], "Value": value, "As it is": same}
                    | record_of(group)
                    | {"Gained": gained, "Lost": lost, "p": np.nan if same else p}
                )
    frame = pd.DataFrame(records)
    frame["As it is"] = np.where(frame["As it is"], "yes", "")
    return Table(
        "study_curves",
        "One parameter at a time",
        f"{RIGHT} {CUT} Gained, lost: pairs that only this value, or only the one as it is, has "
        "right; p: chance of so uneven a split if both were alike (exact sign test).",
        frame,
        record_formats() | {"Value": ".4g", "Gained": "d", "Lost": "d", "p": ".2g"},
    )


def _points(
    rows: pd.DataFrame, base: pd.DataFrame, key: str
) -> Iterator[tuple[float, pd.DataFrame]]:
    """The values of a key in rising order, each with its rows, the experiment's own among them."""
    values = {}
    for shown, group in rows[rows["sweep.varied"] == key].groupby(PREFIX + key, sort=False):
        values[_number(shown)] = group
    if len(base):
        own = base[PREFIX + key].iloc[0]
        # A section of the configuration is no number; one of the named values is the same then.
        with contextlib.suppress(ValueError):
            values.setdefault(_number(own), base)
    yield from sorted(values.items(), key=lambda item: item[0])


def _number(shown: Any) -> float:
    try:
        return float(shown)
    except (TypeError, ValueError):
        message = f"{shown!r} is no number; a study of kind curves needs values or names that are"
        raise ValueError(message) from None


def curves_conclusion(rows: pd.DataFrame, frame: pd.DataFrame) -> tuple[str, str]:
    """What the table says of its first method, in two sentences; rows as for the table.

    Parameters are told apart by how far success goes with them, on the same pairs drawn anew.
    """
    method = frame["Method"].iloc[0]
    own = frame[frame["Method"] == method]
    known = outcomes(rows)
    drawn = _drawn_spans(known[known["method"] == method])
    spans: list[tuple[float, int, str, Any, Any]] = []
    for name, group in own.groupby("Parameter", sort=False):
        best, worst = group.loc[group["Right"].idxmax()], group.loc[group["Right"].idxmin()]
        spans.append((best["Right"] - worst["Right"], len(spans), without_unit(name), best, worst))
    spans.sort(key=lambda span: -span[0])

    def told(end: int) -> tuple[str, list[str]]:
        _, place, name, best, worst = spans[end]
        sign = 1.0 if end == 0 else -1.0
        alike = [
            other
            for _, at, other, _, _ in spans
            if at != place
            and np.quantile(sign * (drawn[:, place] - drawn[:, at]), 0.5 - LEVEL / 2) <= 0.0
        ]
        beside = f"; not told apart: {listed(alike)}" if alike else ""
        text = (
            f"{name} ({worst['Right']:.0%} right at {worst['Value']:g}, {best['Right']:.0%} at "
            f"{best['Value']:g}{beside})"
        )
        return text, alike

    most, as_much = told(0)
    first = f"Success of {method} hangs most on {most}"
    if len(spans) > 1 and spans[-1][2] not in as_much:
        first += f", least on {told(-1)[0]}"
    tested = own[own["As it is"] == ""]
    sure = tested[beyond_chance(tested["p"].tolist())]
    better, worse = sure[sure["Gained"] > sure["Lost"]], sure[sure["Gained"] < sure["Lost"]]
    second = (
        f"Changed alone, beyond chance over all {len(tested)} comparisons (Holm, 5 %), better than "
        f"as it is: {_values(better)}; worse: {_values(worse)}."
    )
    return f"{first}.", second


def _drawn_spans(rows: pd.DataFrame) -> FloatArray:
    """(RESAMPLES, keys) from the least to the largest share right over the values of each key.

    A bootstrap over the pairs that every point has; rows: of one method, as outcomes gives them.
    """
    right = rows.assign(right=rows["right"].astype(float)).pivot_table(
        index=["pair", "repeat"], columns="sweep.point", values="right"
    )
    right = right.dropna()
    varied = rows.groupby("sweep.point")["sweep.varied"].first().loc[right.columns]
    keys = swept_keys(rows)
    if right.empty:
        return np.zeros((RESAMPLES, len(keys)))
    n = len(right)
    times = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), size=RESAMPLES)
    shares = times @ right.to_numpy() / n
    each = [shares[:, varied.isin(["", key]).to_numpy()] for key in keys]
    return np.stack([np.ptp(of_key, axis=1) for of_key in each], axis=1)


def _values(frame: pd.DataFrame) -> str:
    groups = frame.groupby("Parameter", sort=False)["Value"]
    return listed(
        f"{without_unit(name)} {', '.join(f'{value:g}' for value in values)}"
        for name, values in groups
    )


def draw_success(frame: pd.DataFrame, note: str) -> Figure:
    """Share of right trials against each parameter; frame: that of curves_table."""
    title = (
        "How often is it right, with one parameter changed?\nShare of trials, 95 % interval; "
        "dashed: as it is"
    )
    return _page(frame, title, {"Right": "share right"}, note)


def draw_errors(frame: pd.DataFrame, note: str) -> Figure:
    """Mean errors against each parameter, failures at the cut; frame: that of curves_table."""
    title = (
        "How far off is it, with one parameter changed?\nMeans over all trials, cut at 5 deg and "
        "30 mm, failures counting as that; 95 % interval; dashed: as it is"
    )
    return _page(frame, title, {name: name.lower() for name in ERRORS}, note)


def _page(frame: pd.DataFrame, title: str, columns: Mapping[str, str], note: str) -> Figure:
    parameters = list(frame["Parameter"].unique())
    colours = colours_of(frame["Method"].unique())
    lines = -(-len(parameters) // COLUMNS)
    each, foot = 0.55 + 1.45 * len(columns), foot_in(note)
    figure = new_figure(title, 0.75 + each * lines + foot, note)
    for place, parameter in enumerate(parameters):
        line, column = divmod(place, COLUMNS)
        of_parameter = frame[frame["Parameter"] == parameter]
        for row, (name, label) in enumerate(columns.items()):
            bottom = foot + each * (lines - 1 - line) + 0.45 + 1.45 * (len(columns) - 1 - row)
            ax = add_axes(figure, 0.7 + 2.85 * column, bottom, 2.3, 1.3)
            for method, colour in colours.items():
                group = of_parameter[of_parameter["Method"] == method]
                with_interval(ax, group["Value"].to_numpy(dtype=float), group, name, colour)
            _own_value(ax, of_parameter)
            _along(ax, of_parameter["Value"].unique())
            ax.set_ylim(0.0, 1.0 if name == "Right" else None)
            if row < len(columns) - 1:
                ax.tick_params(labelbottom=False)
            else:
                ax.set_xlabel(parameter)
            if column == 0:
                ax.set_ylabel(label)
    method_legend(figure, colours)
    return figure


def _own_value(ax: Axes, frame: pd.DataFrame) -> None:
    own = frame.loc[frame["As it is"] == "yes", "Value"]
    if len(own):
        ax.axvline(float(own.iloc[0]), color=GREY, lw=1.0, ls="--")


def _along(ax: Axes, values: Any) -> None:
    places = np.sort(np.asarray(values, dtype=np.float64))
    ticks(ax, places, [f"{value:.3g}" for value in places], log=bool(places[0] > 0.0))
