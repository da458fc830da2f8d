"""Figures of the raw measurements and of their filtering (6.4, 6.12 to 6.14, 6.24 to 6.26)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from harness.figures.looks import FRONT, MARK, SOURCE, TARGET, TOP, Projection, limits
from harness.figures.page import (
    AXES,
    LEFT_IN,
    WIDTH_IN,
    add_axes,
    add_bar,
    amount,
    new_figure,
    projections,
    roles,
    thinned,
    thousands_apart,
    to_scale,
)
from harness.figures.pair_view import PairView
from registration.scan import FloatArray, Scan

WINDOW_MM = 110.0  # width of the detail of a profile
JUMP_MM = 10.0  # in depth between two pixels: another face


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
    figure, axes = projections(
        f"{title}\nRaw measurements, each in its own frame", columns, points, bar=True
    )
    shown = None
    for column, cloud in enumerate(points):
        dots = thinned(cloud)
        for row, projection in enumerate((FRONT, TOP)):
            ax = axes[row][column]
            if len(dots) == 0:
                ax.text(0.5, 0.5, "no measured point", transform=ax.transAxes, ha="center")
                continue
            shown = scatter_depths(ax, dots, projection, low[2], high[2])
    if shown is not None:
        add_bar(figure, axes, shown, AXES[2])
    return figure


def scatter_depths(
    ax: Axes, points_mm: FloatArray, projection: Projection, near_mm: float, far_mm: float
) -> PathCollection:
    """Points (n, 3) coloured by their depth between two."""
    return ax.scatter(
        points_mm[:, projection.right], points_mm[:, projection.up], c=points_mm[:, 2],
        s=1.6, lw=0, cmap="viridis_r", vmin=near_mm, vmax=far_mm,
    )  # fmt: skip


def draw_filtering(pair: PairView, filtered: tuple[Scan, Scan], title: str) -> Figure:
    """What the removal of outliers took away, and what smoothing did to a piece of one profile.

    filtered: the target's and the source's scan after it, pixel for pixel.
    """
    pixels = list(zip(roles(pair), filtered, strict=True))
    low, high = limits([scan.points_mm[scan.valid] for (_, _, scan), _ in pixels])
    wide_in = 0.5 * (WIDTH_IN - 2 * LEFT_IN - 0.1)
    tall_in = float(np.clip(wide_in * (high[0] - low[0]) / (high[1] - low[1]), 1.5, 4.5))
    figure = new_figure(f"{title}\nBefore and after filtering", 2 * tall_in + 3.0)
    rows = [
        [
            add_axes(figure, left, bottom, wide_in, tall_in)
            for left in (LEFT_IN, 2 * LEFT_IN + wide_in)
        ]
        for bottom in (tall_in + 2.0, 0.95)
    ]
    for (left, right), ((role, view, scan), after) in zip(rows, pixels, strict=True):
        lost = scan.valid & ~after.valid
        moved = (after.points_mm - scan.points_mm)[scan.valid & after.valid][:, 2]
        kept = thinned(scan.points_mm[scan.valid & after.valid])
        left.scatter(kept[:, 1], kept[:, 0], s=1.2, lw=0, c="#BFC7CC", label="kept")
        gone = scan.points_mm[lost]
        left.scatter(gone[:, 1], gone[:, 0], s=14, lw=0.8, c=MARK, marker="x", label="removed")
        to_scale(left, FRONT, low, high)
        left.set_title(
            f"{role}: {view} view\n{amount(int(lost.sum()), 'point')} "
            f"of {thousands_apart(scan.n_valid)} removed"
        )
        profile = _busiest_profile(scan)
        _draw_detail(right, scan.points_mm[profile], after.points_mm[profile])
        rms = float(np.sqrt(np.mean(moved**2))) if len(moved) else 0.0
        right.set_title(
            f"{role}: part of profile {profile}\ndepths of the view moved by {rms:.2f} mm rms"
        )
    marks = rows[0][0].get_legend_handles_labels()
    figure.legend(*marks, loc="lower left", ncols=2, markerscale=2)
    return figure


def _busiest_profile(scan: Scan) -> int:
    """The profile of most points, of those the one nearest to the middle."""
    counts = np.count_nonzero(scan.valid, axis=1)
    distance = np.abs(np.arange(len(counts)) - len(counts) // 2)
    return int(np.lexsort((distance, -counts))[0])


def face_by_face(profile_mm: FloatArray) -> FloatArray:
    """(n, 2) Y and Z of a profile (n, 3), cut where the depth jumps: no line from face to face."""
    line = profile_mm[:, 1:].copy()
    line[1:][np.abs(np.diff(line[:, 1])) > JUMP_MM] = np.nan
    return line


def _draw_detail(ax: Axes, before_mm: FloatArray, after_mm: FloatArray) -> None:
    """The middle part of a profile, to scale."""
    valid = np.isfinite(before_mm[:, 2])
    if not valid.any():
        ax.text(0.5, 0.5, "no measured point", transform=ax.transAxes, ha="center")
        return
    y, z = before_mm[valid, 1], before_mm[valid, 2]
    half = 0.5 * WINDOW_MM
    middle_y = float(np.median(y))
    middle_z = float(np.median(z[np.abs(y - middle_y) <= half]))
    ax.plot(y, z, "o", ms=3.2, mew=0, color=SOURCE, label="measured")
    ax.plot(*face_by_face(after_mm).T, ".-", ms=2.5, lw=0.9, color=TARGET, label="filtered")
    ax.set_xlim(middle_y - half, middle_y + half)
    frame = ax.get_window_extent()
    room = half * frame.height / frame.width
    ax.set_ylim(middle_z - room, middle_z + room)
    ax.set_aspect("equal")
    ax.set_xlabel(AXES[1])
    ax.set_ylabel(AXES[2])
    ax.legend(loc="best")
