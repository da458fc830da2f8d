"""The modified Gauss spheres of both views (6.7, 6.18 to 6.20)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from harness.figures_page import GREY, INK, PALE, SOURCE, TARGET, amount, new_figure
from harness.figures_planes import normal_colours
from harness.pair_view import PairView
from registration.scan import FloatArray, IntArray
from registration.thesis.gauss_sphere import GaussSphere

LARGEST_PT2 = 420.0  # area of the marker of the heaviest normal of both views
NUMBERED = 12  # normals a view that get their number, heaviest first
NUMBER_DISTANCE = 0.085  # of the sphere's radius, between two numbers


def draw_gauss_spheres(
    pair: PairView, spheres: tuple[GaussSphere, GaussSphere], matches: IntArray, title: str
) -> Figure:
    """Both spheres seen from the sensor, and the source's turned onto the target's."""
    figure = new_figure(f"{title}\nModified Gauss spheres, seen from the sensor", 4.4)
    axes = figure.subplots(1, 3)
    heaviest = max([float(s.weight[0]) for s in spheres if len(s)], default=1.0)
    names = (("Target", pair.target_view, "o"), ("Source", pair.source_view, "D"))
    for column, ((role, view, marker), sphere) in enumerate(zip(names, spheres, strict=True)):
        ax = axes[column]
        _draw_globe(ax)
        size = LARGEST_PT2 * sphere.weight / heaviest
        colours = normal_colours(len(sphere), matches[:, column])
        ax.scatter(
            sphere.direction[:, 1], sphere.direction[:, 0], s=np.maximum(size, 8.0), c=colours,
            marker=marker, edgecolors=INK, lw=0.6, alpha=0.85, zorder=3,
        )  # fmt: skip
        _number(ax, sphere)
        area = 1e-2 * float(sphere.weight.sum())
        ax.set_title(f"{role}: {view} view\n{amount(len(sphere), 'normal')}, {area:.0f} cm²")
    pose = pair.result.T_target_source
    by = "estimated" if pose is not None else "exact"
    turn = (pair.T_target_source_exact if pose is None else pose).rotation
    _draw_turned(axes[2], spheres, turn, heaviest)
    axes[2].set_title(f"Source turned by the {by} rotation\n{amount(len(matches), 'match')}")
    figure.supxlabel(
        "Marker area: area of the patches with this normal; number: its rank, the heaviest twelve. "
        "Colour: as in the patches' figure.\nThe centre faces the sensor, the rim is seen edge-on; "
        "circles every 30 degrees. Faint: turned away from the target's sensor.",
        fontsize=8.5, color=INK, x=0.02, ha="left",
    )  # fmt: skip
    return figure


def _draw_turned(
    ax: Axes, spheres: tuple[GaussSphere, GaussSphere], turn: Rotation, heaviest: float
) -> None:
    _draw_globe(ax)
    target, source = spheres
    turned = turn.apply(source.direction) if len(source) else np.zeros((0, 3))
    for direction, weight, marker, colour, role in (
        (target.direction, target.weight, "o", TARGET, "target"),
        (turned, source.weight, "D", SOURCE, "source"),
    ):
        ax.scatter(
            direction[:, 1], direction[:, 0], s=np.maximum(LARGEST_PT2 * weight / heaviest, 8.0),
            marker=marker, facecolors="none" if role == "source" else f"{colour}55",
            edgecolors=colour, lw=1.3, alpha=None, zorder=3,
        )  # fmt: skip
        ax.scatter([], [], s=40, marker=marker, facecolors="none", edgecolors=colour, label=role)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)


def _draw_globe(ax: Axes) -> None:
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


def _number(ax: Axes, sphere: GaussSphere) -> None:
    placed = np.zeros((0, 2))
    for rank, (x, y) in enumerate(sphere.direction[:NUMBERED, :2]):
        # Beside the marker, away from the centre, where there is more room.
        length = max(float(np.hypot(x, y)), 1e-9)
        at = _beside(np.array([y, x]), np.array([y, x]) / length)
        if (np.linalg.norm(placed - at, axis=1) < NUMBER_DISTANCE).any():
            continue
        placed = np.vstack([placed, at])
        ax.text(
            float(at[0]),
            float(at[1]),
            str(rank + 1),
            ha="center",
            va="center",
            fontsize=8,
            color=INK,
            zorder=4,
        )


def _beside(tip: FloatArray, outward: FloatArray) -> FloatArray:
    return tip + 0.13 * outward
