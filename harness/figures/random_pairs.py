"""The figures of an experiment on random pairs, one a question."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator
from scipy.stats import chi2

from harness.figures.looks import GREY
from harness.figures.of_rows import RANDOM
from harness.figures.page import add_axes, new_figure, page_style, save
from harness.scoring.chance import wilson_interval
from harness.scoring.normalised_errors import COUNTED, squared_distances
from harness.scoring.poses import COARSE, FINE
from harness.scoring.row_scores import within
from harness.studies.figures import COLOURS, colours_of
from harness.tables.pairs import NAMES
from harness.tables.random_groups import PARTS, THRESHOLDS, grouped, in_band, with_family
from harness.tables.random_pairs import bound_table

MOST_METHODS = len(COLOURS)  # more cannot be told apart
CROWD = 4  # methods from which on their intervals would hide each other


def draw_random_figures(rows: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what the tables say; returns the files, PNG."""
    known = legible(with_family(rows))
    folder.mkdir(parents=True, exist_ok=True)
    figures = {
        "success": draw_success,
        "bound": draw_bound,
        "calibration": draw_calibration,
        "times": draw_times,
    }
    files = []
    for name, draw in figures.items():
        with page_style():
            figure = draw(known)
            if figure is not None:
                files.append(save(figure, folder / f"{RANDOM}{name}.png"))
    return files


def legible(rows: pd.DataFrame) -> pd.DataFrame:
    """As many methods as can be told apart: the first, and the others most often right."""
    methods = list(rows["method"].unique())
    if len(methods) <= MOST_METHODS:
        return rows
    right = pd.Series(within(rows, COARSE), index=rows.index).groupby(rows["method"]).sum()
    others = right.drop(methods[0]).sort_values(ascending=False, kind="stable")
    kept = [methods[0], *others.index[: MOST_METHODS - 1]]
    return rows[rows["method"].isin(kept)].assign(left_out=len(methods) - len(kept))


def _legend(figure: Figure, rows: pd.DataFrame, marker: str = "") -> None:
    """The methods below the figure, and how many are left out."""
    look = {"ls": "", "marker": marker, "ms": 5} if marker else {"lw": 1.6}
    colours = colours_of(rows["method"].unique())
    handles = [Line2D([], [], label=m, color=colour, **look) for m, colour in colours.items()]
    note = None
    if "left_out" in rows.columns:
        left_out = rows["left_out"].iloc[0]
        note = (
            f"The first method and the others most often right; {left_out} more are in the tables"
        )
    figure.legend(handles=handles, loc="lower center", ncols=3, title=note, title_fontsize=8.5)


def _legend_in(rows: pd.DataFrame) -> float:
    """Height of the legend in inches."""
    lines = (rows["method"].nunique() + 2) // 3
    return 0.25 + 0.22 * (lines + ("left_out" in rows.columns))


def draw_success(rows: pd.DataFrame) -> Figure | None:
    """Success rate against the tolerance, by scenes and overlap, with Wilson's interval."""
    families, colours = list(rows["family"].unique()), colours_of(rows["method"].unique())
    legend_in = _legend_in(rows)
    figure = new_figure(
        "How often is a method right?\nShare of pairs answered ok and within the tolerance"
        + (", with Wilson's 95 % interval" if len(colours) < CROWD else ""),
        0.8 + 2.6 * len(families) + legend_in,
    )
    angles = [tolerance.rotation_deg for tolerance in THRESHOLDS]
    marked = [THRESHOLDS[0], FINE, COARSE]
    shown = [band for band in PARTS if len(in_band(rows, band))]
    apart_in = 8.4 / max(len(shown), 3)
    for r, family in enumerate(families):
        for c, band in enumerate(shown):
            bottom = legend_in + 0.5 + 2.6 * (len(families) - 1 - r)
            ax = add_axes(figure, 0.75 + apart_in * c, bottom, apart_in - 0.5, 1.6)
            of_band = in_band(rows[rows["family"] == family], band)
            pairs = of_band["pair"].nunique()
            for i, (method, colour) in reversed(list(enumerate(colours.items()))):
                group = of_band[of_band["method"] == method]
                if len(group):
                    # Later methods wider and below, so that equal curves show all their colours.
                    width = 1.4 + 0.5 * i
                    _curve(ax, group, angles, colour, width, interval=len(colours) < CROWD)
            ax.set(xscale="log", ylim=(-0.02, 1.02), xlim=(angles[0], angles[-1]))
            ax.set_xticks([t.rotation_deg for t in marked])
            ax.set_xticklabels([f"{t.rotation_deg:g}°\n{t.translation_mm:g} mm" for t in marked])
            for label, side in zip(ax.get_xticklabels(), ("left", "center", "center"), strict=True):
                label.set(horizontalalignment=side)
            ax.minorticks_off()
            ax.set_title(f"{family.replace('_', ' ')}: {pairs} pairs\noverlap {band.name}")
            if c == 0:
                ax.set_ylabel("share of pairs")
    _legend(figure, rows)
    return figure


