"""How often and how closely methods are right against the exact overlap of the views."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from harness.figures.page import add_axes, new_figure
from harness.scoring.chance import LEVEL
from harness.studies.figures import colours_of, foot_in, logarithmic, method_legend, with_interval
from harness.studies.numbers import MEDIANS, RIGHT, median_formats, medians_of, outcomes, share_of
from harness.tables.random_groups import with_family
from harness.tables.table import Table

ENOUGH = 0.9  # share right from which on the overlap is said to be enough
ALL = "all"


def overlap_table(rows: pd.DataFrame, edges: Sequence[float]) -> Table:
    """One line a family, method and range of overlap.

    rows: as store.load gives them. edges: ends of the ranges of the smaller share of points that
    the other view sees, as fractions. Medians are over the right ones.
    """
    known = outcomes(with_family(rows))
    families = list(known["family"].unique())
    records = []
    for family in [ALL, *families] if len(families) > 1 else families:
        of_family = known if family == ALL else known[known["family"] == family]
        for method, of_method in of_family.groupby("method", sort=False):
            for low, high, group in ranges(of_method, edges):
                records.append(
                    {"Scenes": family, "Method": method, "From": low, "To": high}
                    | {"Mean overlap": group["overlap"].mean()}
                    | _record(group)
                )
    formats = dict.fromkeys(("From", "To", "Right", "Right low", "Right high"), ".0%")
    return Table(
        "study_overlap",
        "Accuracy against overlap",
        f"Overlap is the smaller of the two views' shares of points that the other sees. {RIGHT} "
        "Medians are over the right ones, with their 95 % interval by order statistics where there "
        "are 6 or more.",
        pd.DataFrame(records),
        formats | median_formats() | {"Mean overlap": ".0%", "Pairs": "d"},
    )


def ranges(
    rows: pd.DataFrame, edges: Sequence[float]
) -> Iterator[tuple[float, float, pd.DataFrame]]:
    """The ranges of overlap that hold rows, with these; the last one's end belongs to it.

    rows: with the column overlap, as with_family gives it. edges: as for overlap_table.
    """
    for low, high in pairwise(edges):
        last = high == edges[-1]
        inside = (rows["overlap"] >= low) & (
            (rows["overlap"] <= high) if last else (rows["overlap"] < high)
        )
        if inside.any():
            yield low, high, rows[inside]


def _record(group: pd.DataFrame) -> dict[str, Any]:
    shares = share_of("Right", group["right"])
    return {"Pairs": len(group), **shares, **medians_of(group[group["right"]])}


def overlap_conclusion(rows: pd.DataFrame, frame: pd.DataFrame) -> tuple[str, str]:
    """How success and the errors of the right ones run with overlap, a sentence each."""
    whole = frame[frame["Scenes"] == frame["Scenes"].iloc[0]]
    successes, trends = [], []
    known = outcomes(with_family(rows))
    for method, group in whole.groupby("Method", sort=False):
        least, most = group.iloc[0], group.iloc[-1]
        enough = ""
        for _, line in group.iloc[::-1].iterrows():
            if line["Right"] < ENOUGH:
                break
            enough = f", {ENOUGH:.0%} or more from {line['From']:.0%} on"
        successes.append(
            f"{method} {least['Right']:.0%} and {most['Right']:.0%}"
            + (enough or f", nowhere {ENOUGH:.0%}")
        )
        right = known[(known["method"] == method) & known["right"]]
        trends.append(f"{method} {_trend(right)}")
    first = (
        f"Right at an overlap of {whole['From'].iloc[0]:.0%} to {whole['To'].iloc[0]:.0%} and of "
        f"{whole['From'].max():.0%} to {whole['To'].max():.0%}: {'; '.join(successes)}."
    )
    return first, f"With more overlap the translation error of right ones: {'; '.join(trends)}."


def _trend(right: pd.DataFrame) -> str:
    """How the translation error of the right ones goes with overlap."""
    if len(right) < 6:
        return f"has too few right ones ({len(right)})"
    found = spearmanr(right["overlap"], right["translation_error_mm"])
    rho = float(found.statistic)
    if not found.pvalue < 1.0 - LEVEL:
        return f"shows no trend (rank correlation {rho:.2f}, {len(right)} pairs)"
    word = "falls" if rho < 0.0 else "rises"
    return f"{word} (rank correlation {rho:.2f}, {len(right)} pairs)"


def draw_overlap(frame: pd.DataFrame, note: str) -> Figure:
    """Success and errors against overlap, a row of panels a family; frame: that of the table."""
    families = list(frame["Scenes"].unique())
    colours = colours_of(frame["Method"].unique())
    foot = foot_in(note)
    figure = new_figure(
        "How much overlap does a method need?\nBy range of overlap, with 95 % intervals; errors "
        "are medians of the right ones",
        0.95 + 1.95 * len(families) + foot,
        note,
    )
    for r, family in enumerate(families):
        for c, column in enumerate(("Right", *MEDIANS)):
            bottom = foot + 0.45 + 1.95 * (len(families) - 1 - r)
            ax = add_axes(figure, 0.85 + 2.85 * c, bottom, 2.2, 1.35)
            for method, colour in colours.items():
                group = frame[(frame["Scenes"] == family) & (frame["Method"] == method)]
                x = 100.0 * group["Mean overlap"].to_numpy(dtype=float)
                with_interval(ax, x, group, column, colour)
            ax.set_title(
                f"{str(family).replace('_', ' ')}: {('success', 'rotation', 'translation')[c]}"
            )
            if column == "Right":
                ax.set_ylim(-0.03, 1.03)
                ax.set_ylabel("share right")
            else:
                ax.set_ylabel("error (deg)" if c == 1 else "error (mm)")
                shown = frame.loc[frame["Scenes"] == family, column]
                logarithmic(ax, "y", shown.to_numpy(dtype=float))
            if r == len(families) - 1:
                ax.set_xlabel("overlap (%)")
            ax.set_xlim(100.0 * frame["From"].min(), 100.0 * frame["To"].max())
    method_legend(figure, colours)
    return figure
