"""How centroids that belong together give themselves away (5.7 and 5.8)."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from harness.figures.looks import FRONT, GREY, INK, MARK, PALE, SOURCE, TARGET, TOP, Projection
from harness.figures.page import AXES, LEFT_IN, WIDTH_IN, add_axes, new_figure, projections
from registration.scan import FloatArray
from registration.thesis.patches import Patches
from registration.thesis.translation import Shifts

NAMES = ("a", "b", "c", "d")  # a and b of the target, c and d of the source


class FourPatches(NamedTuple):
    """Two patches of each view, all of one orientation: a with c, b with d as in section 5.7.

    target, source: (2,) patches. shifts_mm: (4, 3) of ac, ad, bc, bd.
    """

    target: tuple[int, int]
    source: tuple[int, int]
    shifts_mm: FloatArray


def telling_patches(target: Patches, source: Patches, shifts: Shifts) -> FourPatches | None:
    """The four patches of largest area whose right pairs are in the densest region, or None.

    The wrong pairs of the four are outside it. By what the method found, not by the truth.
    """
    found = {(int(i), int(j)): k for k, (i, j) in enumerate(shifts.patch_pairs) if shifts.chosen[k]}
    every = {(int(i), int(j)): k for k, (i, j) in enumerate(shifts.patch_pairs)}
    best, most = None, 0.0
    for (a, c), (b, d) in combinations(found, 2):
        wrong = (a, d), (b, c)
        if a == b or c == d or any(pair not in every or pair in found for pair in wrong):
            continue
        area = float(min(*target.area_mm2[[a, b]], *source.area_mm2[[c, d]]))
        if area > most:
            order = [every[pair] for pair in ((a, c), *wrong, (b, d))]
            best, most = FourPatches((a, b), (c, d), shifts.values_mm[order]), area
    return best


def draw_patch_matching(
    target: Patches, source: Patches, four: FourPatches, turn: Rotation, title: str
) -> Figure:
    """The four patches of both views, before and after the source is turned (5.7)."""
    corners = [target.corners_mm, source.corners_mm]
    turned = turn.apply(source.corners_mm.reshape(-1, 3)).reshape(-1, 4, 3)
    note = (
        "Patches a and b are of the target, c and d of the source, all of like orientation; pale: "
        "the other patches of both views. After the turn, one and the same shift lays c on a and d "
        "on b."
    )
    columns = ["(a) as seen, each in its own frame", "(b) the source turned as estimated"]
    figure, axes = projections(title, columns, [*corners, turned], note)
    for column, second in enumerate((source.corners_mm, turned)):
        for row, projection in enumerate((FRONT, TOP)):
            ax = axes[row][column]
            _outlines(ax, target.corners_mm, projection, "none", PALE)
            _outlines(ax, second, projection, "none", PALE)
            for outlines, chosen, colour, names in (
                (target.corners_mm, four.target, TARGET, NAMES[:2]),
                (second, four.source, SOURCE, NAMES[2:]),
            ):
                shown = outlines[list(chosen)]
                _outlines(ax, shown, projection, colour, INK)
                for outline, name in zip(shown, names, strict=True):
                    y, z = outline[:, [projection.right, projection.up]].mean(axis=0)
                    ax.text(y, z, name, ha="center", va="center", weight="bold", size=10,
                            bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": "none",
                                  "alpha": 0.8})  # fmt: skip
    return figure


def draw_four_shifts(four: FourPatches, chosen_mm: FloatArray, title: str) -> Figure:
    """The four shifts of these patches: two that agree, two that do not (5.8)."""
    agree = float(np.linalg.norm(four.shifts_mm[0] - four.shifts_mm[3]))
    note = (
        f"T(ac) and T(bd) lie {agree:.1f} mm apart, T(ad) and T(bc) each elsewhere. Cross: the "
        "translation estimated from all patches."
    )
    figure = new_figure(title, 5.0, note)
    wide_in = 0.5 * (WIDTH_IN - 2 * LEFT_IN - 0.4)
    labels = [f"T({pair})" for pair in ("ac", "ad", "bc", "bd")]
    for place, projection in enumerate((FRONT, TOP)):
        ax = add_axes(figure, LEFT_IN + place * (wide_in + LEFT_IN), 0.95, wide_in, 3.2)
        shown = four.shifts_mm[:, [projection.right, projection.up]]
        right = np.array([True, False, False, True])
        ax.plot(*shown[right].T, "o", ms=8, mec=INK, mew=0.6, color=MARK)
        ax.plot(*shown[~right].T, "o", ms=8, mec=INK, mew=0.6, color=GREY)
        x, y = chosen_mm[[projection.right, projection.up]]
        ax.plot(x, y, "+", ms=12, mew=1.6, color=TARGET)
        _name_points(ax, shown, labels)
        ax.set_aspect("equal", adjustable="datalim")
        ax.margins(0.2)
        ax.set(
            xlabel=f"Shift along {AXES[projection.right]}",
            ylabel=f"Shift along {AXES[projection.up]}",
            title=projection.name,
        )
    return figure


def _name_points(ax: Axes, points: FloatArray, labels: list[str]) -> None:
    """Names beside points; those of points that lie on each other share one."""
    middle = points.mean(axis=0)
    span = max(float(np.ptp(points, axis=0).max()), 1e-9)
    left = list(range(len(points)))
    while left:
        first = left[0]
        near = [k for k in left if np.linalg.norm(points[k] - points[first]) < 0.08 * span]
        left = [k for k in left if k not in near]
        at = points[near].mean(axis=0)
        away = 14.0 if at[1] >= middle[1] else -14.0
        ax.annotate(", ".join(labels[k] for k in near), (at[0], at[1]), (0.0, away),
                    textcoords="offset points", ha="center", va="center")  # fmt: skip


def _outlines(
    ax: Axes, corners_mm: FloatArray, projection: Projection, fill: str, edge: str
) -> None:
    faces = PolyCollection(
        list(corners_mm[:, :, [projection.right, projection.up]]),
        facecolors=fill, edgecolors=edge, linewidths=0.8, alpha=0.85,
    )  # fmt: skip
    ax.add_collection(faces)
