"""Sobol' indices: which parameters make the outcome differ when all of them change together."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from harness.config.sweep_schema import Sweep
from harness.figures.looks import GREY
from harness.figures.page import add_axes, new_figure
from harness.scoring.chance import LEVEL
from harness.studies.figures import COLOURS, foot_in, share_map
from harness.studies.numbers import ERRORS, RESAMPLES, listed, outcomes, without_unit
from harness.tables.sweeps import PREFIX
from harness.tables.table import Table
from harness.trials.points import point_count, salib_problem, short_names
from registration.scan import FloatArray

FAILURE = "Failure"
OUTPUTS = {FAILURE: "failed", **ERRORS}
SEED = 1  # of the bootstrap; SALib takes 0 for none
CELLS = 5  # of a map along either side


class IncompleteError(ValueError):
    """Some points of the design lack rows, so many do not; indices need all of them."""

    def __init__(self, done: int, points: int) -> None:
        super().__init__(f"{done} of {points} points of the design are complete")
        self.done, self.points = done, points


class Indices(NamedTuple):
    """First-order and total indices (keys,) and half the widths of their 95 % intervals."""

    first: FloatArray
    first_half: FloatArray
    total: FloatArray
    total_half: FloatArray


def sobol_indices(sweep: Sweep, outputs: FloatArray) -> Indices:
    """First-order and total Sobol' indices of the keys of a saltelli sweep, by SALib.

    outputs: (points,) in the order of the points. NaN of outputs that are all the same. Intervals
    are by its bootstrap over the samples of the design. Source: A. Saltelli et al., Comput. Phys.
    Commun. 181 (2010) 259.
    """
    from SALib.analyze import sobol  # it brings half of scipy.stats

    count = len(sweep.over)
    if np.ptp(outputs) == 0.0:
        return Indices(*np.full((4, count), np.nan))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a resample without any variance
        found = sobol.analyze(
            salib_problem(sweep), np.asarray(outputs, dtype=np.float64),
            calc_second_order=sweep.second_order, num_resamples=RESAMPLES, conf_level=LEVEL,
            seed=SEED,
        )  # fmt: skip
    return Indices(*(np.asarray(found[name]) for name in ("S1", "S1_conf", "ST", "ST_conf")))


def point_outputs(rows: pd.DataFrame) -> pd.DataFrame:
    """For each point its share of failures and its mean cut errors, over the same pairs.

    rows: of one method, as outcomes gives them. Index: the number of the point.
    """
    failed = rows.assign(failed=1.0 - rows["right"])
    return failed.groupby("sweep.point")[list(OUTPUTS.values())].mean().sort_index()


def indices_table(rows: pd.DataFrame, sweep: Sweep, names: Mapping[str, str]) -> Table:
    """One line a method, output and parameter; raises IncompleteError."""
    known = outcomes(rows)
    keys, points = list(sweep.over), point_count(sweep)
    called = short_names(keys) | dict(names)
    records = []
    trials = 0
    for method, of_method in known.groupby("method", sort=False):
        outputs = point_outputs(of_method)
        sizes = of_method.groupby("sweep.point").size()
        if len(outputs) != points or sizes.nunique() != 1:
            done = int((sizes == sizes.max()).sum())
            raise IncompleteError(done, points)
        trials = max(trials, len(of_method))
        for output, column in OUTPUTS.items():
            found = sobol_indices(sweep, outputs[column].to_numpy())
            for i, key in enumerate(keys):
                records.append(
                    {
                        "Method": method, "Output": output, "Parameter": called[key],
                        "First order": found.first[i],
                        "First low": found.first[i] - found.first_half[i],
                        "First high": found.first[i] + found.first_half[i],
                        "Total": found.total[i],
                        "Total low": found.total[i] - found.total_half[i],
                        "Total high": found.total[i] + found.total_half[i],
                    }
                )  # fmt: skip
    frame = pd.DataFrame(records)
    columns = ("First order", "First low", "First high", "Total", "Total low", "Total high")
    return Table(
        "study_indices",
        "Sobol' indices",
        "First order: share of the variance of the output that the parameter makes alone; total: "
        "that it takes part in; with 95 % intervals, which may reach beyond 0 and 1. "
        f"{points} points of the design, {trials} trials: the output of a point is its share of "
        "failures, or its mean error cut at 5 deg and 30 mm, failures counting as that, over the "
        "same pairs.",
        frame,
        dict.fromkeys(columns, ".2f"),
    )


def progress_table(error: IncompleteError) -> Table:
    """What there is in place of the indices while the design is incomplete."""
    frame = pd.DataFrame({"Points complete": [error.done], "of": [error.points]})
    return Table(
        "study_indices", "Sobol' indices", "Not yet.", frame, {"Points complete": "d", "of": "d"},
        note=f"\nNo indices yet: {error}.\nRun the rest first.",
    )  # fmt: skip


def indices_conclusion(frame: pd.DataFrame) -> tuple[str, str]:
    """What the table says of its first method, in two sentences."""
    own = frame[frame["Method"] == frame["Method"].iloc[0]]
    failure = own[own["Output"] == FAILURE]
    idle = listed(map(without_unit, failure.loc[failure["Total low"] <= 0.0, "Parameter"]))
    method = own["Method"].iloc[0]
    first = f"Every point fails equally often: no parameter decides whether {method} fails."
    if failure["Total"].notna().all():
        top, alike = _top(failure)
        first = (
            f"Whether {method} fails depends most on {without_unit(top['Parameter'])} (total index "
            f"{top['Total']:.2f} [{top['Total low']:.2f}, {top['Total high']:.2f}]; intervals that "
            f"overlap with it: {listed(alike)}); not told apart from no influence: {idle}."
        )
    tops = []
    for output, group in own[own["Output"] != FAILURE].groupby("Output", sort=False):
        if group["Total"].notna().any():
            top, alike = _top(group)
            beside = f" [{', '.join(alike)}]" if alike else ""
            parameter = without_unit(top["Parameter"])
            tops.append(f"the {without_unit(output).lower()} on {parameter}{beside}")
    if not tops:
        return first, "The errors do not differ between points either."
    together = own[own["First high"] < own["Total low"]]["Parameter"].unique()
    interplay = listed(map(without_unit, together))
    second = (
        f"Of the errors most depend {listed(tops)} (in brackets those that overlap); told to act "
        f"in interplay: {interplay}."
    )
    return first, second


def _top(group: pd.DataFrame) -> tuple[pd.Series[Any], list[str]]:
    """The line of the largest total index, and the parameters whose intervals overlap with its."""
    ordered = group.sort_values("Total", ascending=False, kind="stable")
    top, others = ordered.iloc[0], ordered.iloc[1:]
    overlapping = others.loc[others["Total high"] >= top["Total low"], "Parameter"]
    return top, [without_unit(name) for name in overlapping]


def draw_indices(frame: pd.DataFrame, note: str) -> Figure:
    """Bars of both indices with their intervals, a panel an output; frame: that of the table."""
    methods, outputs = list(frame["Method"].unique()), list(frame["Output"].unique())
    count = frame["Parameter"].nunique()
    tall, foot = 0.5 + 0.36 * count, foot_in(note)
    figure = new_figure(
        "Which parameters make the difference, when all change together?\nSobol' indices with "
        "their 95 % intervals; light: total, dark: first order",
        0.95 + (tall + 0.75) * len(methods) + foot,
        note,
    )
    for m, method in enumerate(methods):
        of_method = frame[frame["Method"] == method]
        order = of_method[of_method["Output"] == outputs[0]].sort_values("Total", kind="stable")
        parameters = order["Parameter"].tolist()
        for c, output in enumerate(outputs):
            group = of_method[of_method["Output"] == output].set_index("Parameter").loc[parameters]
            bottom = foot + 0.5 + (tall + 0.75) * (len(methods) - 1 - m)
            ax = add_axes(figure, 1.55 + 2.5 * c, bottom, 2.25, tall)
            places = np.arange(float(count))
            for shift, tint, name, low in (
                (0.17, "#9CC9E8", "Total", "Total low"),
                (-0.17, COLOURS[0], "First order", "First low"),
            ):
                values = group[name].to_numpy(dtype=float)
                half = values - group[low].to_numpy(dtype=float)
                ax.barh(places + shift, values, 0.32, color=tint)
                ax.errorbar(values, places + shift, xerr=half, fmt="none", ecolor=GREY, lw=1.1)
            ax.axvline(0.0, color=GREY, lw=0.8)
            ax.set_yticks(places, [without_unit(p) for p in parameters] if c == 0 else [])
            ax.set_title(str(output).lower() if len(methods) == 1 else f"{method}: {output}")
            ax.set_xlabel("share of the variance")
            ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
    return figure


def draw_failure_map(
    rows: pd.DataFrame, table: pd.DataFrame, sweep: Sweep, names: Mapping[str, str], note: str
) -> Figure:
    """Map of failures over the two parameters of the largest total index, of the first method."""
    method = table["Method"].iloc[0]
    of_failure = table[(table["Method"] == method) & (table["Output"] == FAILURE)]
    keys = list(sweep.over)
    called = short_names(keys) | dict(names)
    totals = of_failure["Total"].fillna(0.0).to_numpy(dtype=float)
    second, first = (keys[i] for i in np.argsort(totals, kind="stable")[-2:])
    known = outcomes(rows)
    known = known[known["method"] == method]
    across, across_names = _cells(known[PREFIX + first])
    up, up_names = _cells(known[PREFIX + second])
    shape = len(up_names), len(across_names)
    counts, failed = np.zeros(shape), np.zeros(shape)
    np.add.at(counts, (up, across), 1.0)
    np.add.at(failed, (up, across), 1.0 - known["right"].to_numpy(dtype=float))
    foot = foot_in(note)
    figure = new_figure(
        f"Where does {method} fail?\nShare of failures over the two parameters that matter most, "
        "whatever the others",
        4.6 + foot,
        note,
    )
    ax = add_axes(figure, 1.6, 0.65 + foot, 6.2, 3.1)
    share_map(ax, failed / np.maximum(counts, 1.0), counts, up_names, across_names)
    ax.invert_yaxis()
    ax.set(xlabel=called[first], ylabel=called[second])
    return figure


def _cells(values: pd.Series[Any]) -> tuple[Any, list[str]]:
    """The cell of each value: its own where there are few, else one of CELLS as full as others."""
    numbers = pd.to_numeric(values, errors="coerce")
    if numbers.isna().any():
        return pd.factorize(values)[0], [str(name) for name in pd.unique(values)]
    known = np.unique(numbers)
    if len(known) <= CELLS:
        return np.searchsorted(known, numbers), [f"{value:g}" for value in known]
    edges = np.quantile(numbers, np.linspace(0.0, 1.0, CELLS + 1))
    place = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, CELLS - 1)
    return place, [f"{a:.2g} to {b:.2g}" for a, b in pairwise(edges)]
