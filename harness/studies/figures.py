"""What the figures of studies and random pairs share: colours, intervals, maps of shares."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from harness.figures.looks import INK
from harness.figures.page import NOTE_CHARACTERS
from registration.scan import FloatArray

# Okabe and Ito's colours, safe for the colour-blind.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", INK)
FAILURES = "cividis_r"  # dark is bad; told apart by the colour-blind and in grey


def colours_of(methods: Iterable[str]) -> dict[str, str]:
    """A colour for each method, in their order; those beyond the palette begin it again."""
    return {method: COLOURS[i % len(COLOURS)] for i, method in enumerate(methods)}


def with_interval(ax: Axes, x: FloatArray, frame: pd.DataFrame, column: str, colour: str) -> None:
    """A curve of a column of record_of with its interval as a band."""
    low, high = (frame[f"{column} {end}"].to_numpy(dtype=float) for end in ("low", "high"))
    ax.fill_between(x, low, high, color=colour, alpha=0.18, lw=0)
    ax.plot(x, frame[column].to_numpy(dtype=float), "o-", color=colour, lw=1.5, ms=3.5)


def ticks(ax: Axes, places: FloatArray, labels: Sequence[str], log: bool) -> None:
    """These ticks and no others along x; fewer labels where they would touch."""
    if log:
        ax.set_xscale("log")
    ax.xaxis.set_minor_locator(NullLocator())
    every = 1 if len(labels) <= 6 else 2
    shown = [label if i % every == 0 else "" for i, label in enumerate(labels)]
    ax.set_xticks(places, shown)


def logarithmic(ax: Axes, which: Literal["x", "y"], values: FloatArray) -> None:
    """A logarithmic axis with plain numbers, where there is any value to show on it."""
    if not np.isfinite(values).any():
        return
    ax.set(**{f"{which}scale": "log"})
    axis = ax.xaxis if which == "x" else ax.yaxis
    spread = np.nanmax(values) / np.nanmin(values)
    steps = (1.0, 2.0, 5.0) if spread < 50.0 else (1.0, 3.0)  # more would touch on narrow panels
    axis.set_major_locator(LogLocator(subs=steps) if spread >= 10.0 else MaxNLocator(4))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def method_legend(figure: Figure, colours: dict[str, str], **look: Any) -> None:
    """The methods at the top right of a page, where there are several."""
    if len(colours) > 1:
        handles = [Line2D([], [], color=c, label=m, lw=1.6, **look) for m, c in colours.items()]
        figure.legend(handles=handles, loc="upper right", ncols=len(handles))


def share_map(
    ax: Axes, shares: FloatArray, counts: FloatArray, rows: Sequence[str], columns: Sequence[str]
) -> None:
    """A map of shares (rows, columns), written into its cells; empty where nothing was counted."""
    shown = np.where(counts > 0, shares, np.nan)
    ax.imshow(shown, cmap=FAILURES, vmin=0.0, vmax=1.0, aspect="auto")
    for r, c in np.argwhere(counts > 0):
        colour = "white" if shown[r, c] > 0.48 else INK
        ax.text(c, r, f"{shown[r, c]:.0%}", ha="center", va="center", color=colour, size=8.5)
    ax.set_xticks(np.arange(len(columns)), columns)
    ax.set_yticks(np.arange(len(rows)), rows)
    ax.grid(False)
    ax.tick_params(length=0)


def foot_in(note: str) -> float:
    """Height in inches that a note takes at the foot of a page."""
    return 0.2 + 0.16 * len(textwrap.wrap(note, NOTE_CHARACTERS))
