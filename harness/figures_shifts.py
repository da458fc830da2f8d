"""The occurrence graph of the shifts between centroids (6.8)."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.figures_page import AXES, GREY, INK, MARK, TARGET, amount, new_figure
from harness.pair_view import PairView
from registration.scan import FloatArray
from registration.thesis.translation import Shifts

WIDTHS_MM = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)


def draw_shifts(pair: PairView, shifts: Shifts, title: str) -> Figure:
    """All shifts in 3D with the region of maximum occurrence, and their histogram on each axis."""
    chosen = int(shifts.chosen.sum())
    figure = new_figure(
        f"{title}\nShifts between the centroids of patches of like orientation", 5.4
    )
    grid = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0))
    space = figure.add_subplot(grid[:, 0], projection="3d")
    exact = np.asarray(pair.T_target_source_exact.translation)
    estimate = pair.result.T_target_source
    found = None if estimate is None else np.asarray(estimate.translation)
    _draw_space(space, shifts, exact, found)
    space.set_title(
        f"{amount(len(shifts.weights), 'shift')}, {chosen} in the region of maximum occurrence"
    )
    for axis in range(3):
        ax = figure.add_subplot(grid[axis, 1])
        _draw_histogram(ax, shifts, axis, exact, found)
    return figure


def _draw_space(ax: Any, shifts: Shifts, exact: FloatArray, found: FloatArray | None) -> None:
    """The 3D axes carry no types."""
    for mask, colour, size, alpha, name in (
        (~shifts.chosen, GREY, 5.0, 0.45, "shift"),
        (shifts.chosen, MARK, 12.0, 0.9, "shift in the region"),
    ):
        ax.scatter(*shifts.values_mm[mask].T, s=size, lw=0, color=colour, alpha=alpha, label=name)
    if np.isfinite(shifts.box_mm).all():
        for edge in _box_edges(shifts.box_mm):
            ax.plot(*edge.T, color=MARK, lw=1.0)
    ax.scatter(*exact, marker="x", s=55, color=INK, lw=1.5, label="exact translation")
    if found is not None:
        ax.scatter(*found, marker="+", s=70, color=TARGET, lw=1.8, label="estimate")
    ax.set(xlabel=f"Shift along {AXES[0]}", ylabel=f"Shift along {AXES[1]}", zlabel=AXES[2])
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=2)


def _draw_histogram(
    ax: Axes, shifts: Shifts, axis: int, exact: FloatArray, found: FloatArray | None
) -> None:
    values = shifts.values_mm[:, axis]
    low, high = float(values.min()), float(values.max())
    width = next((w for w in WIDTHS_MM if (high - low) / w <= 80), WIDTHS_MM[-1])
    edges = np.arange(np.floor(low / width), np.ceil(high / width) + 2) * width
    ax.hist(values, bins=edges.tolist(), color="#B5BDC4", label="all")
    ax.hist(values[shifts.chosen], bins=edges.tolist(), color=MARK, label="in the region")
    if np.isfinite(shifts.box_mm).all():
        ax.axvspan(*shifts.box_mm[:, axis], color=MARK, alpha=0.12, lw=0)
    ax.axvline(exact[axis], color=INK, lw=1.2, ls="--", label="exact")
    if found is not None:
        ax.axvline(found[axis], color=TARGET, lw=1.2, label="estimate")
    ax.set(xlabel=f"Shift along {AXES[axis]}", ylabel=f"shifts per {width:g} mm")
    if axis == 0:
        ax.legend(loc="best", fontsize=7.5)


def _box_edges(box_mm: FloatArray) -> list[FloatArray]:
    corners = [
        np.array([box_mm[i, 0], box_mm[j, 1], box_mm[k, 2]])
        for i, j, k in product((0, 1), repeat=3)
    ]
    return [
        np.array([a, b])
        for n, a in enumerate(corners)
        for b in corners[n + 1 :]
        if np.count_nonzero(a != b) == 1
    ]
