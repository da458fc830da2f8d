"""The modified Gauss spheres of both views (6.7, 6.18 to 6.20)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from scipy.spatial.transform import Rotation

from harness.figures.looks import GREY, INK, PALE, SOURCE, TARGET
from harness.figures.page import add_axes, amount, new_figure
from harness.figures.pair_view import PairView
from harness.figures.planes import normal_colours
from registration.scan import FloatArray, IntArray
from registration.thesis.gauss_sphere import GaussSphere

LARGEST_PT2 = 420.0  # area of the marker of the heaviest normal of both views
NUMBERED = 12  # normals a view that get their number, heaviest first
POINTS_PER_RADIUS = 75.0  # of the sphere on the page
SIDES = np.deg2rad([0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0])
NUMBER_DISTANCE = 0.13  # of the sphere's radius, between two numbers


def draw_gauss_spheres(
    pair: PairView, spheres: tuple[GaussSphere, GaussSphere], matches: IntArray, title: str
) -> Figure:
    """Both spheres seen from the sensor, and the source's turned onto the target's."""
    note = (
        "Area of a marker: area of the patches with this normal. Number: its rank, up to "
        f"{NUMBERED}. Colour: matched normals have the same one; grey: unmatched. The centre faces "
        "the sensor, the rim is seen edge-on; circles 30, 60 and 90 degrees from the centre. On "
        "the right, pale: turned away from the target's sensor."
    )
    figure = new_figure(f"{title}\nModified Gauss spheres, seen from the sensor", 4.7, note)
    side_in = 2.4
    axes = [add_axes(figure, left, 1.35, side_in, side_in) for left in (0.6, 3.55, 6.5)]
    heaviest = max([float(s.weight[0]) for s in spheres if len(s)], default=1.0)
    names = (("Target", pair.target_view, "o"), ("Source", pair.source_view, "D"))
    for column, ((role, view, marker), sphere) in enumerate(zip(names, spheres, strict=True)):
        ax = axes[column]
        add_globe(ax)
        size = np.maximum(LARGEST_PT2 * sphere.weight / heaviest, 8.0)
        colours = normal_colours(len(sphere), matches[:, column])
        ax.scatter(
            sphere.direction[:, 1], sphere.direction[:, 0], s=size, c=colours,
            marker=marker, edgecolors=INK, lw=0.6, alpha=0.85, zorder=3,
        )  # fmt: skip
        add_numbers(ax, sphere, size)
        area = 1e-2 * float(sphere.weight.sum())
        ax.set_title(f"{role}: {view} view\n{amount(len(sphere), 'normal')}, {area:.0f} cm²")
    pose = pair.result.T_target_source
    by = "estimated" if pose is not None else "exact"
    turn = (pair.T_target_source_exact if pose is None else pose).rotation
    _draw_turned(axes[2], spheres, turn, heaviest)
    axes[2].set_title(f"Source turned by {by} rotation\n{amount(len(matches), 'match')}")
    return figure


def _draw_turned(
    ax: Axes, spheres: tuple[GaussSphere, GaussSphere], turn: Rotation, heaviest: float
) -> None:
    add_globe(ax)
    target, source = spheres
    turned = turn.apply(source.direction) if len(source) else np.zeros((0, 3))
    for direction, weight, marker, colour, role in (
        (target.direction, target.weight, "o", TARGET, "target"),
        (turned, source.weight, "D", SOURCE, "source, turned"),
    ):
        size = np.maximum(LARGEST_PT2 * weight / heaviest, 8.0)
        away = direction[:, 2] > 0.0
        for shown, alpha in ((~away, 1.0), (away, 0.35)):
            ax.scatter(
                direction[shown, 1], direction[shown, 0], s=size[shown], marker=marker,
                facecolors="none", edgecolors=colour, lw=1.2, alpha=alpha, zorder=3,
            )  # fmt: skip
        ax.scatter([], [], s=40, marker=marker, facecolors="none", edgecolors=colour, label=role)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, columnspacing=1.0)


def add_globe(ax: Axes) -> None:
    """The hemisphere towards the sensor as a graticule of circles and meridians."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for angle_deg in (30, 60, 90):
        radius = np.sin(np.deg2rad(angle_deg))
        colour = GREY if angle_deg == 90 else PALE
        ax.plot(radius * np.sin(turn), radius * np.cos(turn), lw=0.9, color=colour, zorder=1)
    for azimuth in np.deg2rad(np.arange(0, 180, 30)):
        ends = np.array([-1.0, 1.0])
        ax.plot(ends * np.sin(azimuth), ends * np.cos(azimuth), lw=0.6, color=PALE, zorder=1)
    ax.set(xlim=(-1.12, 1.12), ylim=(-1.12, 1.12), aspect="equal")
    ax.set(xlabel="Y of the normal", ylabel="X of the normal", xticks=[-1, 0, 1], yticks=[-1, 0, 1])
    ax.grid(visible=False)


def add_numbers(
    ax: Axes,
    sphere: GaussSphere,
    size_pt2: FloatArray,
    points_per_radius: float = POINTS_PER_RADIUS,
) -> None:
    """Write the rank beside each marker, outwards where there is room, else on another side.

    size_pt2: (k,) areas of the markers. A rank that no side has room for is left out.
    """
    tips = sphere.direction[:, [1, 0]]
    radius = np.sqrt(size_pt2 / np.pi) / points_per_radius
    taken, room = tips, radius + 0.5 * NUMBER_DISTANCE
    for rank, tip in enumerate(tips[:NUMBERED]):
        outward = np.arctan2(tip[1], tip[0])
        for turn in SIDES:
            angle = outward + turn
            at = tip + (radius[rank] + 0.07) * np.array([np.cos(angle), np.sin(angle)])
            others = np.arange(len(taken)) != rank
            if (np.linalg.norm(taken - at, axis=1)[others] > room[others]).all():
                break
        else:
            continue
        taken, room = np.vstack([taken, at]), np.append(room, NUMBER_DISTANCE)
        text = ax.text(float(at[0]), float(at[1]), str(rank + 1), ha="center", va="center", size=8)
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        text.set_zorder(5)
