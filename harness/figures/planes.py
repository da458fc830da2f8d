"""Figures of the compact representation: line segments and patches (6.5, 6.6, 6.15 to 6.17)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from harness.figures.looks import FRONT, INK, NORMAL_COLOURS, PALE, TOP, Projection
from harness.figures.page import add_bar, amount, projections, roles
from harness.figures.pair_matches import UNMATCHED, palette_places
from harness.figures.pair_view import PairView
from registration.scan import FloatArray, IntArray
from registration.thesis.evidence import ViewEvidence
from registration.thesis.patches import Patches
from registration.thesis.segments import Segments

ANGLE = "Angle of the normal, from facing the\nsensor towards the right (degrees)"
OUTLINES = (
    "An outline joins the ends of a patch's first and last segment only, so it can miss parts of "
    "the patch or cover more. "
)
BRIDGES = "Dashed: patches that bridge two groups of profiles."
LABEL_DISTANCE_MM = 26.0  # two numbers closer than this would run into each other
LABEL_ROOM_MM = 11.0  # a patch has to be this wide to hold a number


def draw_segments(pair: PairView, segments: tuple[Segments, Segments], title: str) -> Figure:
    """The straight lines of every profile, coloured by the angle of their normal."""
    columns = [
        f"{role}: {view} view\n{amount(len(lines), 'line segment')} "
        f"of {amount(scan.n_valid, 'point')}"
        for (role, view, scan), lines in zip(roles(pair), segments, strict=True)
    ]
    figure, axes = projections(
        f"{title}\nLine segments", columns, [lines.endpoints_mm for lines in segments], bar=True
    )
    drawn = None
    for column, lines in enumerate(segments):
        for row, projection in enumerate((FRONT, TOP)):
            drawn = add_segments(axes[row][column], lines, projection)
    if drawn is not None:
        add_bar(figure, axes, drawn, ANGLE).set_ticks([-90, -45, 0, 45, 90])
    return figure


def add_segments(ax: Axes, lines: Segments, projection: Projection) -> LineCollection:
    """Draw line segments, coloured by the angle of their normal."""
    drawn = LineCollection(
        list(lines.endpoints_mm[:, :, [projection.right, projection.up]]),
        array=np.rad2deg(np.arctan2(lines.normal[:, 1], -lines.normal[:, 2])),
        cmap="viridis", clim=(-90.0, 90.0), lw=1.0,
    )  # fmt: skip
    ax.add_collection(drawn)
    return drawn


def draw_patches(
    pair: PairView, views: tuple[ViewEvidence, ViewEvidence], matches: IntArray, title: str
) -> Figure:
    """The planar patches, numbered by the normal that they belong to and coloured by its match."""
    columns = [
        f"{role}: {view} view\n{amount(len(found.patches), 'patch')}, "
        f"{amount(len(found.sphere), 'normal')}"
        for (role, view, _), found in zip(roles(pair), views, strict=True)
    ]
    note = OUTLINES + (
        "Number: the patch's normal on the Gauss sphere of its view, 1 has the largest area. "
    )
    if len(matches):
        note += "Colour: matched normals have the same one in both views; grey: unmatched"
        note += ". " if len(matches) <= len(NORMAL_COLOURS) else ", or a match of smaller area. "
    else:
        note += "No normals were matched, so nothing is coloured. "
    if any(view.patches.intermediate.any() for view in views):
        note += BRIDGES
    figure, axes = projections(
        f"{title}\nPatches", columns, [view.patches.corners_mm for view in views], note
    )
    for column, view in enumerate(views):
        colours = normal_colours(len(view.sphere), matches[:, column])
        for row, projection in enumerate((FRONT, TOP)):
            add_patches(axes[row][column], view.patches, view.sphere.member, colours, projection)
    return figure


def normal_colours(n_normals: int, matched: IntArray) -> list[str]:
    """A colour for each normal of a view: that of its match, or pale grey.

    matched: (k,) the view's normal in each match, those to be coloured first.
    """
    places = palette_places(n_normals, matched)
    return [PALE if place == UNMATCHED else NORMAL_COLOURS[place] for place in places]


def add_patches(
    ax: Axes, patches: Patches, member: IntArray, colours: list[str], projection: Projection
) -> None:
    """Draw patches (m of them) with the number and the colour of their normal.

    member: (m,) normal of each. colours: of every normal.
    """
    outline = patches.corners_mm[:, :, [projection.right, projection.up]]
    order = np.argsort(-patches.area_mm2, kind="stable")  # small ones on top of large ones
    for intermediate in (False, True):
        chosen = order[patches.intermediate[order] == intermediate]
        faces = PolyCollection(
            list(outline[chosen]),
            facecolors=[(*_rgb(colours[member[m]]), 0.75) for m in chosen],
            edgecolors=INK,
            linewidths=0.7,
            linestyles=(0, (3, 2)) if intermediate else "-",
        )
        ax.add_collection(faces)
    placed = np.zeros((0, 2))
    for m in order:
        at = outline[m].mean(axis=0)
        if (
            _thickness(outline[m]) < LABEL_ROOM_MM
            or (np.linalg.norm(placed - at, axis=1) < LABEL_DISTANCE_MM).any()
        ):
            continue
        placed = np.vstack([placed, at])
        colour = "white" if sum(_rgb(colours[member[m]])) < 1.5 else INK
        ax.text(
            float(at[0]),
            float(at[1]),
            str(member[m] + 1),
            ha="center",
            va="center",
            fontsize=8,
            color=colour,
        )


def _thickness(outline_mm: FloatArray) -> float:
    """Area of a polygon (k, 2) over its longest extent."""
    x, y = (outline_mm - outline_mm.mean(axis=0)).T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    return area / max(float(np.ptp(outline_mm, axis=0).max()), 1e-9)


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue
