"""The figures of the discussion, one a question."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.discussion_tables import (
    ON_TOP,
    by_overlap,
    moved_errors,
    rms,
    rms_interval,
    table_of,
)
from experiments.discussion_trials import PLAIN, DiscussionExperiment
from harness.figures.looks import GREY, INK
from harness.figures.page import add_axes, new_figure, page_style, save
from harness.scoring.chance import wilson_interval
from harness.scoring.poses import COARSE
from harness.scoring.row_scores import within

METHODS = {"thesis": "#D55E00", "gauss_sphere": "#0072B2"}
MARKERS = {"thesis": "o", "gauss_sphere": "s"}
PAIRS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7")
QUARTILES = np.array([0.25, 0.5, 0.75])
DENSITIES = (PLAIN, "densest shift in 3D", "hierarchical shift")
DISTANCES = (PLAIN, "plane distances", "densest shift in 3D", "plane distances in 3D")
ICP = (PLAIN, "ICP on top", *ON_TOP)


def draw_discussion(
    experiment: DiscussionExperiment, rows: pd.DataFrame, turned: pd.DataFrame, folder: Path
) -> list[Path]:
    """Draw every question; returns the PNG files, those of an earlier run are removed."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    of = {name: rows[rows["question"] == name] for name in rows["question"].unique()}
    variants = {
        "densest_shift": ("Densest shift axis by axis, in 3D, or hierarchically?", DENSITIES),
        "plane_distances": ("Centroids or distances of planes?", DISTANCES),
        "icp_on_top": ("What is ICP on top worth?", ICP),
    }
    files = []
    with page_style():
        files.append(save(draw_turned(turned), folder / "rotation_error.png"))
        for name, (title, labels) in variants.items():
            files.append(save(draw_variants(of["stages"], title, labels), folder / f"{name}.png"))
        moved = draw_moved(of["moved"], experiment.moved.shift_mm)
        files.append(save(moved, folder / "y_against_z.png"))
        files.append(save(draw_overlap(of["overlap"]), folder / "overlap.png"))
        files.append(save(draw_bracket(of["bracket"]), folder / "bracket.png"))
    return files


def draw_turned(turned: pd.DataFrame) -> Figure:
    """Translation error over the angle by which the rotation is wrong."""
    figure = new_figure(
        "What does a rotation error do to the translation?\n"
        "Translation stage on the true rotation, turned about random axes",
        4.6,
        "Medians; bands hold the middle half of the trials. Dashed: by how much the turn alone "
        "moves the middle of the scene about the sensor, median.",
    )
    panels = (
        ("translation_error_mm", "of the translation, as the tables print it"),
        ("middle_error_mm", "of the middle of the scene"),
    )
    spread = turned.groupby(["method", "angle_deg"])["translation_error_mm"].quantile(0.75)
    top = float(spread.max())
    for c, (column, title) in enumerate(panels):
        ax = add_axes(figure, 0.75 + 4.2 * c, 0.95, 3.7, 2.75)
        for method, group in turned.groupby("method", sort=False):
            quartiles = group.groupby("angle_deg")[column].quantile(QUARTILES).unstack()
            colour = METHODS[str(method)]
            angles = quartiles.index.to_numpy(dtype=float)
            ax.fill_between(
                angles, quartiles[0.25], quartiles[0.75], color=colour, alpha=0.15, lw=0
            )
            ax.plot(angles, quartiles[0.5], color=colour, marker=MARKERS[str(method)], ms=4,
                    label=str(method))  # fmt: skip
        lever = turned.groupby("angle_deg")["lever_mm"].median()
        ax.plot(lever.index, lever, color=INK, ls="--", lw=1.0, label="lever")
        ax.set(xlabel="rotation error (°)", ylim=(0.0, 1.05 * top), title=f"Error {title}")
        ax.set_xlim(0.0, float(turned["angle_deg"].max()))
        if c == 0:
            ax.set_ylabel("error (mm)")
            ax.legend(loc="upper left")
    return figure


