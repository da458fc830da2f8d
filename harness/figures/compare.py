"""The errors of two runs against each other, trial by trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from harness.figures.looks import GREY, INK, MARK, TARGET
from harness.figures.page import add_axes, new_figure, page_style, save
from harness.scoring.row_scores import ERRORS

SMALLEST = 1e-4  # deg and mm: what is less, as without noise, is drawn here
PANEL_IN = 3.2


def draw_comparison(pairs: pd.DataFrame, names: tuple[str, str], file: Path) -> Path:
    """Draw the errors of the second run over those of the first; returns the file.

    pairs: as of harness.tables.compare.matched.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with page_style():
        return save(_figure(pairs, names), file)


def _figure(pairs: pd.DataFrame, names: tuple[str, str]) -> Figure:
    note = (
        "One dot a trial with an estimate in both runs; below the line the second run is nearer to "
        "the truth. Blue: both right or both wrong; vermilion: only one is right."
    )
    figure = new_figure(f"{names[1]} against {names[0]}", PANEL_IN + 1.6, note)
    both = (pairs["right_a"] == pairs["right_b"]).to_numpy(bool)
    for place, (column, unit) in enumerate(ERRORS.items()):
        ax = add_axes(figure, 0.8 + place * 4.4, 1.0, PANEL_IN, PANEL_IN)
        a, b = (np.maximum(pairs[f"{column}_{end}"].to_numpy(np.float64), SMALLEST) for end in "ab")
        known = np.isfinite(a) & np.isfinite(b)
        values = np.concatenate([a[known], b[known], [1e-2, 1.0]])
        low, high = values.min() / 1.5, values.max() * 1.5
        ax.plot([low, high], [low, high], color=GREY, lw=1.0)
        for chosen, colour, marker in ((both, TARGET, "o"), (~both, MARK, "D")):
            shown = known & chosen
            ax.scatter(a[shown], b[shown], s=14, c=colour, marker=marker, lw=0, alpha=0.6)
        ax.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high), aspect="equal")
        kind = column.split("_")[0].capitalize()
        ax.set_xlabel(f"{kind} error in {names[0]} ({unit})", color=INK)
        ax.set_ylabel(f"{kind} error in {names[1]} ({unit})", color=INK)
    return figure
