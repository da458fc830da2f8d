"""Every method side by side: how often right, how exact, how sure and how fast."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from harness.figures.looks import GREY
from harness.figures.page import add_axes, new_figure
from harness.scoring.chance import LEVEL
from harness.scoring.poses import COARSE, FINE
from harness.scoring.row_scores import within
from harness.studies.figures import COLOURS, foot_in, logarithmic, share_map
from harness.studies.numbers import (
    gained_lost,
    listed,
    median_formats,
    medians_of,
    outcomes,
    share_of,
    smaller_p,
)
from harness.tables.random_groups import with_family
from harness.tables.table import Table

TIME = "Median time (ms)"
COMPARED = 0.5  # share right that a method needs for its exactness and speed to be compared


def ranking_table(rows: pd.DataFrame) -> Table:
    """One line a method, the most often right first; rows as store.load gives them.

    Medians of the errors are over the right ones, that of the time over all.
    """
    known = outcomes(with_family(rows))
    known["fine"] = within(known, FINE)
    records = []
    for method, group in known.groupby("method", sort=False):
        right = group[group["right"]]
        record: dict[str, Any] = {"Method": method, "Pairs": len(group)}
        record |= share_of("Right", group["right"]) | share_of("Fine", group["fine"])
        record["Wrong, marked ok"] = int((group["status"] == "ok").sum()) - len(right)
        record |= medians_of(right)
        record[TIME] = float(group["ms_registration"].median())
        for family, of_family in group.groupby("family", sort=False):
            record[f"Right on {family}"] = float(of_family["right"].mean())
        records.append(record)
    frame = pd.DataFrame(records)
    frame = frame.sort_values(["Right", "Fine"], ascending=False, kind="stable")
    formats = {"Pairs": "d", "Wrong, marked ok": "d", TIME: ".0f"}
    for column in frame.columns:
        if str(column).startswith(("Right", "Fine")):
            formats[str(column)] = ".0%"
    return Table(
        "study_ranking",
        "Every method side by side",
        f"Right: answered ok within {COARSE}; fine: within {FINE}; with Wilson's 95 % intervals. "
        "Medians of errors are over the right ones, with intervals by order statistics; that of "
        "the time of a registration is over all, with as many processes as the command was given.",
        frame.reset_index(drop=True),
        formats | median_formats(),
    )


def ranking_conclusion(rows: pd.DataFrame, frame: pd.DataFrame) -> tuple[str, str]:
    """Which method is most often right, and of the reliable ones the most exact and the fastest."""
    known = outcomes(rows)
    best = frame.iloc[0]
    top = known[known["method"] == best["Method"]]
    alike = [
        method
        for method in frame["Method"].iloc[1:]
        if gained_lost(known[known["method"] == method], top)[2] >= 1.0 - LEVEL
    ]
    first = (
        f"Most often right: {best['Method']}, {best['Right']:.0%} of {best['Pairs']} pairs "
        f"[{best['Right low']:.0%}, {best['Right high']:.0%}]; not told apart from it (sign test, "
        f"5 %): {listed(alike)}."
    )
    reliable = frame[frame["Right"] >= COMPARED]
    if reliable.empty:
        return first, f"No method is right on {COMPARED:.0%} of the pairs."
    name = "Median translation error (mm)"
    exact, fast = (
        reliable.iloc[int(np.argmin(reliable[column].to_numpy(dtype=float)))]
        for column in (name, TIME)
    )
    most = known[known["method"] == exact["Method"]]
    as_exact = [
        method
        for method in reliable["Method"]
        if method != exact["Method"]
        and smaller_p(known[known["method"] == method], most, "translation_error_mm") >= 1.0 - LEVEL
    ]
    told = f"; not told apart: {listed(as_exact)}" if as_exact else ""
    fastest = "" if fast["Method"] == exact["Method"] else f"{fast['Method']} "
    second = (
        f"Of those right on {COMPARED:.0%} or more, {exact['Method']} is the most exact (median "
        f"{exact['Median rotation error (deg)']:.2f} deg, {exact[name]:.1f} mm{told}) and "
        f"{fastest}the fastest (median {fast[TIME]:.0f} ms)."
    )
    return first, second


def draw_ranking(frame: pd.DataFrame, note: str) -> Figure:
    """Bars of success, medians, map of failures by scene; frame: that of ranking_table."""
    methods, foot = list(frame["Method"]), foot_in(note)
    families = [str(c).removeprefix("Right on ") for c in frame.columns if "Right on" in str(c)]
    tall = 0.3 + 0.32 * len(methods)
    figure = new_figure(
        f"Which method is best?\nShare right with 95 % interval: light within {COARSE}, dark "
        f"within {FINE}",
        1.45 + tall + foot,
        note,
    )
    places, bottom = np.arange(float(len(methods))), foot + 0.5
    ax = add_axes(figure, 2.1, bottom, 2.0, tall)
    for shift, tint, name in ((-0.18, "#9CC9E8", "Right"), (0.18, COLOURS[0], "Fine")):
        values = frame[name].to_numpy(dtype=float)
        ends = [frame[f"{name} {end}"].to_numpy(dtype=float) for end in ("low", "high")]
        ax.barh(places + shift, values, 0.34, color=tint)
        ax.hlines(places + shift, ends[0], ends[1], color=GREY, lw=1.2)
    ax.set(xlim=(0.0, 1.0), xlabel="share right")
    ax.set_yticks(places, methods)
    panels = [(4.3, "Median translation error (mm)", "translation (mm)", "median error")]
    panels += [(5.6, TIME, "time (ms)", "median time")]
    axes = [ax]
    for left, column, label, title in panels:
        ax = add_axes(figure, left, bottom, 1.15, tall)
        values = frame[column].to_numpy(dtype=float)
        ax.plot(values, places, "o", color=COLOURS[1], ms=5)
        if f"{column} low" in frame:
            low, high = (frame[f"{column} {e}"].to_numpy(dtype=float) for e in ("low", "high"))
            ax.hlines(places, low, high, color=COLOURS[1], lw=1.2)
        ax.set(xlabel=label, title=title)
        logarithmic(ax, "x", values)
        ax.set_yticks(places, [""] * len(methods))
        axes.append(ax)
    for ax in axes:
        ax.set_ylim(len(methods) - 0.5, -0.5)
    ax = add_axes(figure, 6.95, bottom, 1.9, tall)
    failed = 1.0 - frame[[f"Right on {family}" for family in families]].to_numpy(dtype=float)
    counts = np.isfinite(failed).astype(float)
    share_map(ax, failed, counts, [""] * len(methods), [f.replace("_", "\n") for f in families])
    ax.set_title("share that fails, by scene")
    return figure
