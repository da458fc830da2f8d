"""Figures of a single view, stage by stage (5.2, 6.4 to 6.6, 6.12 to 6.20, 6.24 to 6.29)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.figures.looks import FRONT, INK, MARK, SOURCE, TARGET, TOP, limits
from harness.figures.measurements import face_by_face, scatter_depths
from harness.figures.page import (
    AXES,
    GAP_IN,
    HEAD_IN,
    LEFT_IN,
    WIDTH_IN,
    add_axes,
    add_bar,
    amount,
    new_figure,
    projections,
    thinned,
    to_scale,
)
from harness.figures.planes import (
    ANGLE,
    BRIDGES,
    OUTLINES,
    add_patches,
    add_segments,
    normal_colours,
)
from harness.figures.sphere import LARGEST_PT2, add_globe, add_numbers
from registration.scan import FloatArray, Scan
from registration.thesis.evidence import ViewEvidence
from registration.thesis.gauss_sphere import GaussSphere
from registration.thesis.segments import Segments

FOOT_IN = 0.95
LISTED = 20  # normals in the bars beside a Gauss sphere
NUMBERS = "Number and colour: the patch's normal, 1 has the largest area; grey: beyond the ninth. "


def draw_view_measurements(scan: Scan, title: str) -> Figure:
    """One view as measured, coloured by depth (6.12 to 6.14, 6.24 to 6.26)."""
    points = scan.points_mm[scan.valid]
    what = f"{amount(scan.n_valid, 'point')} in {amount(len(scan.valid), 'profile')}"
    figure, axes = _beside(f"{title}\n{what}", points, bar=True)
    low, high = limits([points])
    _depths(figure, [axes], [points], low[2], high[2])
    return figure


def draw_view_filtering(scan: Scan, filtered: Scan, title: str) -> Figure:
    """One view before and after preprocessing, coloured by depth (6.4)."""
    points = [each.points_mm[each.valid] for each in (scan, filtered)]
    lost = int((scan.valid & ~filtered.valid).sum())
    columns = [
        f"(a) before filtering\n{amount(scan.n_valid, 'point')}",
        f"(b) after filtering\n{amount(lost, 'point')} removed as outliers, the rest smoothed",
    ]
    figure, axes = projections(title, columns, points, bar=True)
    low, high = limits(points)
    _depths(figure, [list(column) for column in zip(*axes, strict=True)], points, low[2], high[2])
    return figure


def draw_view_compaction(segments: Segments, found: ViewEvidence, title: str) -> Figure:
    """The line segments of one view and the patches that they make (6.5, 6.6)."""
    patches = found.patches
    columns = [
        f"(a) line segment approximation\n{amount(len(segments), 'segment')}",
        f"(b) patch representation\n{amount(len(patches), 'patch')}, "
        f"{amount(len(found.sphere), 'normal')}",
    ]
    points = [segments.endpoints_mm, patches.corners_mm]
    note = NUMBERS + OUTLINES + (BRIDGES if patches.intermediate.any() else "")
    figure, axes = projections(title, columns, points, note, bar=True)
    for row, projection in enumerate((FRONT, TOP)):
        drawn = add_segments(axes[row][0], segments, projection)
        add_patches(axes[row][1], patches, found.sphere.member, _colours(found), projection)
    add_bar(figure, axes, drawn, f"(a): {ANGLE[0].lower()}{ANGLE[1:]}").set_ticks(
        [-90, -45, 0, 45, 90]
    )
    return figure


def draw_view_patches(found: ViewEvidence, title: str) -> Figure:
    """The planar patches of one view (6.15 to 6.17, 6.27 to 6.29)."""
    patches = found.patches
    what = f"{amount(len(patches), 'patch')}, {amount(len(found.sphere), 'normal')}"
    note = NUMBERS + OUTLINES + (BRIDGES if patches.intermediate.any() else "")
    figure, axes = _beside(f"{title}\n{what}", patches.corners_mm.reshape(-1, 3), note)
    for ax, projection in zip(axes, (FRONT, TOP), strict=True):
        add_patches(ax, patches, found.sphere.member, _colours(found), projection)
    return figure


def draw_view_sphere(sphere: GaussSphere, n_patches: int, title: str) -> Figure:
    """The modified Gauss sphere of one view, and the area behind each normal (6.18 to 6.20)."""
    area = 1e-2 * sphere.weight
    note = (
        "Seen from the sensor: the centre faces it, the rim is seen edge-on; circles 30, 60 and 90 "
        "degrees from the centre. Area of a marker: area of the patches with this normal."
    )
    figure = new_figure(
        f"{title}\n{amount(len(sphere), 'normal')} of {amount(n_patches, 'patch')}, "
        f"{area.sum():.0f} cm²",
        5.6,
        note,
    )
    globe = add_axes(figure, LEFT_IN, 0.95, 3.75, 3.75)
    add_globe(globe)
    colours = normal_colours(len(sphere), np.arange(len(sphere)))
    size = 2.0 * np.maximum(LARGEST_PT2 * sphere.weight / max(sphere.weight.max(), 1e-9), 8.0)
    globe.scatter(
        sphere.direction[:, 1], sphere.direction[:, 0], s=size, c=colours, edgecolors=INK, lw=0.6,
        alpha=0.85, zorder=3,
    )  # fmt: skip
    add_numbers(globe, sphere, size, 120.0)
    bars = add_axes(figure, 5.45, 0.95, WIDTH_IN - 5.65, 3.75)
    shown = min(len(sphere), LISTED)
    ranks = np.arange(1, shown + 1)
    bars.barh(ranks, area[:shown], color=colours[:shown], edgecolor=INK, lw=0.6)
    bars.set(
        xlabel="area of the patches with this normal (cm²)", ylabel="normal",
        yticks=ranks, ylim=(shown + 0.8, 0.2),
    )  # fmt: skip
    bars.grid(axis="y", visible=False)
    if len(sphere) > shown:
        bars.set_title(f"the {shown} largest of {len(sphere)}")
    return figure


def draw_profile_filtering(scan: Scan, filtered: Scan, profile: int, title: str) -> Figure:
    """One profile before and after preprocessing (5.2)."""
    before, after = scan.points_mm[profile], filtered.points_mm[profile]
    lost = np.isfinite(before[:, 2]) & ~np.isfinite(after[:, 2])
    both = np.isfinite(before[:, 2]) & np.isfinite(after[:, 2])
    rms_mm = float(np.sqrt(np.mean((after - before)[both, 2] ** 2))) if both.any() else 0.0
    low, high = limits([before])
    wide_in = WIDTH_IN - LEFT_IN - 0.3
    tall_in = float(np.clip(wide_in * (high[2] - low[2]) / (high[1] - low[1]), 1.2, 3.6))
    note = (
        f"Profile {profile}. The removal of outliers takes {amount(int(lost.sum()), 'point')}, "
        f"the median filter moves the others by {rms_mm:.2f} mm rms in depth."
    )
    figure = new_figure(title, 2 * tall_in + 2.75, note)
    for bottom, letter, points in (
        (tall_in + 1.75, "(a) before preprocessing", before),
        (0.95, "(b) after preprocessing", after),
    ):
        ax = add_axes(figure, LEFT_IN, bottom, wide_in, tall_in)
        ax.plot(points[:, 1], points[:, 2], ".", ms=3.5, color=TARGET, label="measured")
        if points is before and lost.any():
            ax.plot(before[lost, 1], before[lost, 2], "x", ms=7, mew=1.5, color=MARK,
                    label="removed")  # fmt: skip
            ax.legend(loc="best")
        if points is after:
            ax.plot(*face_by_face(after).T, lw=0.9, color=SOURCE, zorder=1)
        ax.set(xlim=(low[1], high[1]), ylim=(low[2], high[2]), ylabel=AXES[2], title=letter)
        if points is after:
            ax.set_xlabel(AXES[1])
    return figure


def telling_profile(scan: Scan, filtered: Scan) -> int:
    """The profile of which preprocessing removes most points, the first of equals."""
    return int((scan.valid & ~filtered.valid).sum(axis=1).argmax())


def _colours(found: ViewEvidence) -> list[str]:
    return normal_colours(len(found.sphere), np.arange(len(found.sphere)))


def _beside(
    title: str, points_mm: FloatArray, note: str = "", bar: bool = False
) -> tuple[Figure, list[Axes]]:
    """A page with the front view beside the top view, to one scale; and its two axes."""
    low, high = limits([points_mm])
    room_in = WIDTH_IN - 2 * LEFT_IN - GAP_IN - (0.95 if bar else 0.0)
    wide_in = 0.5 * room_in
    mm_per_in = (high[1] - low[1]) / wide_in
    tall_in = [(high[p.up] - low[p.up]) / mm_per_in for p in (FRONT, TOP)]
    foot_in = FOOT_IN if note else 0.6
    figure = new_figure(title, HEAD_IN + max(tall_in) + foot_in, note)
    axes = []
    for place, (projection, tall) in enumerate(zip((FRONT, TOP), tall_in, strict=True)):
        left = LEFT_IN + place * (wide_in + LEFT_IN + GAP_IN - 0.1)
        bottom = foot_in + max(tall_in) - tall
        ax = add_axes(figure, left, bottom, wide_in, tall)
        to_scale(ax, projection, low, high)
        ax.set_title(projection.name)
        axes.append(ax)
    return figure, axes


def _depths(
    figure: Figure,
    columns: list[list[Axes]],
    points_mm: list[FloatArray],
    near_mm: float,
    far_mm: float,
) -> None:
    """Scatter each cloud on its front and top axes, and add the bar of depths."""
    for axes, cloud in zip(columns, points_mm, strict=True):
        dots = thinned(cloud)
        for ax, projection in zip(axes, (FRONT, TOP), strict=True):
            shown = scatter_depths(ax, dots, projection, near_mm, far_mm)
    add_bar(figure, [columns[-1][:1], columns[-1][-1:]], shown, AXES[2])