def draw_variants(rows: pd.DataFrame, title: str, labels: Sequence[str]) -> Figure:
    """Success and translation error of each variant, on scans and with the true rotation."""
    chosen = rows[rows["method"].isin(labels)]
    entries = [("on scans", chosen[chosen["given"] == ""])]
    entered = chosen[chosen["given"] != ""]
    if set(entered["method"]) == set(labels):
        entries.append(("entered with the true rotation", entered))
    tall = 0.42 * len(labels) + 0.35
    figure = new_figure(
        f"{title}\nOn the pairs of tables 6.1, 6.4 and 6.5",
        1.05 + (tall + 0.85) * len(entries),
        "Left: share of the trials that are right, within "
        f"{COARSE.rotation_deg:g}° and {COARSE.translation_mm:g} mm, with Wilson's 95 % interval. "
        "Right: a dot is an answer of status ok, the bar the median of a pair.",
    )
    pairs = sorted(set(rows["value"]))
    for r, (entry, group) in enumerate(entries):
        bottom = 0.95 + (tall + 0.85) * (len(entries) - 1 - r)
        shares = add_axes(figure, 1.75, bottom, 2.3, tall)
        errors = add_axes(figure, 4.35, bottom, 4.45, tall)
        _draw_shares(shares, group, labels)
        _draw_errors(errors, group, labels, pairs)
        shares.set_title(f"Right, {entry}", loc="left")
        errors.set_title(f"Translation error, {entry}", loc="left")
    handles = [
        Line2D([], [], ls="", marker="o", ms=5, color=colour, label=f"table {pair}")
        for pair, colour in zip(pairs, PAIRS, strict=False)
    ]
    figure.legend(handles=handles, loc="upper right", ncols=3, bbox_to_anchor=(0.99, 0.99))
    return figure


def _draw_shares(ax: Axes, rows: pd.DataFrame, labels: Sequence[str]) -> None:
    for y, label in enumerate(labels):
        group = rows[rows["method"] == label]
        if not len(group):
            continue
        right = int(within(group, COARSE).sum())
        low, high = wilson_interval(right, len(group))
        ax.plot([low, high], [y, y], color=GREY, lw=2.0, solid_capstyle="butt")
        ax.plot(right / len(group), y, "o", color=INK, ms=5)
        ax.annotate(f"{right}/{len(group)}", (right / len(group), y), (0, 5),
                    textcoords="offset points", ha="center", fontsize=7.5)  # fmt: skip
    ax.set(xlim=(-0.02, 1.09), ylim=(len(labels) - 0.4, -0.6), xlabel="share of the trials")
    ax.set_yticks(range(len(labels)), labels)
    ax.grid(axis="y", visible=False)


def _draw_errors(ax: Axes, rows: pd.DataFrame, labels: Sequence[str], pairs: Sequence[str]) -> None:
    for y, label in enumerate(labels):
        for k, pair in enumerate(pairs):
            chosen = (rows["method"] == label) & (rows["value"] == pair) & (rows["status"] == "ok")
            values = rows.loc[chosen, "translation_error_mm"].to_numpy(dtype=float)
            at = y + 0.26 * (k - (len(pairs) - 1) / 2.0)
            ax.plot(values, np.full(len(values), at), "o", ms=3.5, mew=0, alpha=0.7, color=PAIRS[k])
            if len(values):
                ax.plot([np.median(values)] * 2, [at - 0.12, at + 0.12], color=INK, lw=1.4)
    ax.set_xscale("log")
    ax.set(ylim=(len(labels) - 0.4, -0.6), xlabel="translation error (mm)")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_yticks(range(len(labels)), [""] * len(labels))
    ax.grid(axis="y", visible=False)


def draw_moved(rows: pd.DataFrame, shift_mm: float) -> Figure:
    """Errors along the three axes, of views moved along Y and along Z."""
    figure = new_figure(
        "Is the error along Y larger than along Z?\n"
        f"The desk from two places, {shift_mm:g} mm apart",
        4.6,
        "Root mean square with its 95 % bootstrap interval. Filled: the translation as the tables "
        "print it; hollow: where the middle of the scene comes to lie, without the lever of the "
        "rotation error.",
    )
    bounds = [
        rms_interval(errors[:, axis]) for *_, errors in moved_errors(rows) for axis in range(3)
    ]
    low, high = np.nanmin(bounds), np.nanmax(bounds)
    for c, moved in enumerate(dict.fromkeys(rows["value"])):
        ax = add_axes(figure, 0.75 + 4.2 * c, 0.95, 3.7, 2.75)
        entries = [e for e in moved_errors(rows) if e[1] == moved]
        for k, (method, _, where, known) in enumerate(entries):
            for axis in range(3):
                if not len(known):
                    continue
                at = axis + 0.17 * (k - (len(entries) - 1) / 2.0)
                ax.plot([at, at], rms_interval(known[:, axis]), color=METHODS[method], lw=1.4)
                hollow = where != "translation"
                ax.plot(at, rms(known[:, axis]), MARKERS[method], ms=6, color=METHODS[method],
                        mfc="white" if hollow else METHODS[method])  # fmt: skip
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter("{x:g}")
        ax.set_ylim(0.4 * low, 1.6 * high)
        ax.set_xticks(range(3), ["X, motion", "Y, lateral", "Z, depth"])
        answers = len(entries[0][3]), len(entries[-1][3])
        ax.set_title(f"Moved along {moved}: {answers[0]} and {answers[1]} answers")
        ax.grid(axis="x", visible=False)
        if c == 0:
            ax.set_ylabel("error (mm)")
    _legend(figure)
    return figure


def draw_overlap(rows: pd.DataFrame) -> Figure:
    """Share of right answers over the exact overlap, for each scene."""
    figure = new_figure(
        "How much overlap is needed?\n"
        "Two views turned against each other, which look past each other",
        4.6,
        "Share of the trials that are right, within "
        f"{COARSE.rotation_deg:g}° and {COARSE.translation_mm:g} mm, with Wilson's 95 % interval, "
        "at the mean overlap of each range; number of trials beside.",
    )
    for c, scene in enumerate(dict.fromkeys(rows["scene"])):
        ax = add_axes(figure, 0.75 + 4.2 * c, 0.95, 3.7, 2.75)
        for k, method in enumerate(METHODS):
            points = []
            for s, m, _, _, group in by_overlap(rows):
                if (s, m) != (scene, method):
                    continue
                right, at = int(within(group, COARSE).sum()), float(group["overlap"].mean())
                low, high = wilson_interval(right, len(group))
                at += 0.008 * (k - 0.5)
                ax.plot([at, at], [low, high], color=METHODS[method], lw=1.2, alpha=0.7)
                points.append((at, right / len(group)))
                if k == 0:
                    ax.annotate(f"{len(group)}", (at, 1.04), ha="center", fontsize=7.5, color=GREY)
            ax.plot(*np.transpose(points), marker=MARKERS[method], ms=5, color=METHODS[method],
                    label=method)  # fmt: skip
        ax.axhline(0.5, color=GREY, lw=0.8, ls=":")
        ax.set(xlim=(0.0, 1.0), ylim=(-0.03, 1.1), title=f"{scene.capitalize()}")
        ax.set_xlabel("overlap, the smaller share of the two views")
        if c == 0:
            ax.set_ylabel("share of the trials")
    _legend(figure)
    return figure


def _legend(figure: Figure) -> None:
    """The two methods, beside the title."""
    handles = [
        Line2D([], [], ls="", marker=MARKERS[m], ms=6, color=METHODS[m], label=m) for m in METHODS
    ]
    figure.legend(handles=handles, loc="upper right", ncols=2, bbox_to_anchor=(0.99, 0.99))


def draw_bracket(rows: pd.DataFrame) -> Figure:
    """Errors of the theoretical poses and of the estimates over the error of the bracket."""
    tables = sorted(set(table_of(rows)))
    tall = 2.1
    figure = new_figure(
        "What does the bracket do to the theoretical values?\n"
        "Distance from the exact pose, of the theoretical one and of the estimates",
        1.75 + (tall + 0.35) * len(tables),
        "Medians; bands hold the middle half of the answers of status ok, whose number stands "
        "beside where some trials have none. Where the theoretical pose is farther off than an "
        "estimate, it is no measure of it.",
    )
    panels = (("deg", "rotation", "rotation (°)"), ("mm", "translation", "translation (mm)"))
    for r, table in enumerate(tables):
        of_table = rows[table_of(rows) == table]
        for c, (unit, kind, label) in enumerate(panels):
            bottom = 0.95 + (tall + 0.35) * (len(tables) - 1 - r)
            ax = add_axes(figure, 0.75 + 4.2 * c, bottom, 3.6, tall)
            _draw_brackets(ax, of_table, f"theoretical_{unit}", f"{kind}_error_{unit}")
            ax.set_title(f"Table {table}, {label}")
            if r == len(tables) - 1:
                ax.set_xlabel("bracket error, times that of the desk's config")
            else:
                ax.tick_params(labelbottom=False)
            if r == c == 0:
                ax.legend(loc="lower right")
    return figure


def _draw_brackets(ax: Axes, rows: pd.DataFrame, theoretical: str, error: str) -> None:
    exact = rows.groupby("value")[theoretical].median()
    ax.plot(exact.index.to_numpy(dtype=float), exact, color=INK, ls="--", marker="^", ms=5,
            label="theoretical")  # fmt: skip
    for method, group in rows.groupby("method", sort=False):
        answered = group[group["status"] == "ok"]
        if answered.empty:
            continue
        column = answered.groupby("value")[error]
        quartiles = column.quantile(QUARTILES).unstack()
        colour, at = METHODS[str(method)], quartiles.index.to_numpy(dtype=float)
        ax.fill_between(at, quartiles[0.25], quartiles[0.75], color=colour, alpha=0.15, lw=0)
        ax.plot(at, quartiles[0.5], color=colour, marker=MARKERS[str(method)], ms=4,
                label=str(method))  # fmt: skip
        for times in at:
            asked = group[group["value"] == times]
            count = int((asked["status"] == "ok").sum())
            if count < len(asked):
                ax.annotate(f"{count} of {len(asked)}", (times, quartiles.loc[times, 0.5]), (-8, 6),
                            textcoords="offset points", fontsize=7.5)  # fmt: skip
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