def _curve(
    ax: Axes,
    group: pd.DataFrame,
    angles: list[float],
    colour: str,
    width: float,
    interval: bool,
) -> None:
    right = [int(within(group, tolerance).sum()) for tolerance in THRESHOLDS]
    if interval:
        low, high = np.transpose([wilson_interval(k, len(group)) for k in right])
        ax.fill_between(angles, low, high, color=colour, alpha=0.15, lw=0)
    ax.plot(angles, np.array(right) / len(group), color=colour, lw=width)


def draw_bound(rows: pd.DataFrame) -> Figure | None:
    """Errors in units of the Cramer-Rao bound, by parameter."""
    table = bound_table(rows).frame
    if not len(table):
        return None
    table = table[table["Scenes"] == table["Scenes"].iloc[0]]  # all scenes, if there are several
    colours = colours_of(rows["method"].unique())
    legend_in = _legend_in(rows)
    figure = new_figure(
        "How far from the limit is a method?\nErrors of the successes by their Cramer-Rao bounds; "
        "dot: root mean square, dash: by the median",
        4.1 + legend_in,
    )
    places = np.arange(6.0)
    for c, counted in enumerate(COUNTED):
        ax = add_axes(figure, 0.75 + 4.2 * c, legend_in + 0.4, 3.85, 2.6)
        of_bound = table[table["Bound from"] == counted]
        shift = 0.7 / max(len(colours), 1)
        for i, (method, colour) in enumerate(colours.items()):
            group = of_bound[of_bound["Method"] == method].set_index("Error")
            if not len(group):
                continue
            x = places + shift * (i - 0.5 * (len(colours) - 1))
            squares, medians = (
                group.loc[name, list(NAMES)].to_numpy(float)
                for name in ("root mean square", "by the median")
            )
            ax.vlines(x, medians, squares, color=colour, lw=1.2)
            ax.plot(x, squares, "o", ms=4.5, color=colour)
            ax.plot(x, medians, "_", ms=8, mew=1.6, color=colour)
        ax.axhline(1.0, color=GREY, lw=1.0)
        ax.set(yscale="log", xlim=(-0.6, 5.6))
        ax.set_xticks(places, ["rot. X", "rot. Y", "rot. Z", "X", "Y", "Z"])
        ax.set_title(f"bound from {counted}")
        if c == 0:
            ax.set_ylabel("error / bound")
    _legend(figure, rows, marker="o")
    return figure


def draw_calibration(rows: pd.DataFrame) -> Figure | None:
    """Share of errors inside the covariance's ellipsoid against what it should be."""
    answered = rows[rows["status"] == "ok"]
    colours = colours_of(rows["method"].unique())
    distances = {
        method: squared_distances(group)
        for _, method, group in grouped(answered.assign(family="all"))
    }
    distances = {method: values for method, values in distances.items() if len(values)}
    if not distances:
        return None
    figure = new_figure(
        "Does a method know how sure it is?\nShare of the answers marked ok inside the "
        "covariance's ellipsoid",
        5.3,
    )
    ax = add_axes(figure, 0.75, 0.55, 3.9, 3.9)
    levels = np.linspace(0.0, 1.0, 101)
    ax.plot(levels, levels, color=GREY, lw=1.0, label="right covariances")
    for method, values in distances.items():
        shares = [(values <= chi2.ppf(level, 6)).mean() for level in levels]
        label = f"{method},\n{len(values)} answers"
        ax.plot(levels, shares, lw=1.6, label=label, color=colours[method])
    for method in colours:
        if method not in distances:
            ax.plot([], [], ls="", label=f"{method}:\nno covariances")
    ax.set(xlim=(0, 1), ylim=(0, 1.01), aspect="equal")
    ax.set(xlabel="share that should lie inside", ylabel="share that lies inside")
    ax.legend(loc="upper left", bbox_to_anchor=(1.03, 1.0), borderaxespad=0.0)
    return figure


def draw_times(rows: pd.DataFrame) -> Figure | None:
    """Distribution of the time of a registration, by method."""
    if rows["ms_registration"].isna().all():  # no trial came as far
        return None
    legend_in = _legend_in(rows)
    figure = new_figure(
        "How long does a registration take?\nShare of pairs that are done after that time, with "
        "as many processes as the command was given",
        4.9 + legend_in,
    )
    ax = add_axes(figure, 0.9, legend_in + 0.5, 7.7, 3.5)
    for method, colour in colours_of(rows["method"].unique()).items():
        times = np.sort(rows.loc[rows["method"] == method, "ms_registration"].dropna().to_numpy())
        if len(times):
            shares = np.arange(1, len(times) + 1) / len(times)
            ax.step(times, shares, where="post", lw=1.6, color=colour)
    ax.set(xscale="log", ylim=(0, 1.01), xlabel="time of a registration (ms)")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.set_ylabel("share of pairs")
    _legend(figure, rows)
    return figure
