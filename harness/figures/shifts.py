"""The occurrence graph of the shifts between centroids (6.8)."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from harness.figures.looks import INK, MARK, TARGET
from harness.figures.page import AXES, add_axes, amount, new_figure
from harness.figures.pair_view import PairView
from registration.scan import BoolArray, FloatArray
from registration.thesis.translation import Shifts

WIDTHS_MM = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)


def draw_shifts(pair: PairView, shifts: Shifts, title: str) -> Figure:
    """All shifts in 3D with the region of maximum occurrence, and their histogram on each axis."""
    chosen = int(shifts.chosen.sum())
    figure = new_figure(
        f"{title}\nShifts between the centroids of patches of like orientation", 6.6
    )
    exact = np.asarray(pair.T_target_source_exact.translation)
    estimate = pair.result.T_target_source
    found = None if estimate is None else np.asarray(estimate.translation)
    whole: Any = add_axes(figure, 0.1, 3.4, 3.7, 2.3, projection="3d")
    _draw_space(whole, shifts, exact, found)
    whole.set_title(f"{amount(len(shifts.weights), 'shift')}, {chosen} in the densest region")
    if np.isfinite(shifts.box_mm).all():
        middle = shifts.box_mm.mean(axis=0)
        half_mm = max(1.5 * float(np.ptp(shifts.box_mm, axis=0).max()), 30.0)
        near: Any = add_axes(figure, 0.1, 0.65, 3.7, 2.3, projection="3d")
        shown = (np.abs(shifts.values_mm - middle) <= half_mm).all(axis=1)
        seen = exact if (np.abs(exact - middle) <= half_mm).all() else None
        _draw_space(near, shifts, seen, found, shown)
        for bounds, centre in zip(
            (near.set_xlim, near.set_ylim, near.set_zlim), middle, strict=True
        ):
            bounds(centre - half_mm, centre + half_mm)
        around = amount(int((shown & ~shifts.chosen).sum()), "shift")
        near.set_title(f"the region (box) and {around} around it")
    figure.legend(*whole.get_legend_handles_labels(), loc="lower left", ncols=4)
    for axis in range(3):
        ax = add_axes(figure, 4.7, 0.65 + 1.95 * (2 - axis), 4.1, 1.35)
        _draw_histogram(ax, shifts, axis, exact, found)
    return figure


def _draw_space(
    ax: Any,
    shifts: Shifts,
    exact: FloatArray | None,
    found: FloatArray | None,
    shown: BoolArray | None = None,
) -> None:
    """Shifts in 3D (those shown), the region and the translations; 3D axes carry no types."""
    visible = np.ones(len(shifts.weights), dtype=bool) if shown is None else shown
    for mask, colour, size, name in (
        (~shifts.chosen, "#9AA5AE", 7.0, "shift"),
        (shifts.chosen, MARK, 12.0, "shift in the region"),
    ):
        dots = shifts.values_mm[mask & visible]
        ax.scatter(*dots.T, s=size, lw=0, color=colour, depthshade=False, label=name)
    if np.isfinite(shifts.box_mm).all():
        for edge in box_edges(shifts.box_mm):
            ax.plot(*edge.T, color=MARK, lw=1.0)
    if exact is not None:
        ax.scatter(*exact, marker="x", s=45, color=INK, lw=1.4, label="exact translation")
    if found is not None:
        ax.scatter(*found, marker="+", s=60, color=TARGET, lw=1.6, label="estimate")
    ax.set(xlabel="X (mm)", ylabel="Y (mm)", zlabel="Z (mm)")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_box_aspect(None, zoom=1.0)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_major_locator(MaxNLocator(4))


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
    ax.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    if axis == 0:
        ax.legend(loc="best", fontsize=7.5)


def box_edges(box_mm: FloatArray) -> list[FloatArray]:
    """The twelve edges (2, 3) of a box given by its (2, 3) lower and upper corner."""
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
