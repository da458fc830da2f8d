"""Figures of the raw measurements and of their filtering (6.4, 6.12 to 6.14, 6.24 to 6.26)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.figures_page import (
    AXES,
    FRONT,
    MARK,
    SOURCE,
    TARGET,
    TOP,
    amount,
    limits,
    new_figure,
    projections,
    roles,
    thinned,
    to_scale,
)  # fmt: skip
from harness.pair_view import PairView
from registration.scan import FloatArray, Scan

WINDOW_MM = 110.0  # width of the detail of a profile


def draw_measurements(pair: PairView, title: str) -> Figure:
    """Both scans as measured, each in its own frame, coloured by depth."""
    scans = (pair.target, pair.source)
    columns = [
        f"{role}: {view} view\n{amount(scan.n_valid, 'point')} "
        f"in {amount(len(scan.valid), 'profile')}"
        for role, view, scan in roles(pair)
    ]
    points = [scan.points_mm[scan.valid] for scan in scans]
    low, high = limits(points)
    figure, axes = projections(f"{title}\nRaw measurements, each in its own frame", columns, points)
    shown = None
    for column, cloud in enumerate(points):
        dots = thinned(cloud)
        for row, projection in enumerate((FRONT, TOP)):
            ax = axes[row][column]
            if len(dots) == 0:
                ax.text(0.5, 0.5, "no measured point", transform=ax.transAxes, ha="center")
                continue
            shown = ax.scatter(
                dots[:, projection.right], dots[:, projection.up], c=dots[:, 2],
                s=1.6, lw=0, cmap="viridis_r", vmin=low[2], vmax=high[2],
            )  # fmt: skip
    if shown is not None:
        figure.colorbar(shown, ax=axes[0], shrink=0.9, label="Z, depth (mm)", pad=0.01, aspect=25)
    return figure


def draw_filtering(pair: PairView, filtered: tuple[Scan, Scan], title: str) -> Figure:
    """What the removal of outliers took away, and what smoothing did to a piece of one profile.

    filtered: the target's and the source's scan after it, pixel for pixel.
    """
    pixels = list(zip(roles(pair), filtered, strict=True))
    low, high = limits([scan.points_mm[scan.valid] for (_, _, scan), _ in pixels])
    height_in = 2 * 4.0 * min((high[0] - low[0]) / (high[1] - low[1]), 1.2) + 2.0
    figure = new_figure(f"{title}\nBefore and after filtering", max(height_in, 6.0))
    axes = figure.subplots(2, 2)
    for (left, right), ((role, view, scan), after) in zip(axes, pixels, strict=True):
        lost = scan.valid & ~after.valid
        moved = (after.points_mm - scan.points_mm)[scan.valid & after.valid][:, 2]
        kept = thinned(scan.points_mm[scan.valid & after.valid])
        left.scatter(kept[:, 1], kept[:, 0], s=1.2, lw=0, c="#BFC7CC", label="kept")
        gone = scan.points_mm[lost]
        left.scatter(gone[:, 1], gone[:, 0], s=14, lw=0.8, c=MARK, marker="x", label="removed")
        to_scale(left, FRONT, low, high)
        left.set_title(
            f"{role}: {view} view, {amount(int(lost.sum()), 'point')} of "
            f"{amount(scan.n_valid, 'point').split()[0]} removed"
        )
        left.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, markerscale=2, borderpad=0
        )
        profile = _busiest_profile(scan)
        _draw_detail(right, scan.points_mm[profile], after.points_mm[profile])
        rms = float(np.sqrt(np.mean(moved**2))) if len(moved) else 0.0
        right.set_title(
            f"{role}: part of profile {profile}\ndepths of the view moved by {rms:.2f} mm rms"
        )
    return figure


def _busiest_profile(scan: Scan) -> int:
    """The profile of most points, of those the one nearest to the middle."""
    counts = np.count_nonzero(scan.valid, axis=1)
    distance = np.abs(np.arange(len(counts)) - len(counts) // 2)
    return int(np.lexsort((distance, -counts))[0])


def _draw_detail(ax: Axes, before_mm: FloatArray, after_mm: FloatArray) -> None:
    """The middle part of a profile, to scale."""
    valid = np.isfinite(before_mm[:, 2])
    if not valid.any():
        ax.text(0.5, 0.5, "no measured point", transform=ax.transAxes, ha="center")
        return
    y, z = before_mm[valid, 1], before_mm[valid, 2]
    inside = np.abs(y - np.median(y)) <= 0.5 * WINDOW_MM
    middle_z = float(np.median(z[inside]))
    half = 0.5 * WINDOW_MM
    kept = np.isfinite(after_mm[:, 2])
    ax.plot(y, z, "o", ms=3.2, mew=0, color=SOURCE, label="measured")
    ax.plot(
        after_mm[kept, 1], after_mm[kept, 2], ".-", ms=2.5, lw=0.9, color=TARGET, label="filtered"
    )
    ax.set_xlim(np.median(y) - half, np.median(y) + half)
    ax.set_ylim(middle_z - 0.6 * half, middle_z + 0.6 * half)
    ax.set_aspect("equal")
    ax.set_xlabel(AXES[1])
    ax.set_ylabel(AXES[2])
    ax.legend(loc="best")
