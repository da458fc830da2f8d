"""The figures of one pair of profiles: 4.4 to 4.9, from the measurements to the superposition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.projections.polar import PolarAxes

from experiments.profile_pairs import ProfilePair
from harness.figures.looks import GREY, INK, SOURCE, TARGET
from harness.figures.page import AXES, HEAD_IN, LEFT_IN, WIDTH_IN, add_axes, new_figure
from harness.scoring import pose_error
from registration.planar.circle import GaussCircle, circle_overlap
from registration.planar.pipeline import PlanarEvidence
from registration.scan import FloatArray, Scan

FOOT_IN = 0.85
HALO: list[AbstractPathEffect] = [
    withStroke(linewidth=2.5, foreground="white")
]  # names stay readable on lines
COLOURS = (TARGET, SOURCE)
MARGIN_MM = 25.0
NORMAL_MM = 35.0
LENGTHS = (
    "Every ray is the normal of a segment, as long as the segment, in mm; 0° is along Y, 90° along "
    "Z, away from the sensor."
)


def draw_raw(pair: ProfilePair, where: str) -> Figure:
    """Both profiles as measured, each in its own frame."""
    figure, axes = _two_frames(pair, f"{where}\nProfiles as measured, as figure 4.4")
    for ax, scan, colour in zip(axes, (pair.target, pair.source), COLOURS, strict=True):
        _dots(ax, _measured(scan), colour)
    return figure


def draw_segments(pair: ProfilePair, evidence: PlanarEvidence, where: str) -> Figure:
    """The straight segments of both profiles, numbered, with their normals."""
    figure, axes = _two_frames(
        pair,
        f"{where}\nStraight segments and their normals, as figure 4.5",
        "Numbered in the order of the pixels; the normals point to the sensor, which is below.",
    )
    for ax, scan, segments, colour, letter in zip(
        axes, (pair.target, pair.source), evidence.segments, COLOURS, "TS", strict=True
    ):
        _dots(ax, _measured(scan), GREY)
        _lines(ax, segments.endpoints_mm[:, :, 1:], colour)
        middle, normal = segments.centroid_mm[:, 1:], NORMAL_MM * segments.normal[:, 1:]
        for k, (point, arrow) in enumerate(zip(middle, normal, strict=True)):
            _arrow(ax, point, point + arrow, INK)
            y_mm, z_mm = point + 1.45 * arrow
            name = ax.text(y_mm, z_mm, f"{letter}{k + 1}", ha="center", va="center", size=9)
            name.set_path_effects(HALO)
    return figure


def draw_circles(pair: ProfilePair, evidence: PlanarEvidence, where: str) -> Figure:
    """The modified Gauss circles of both profiles."""
    figure, axes = _polar_page(2, f"{where}\nModified Gauss circles, as figure 4.6", LENGTHS)
    names = _view_names(pair)
    for ax, circle, colour, letter, name in zip(
        axes, evidence.circles, COLOURS, "TS", names, strict=True
    ):
        ax.set_title(name, pad=14.0)
        _rays(ax, circle, 0.0, colour, [f"{letter}{k + 1}" for k in range(len(circle))])
    _share_radius(axes)
    return figure


def draw_turned(pair: ProfilePair, evidence: PlanarEvidence, where: str) -> Figure:
    """The source's Gauss circle turned by the estimate, on the target's."""
    dphi_rad = -float(_estimate(pair)[0])
    overlap = circle_overlap(
        *evidence.circles, dphi_rad, pair.trial.spec.method.params.angle_tolerance_rad
    )
    figure, (ax,) = _polar_page(
        1,
        f"{where}\nThe source's Gauss circle turned by {-np.degrees(dphi_rad):.2f}°, as figure 4.7",
        f"{LENGTHS} Normals that agree overlap by {overlap:.0f} mm in all (4-5); segments that "
        f"lie on each other, by {evidence.matches.overlap_mm.sum():.0f} mm.",
    )
    for circle, turn, colour, letter in zip(
        evidence.circles, (0.0, -dphi_rad), COLOURS, "TS", strict=True
    ):
        names = [f"{letter}{k + 1}" for k in range(len(circle))]
        # Beside their rays, either profile's on a side of its own: the rays lie on each other.
        _rays(ax, circle, turn, colour, names, 0.1 if letter == "T" else -0.1)
    _name_colours(ax, pair, (1.3, 1.02))
    _share_radius([ax])
    return figure


def draw_shift(pair: ProfilePair, evidence: PlanarEvidence, where: str) -> Figure:
    """The segments after the turn alone, and the shifts between the centroids that belong."""
    turn_rad, *shift = _estimate(pair)
    turned = [
        _turned(a[..., 1:], turn_rad)
        for a in (evidence.segments[1].endpoints_mm, evidence.segments[1].centroid_mm)
    ]
    target = evidence.segments[0]
    everything = [target.endpoints_mm[:, :, 1:], turned[0]]
    figure, (ax,) = _scaled_page(
        f"{where}\nShift of the centroids after the turn, as figure 4.8",
        everything,
        1,
        f"Arrows join the centroids of segments that lie on each other; the estimate is "
        f"{shift[0]:.1f} mm along Y and {shift[1]:.1f} mm along Z.",
    )
    _lines(ax, everything[0], TARGET)
    _lines(ax, turned[0], SOURCE)
    for i, j in evidence.matches.pairs:
        _arrow(ax, turned[1][j], target.centroid_mm[i, 1:], INK)
    for points, letter, below in ((target.centroid_mm[:, 1:], "T", 7), (turned[1], "S", -14)):
        for k, point in enumerate(points):
            name = ax.annotate(
                f"{letter}{k + 1}", point, (0, below), textcoords="offset points", ha="center"
            )
            name.set_path_effects(HALO)
    _name_colours(ax, pair, (1.0, 1.0), "turned source")
    return figure


def draw_superposed(pair: ProfilePair, where: str) -> Figure:
    """The measured points of both profiles, the source's moved by the estimate."""
    turn_rad, *shift = _estimate(pair)
    target = _measured(pair.target)
    source = _turned(_measured(pair.source), turn_rad) + shift
    pose = pair.result.T_target_source
    assert pose is not None
    error = pose_error(pair.exact, pose)
    figure, (ax,) = _scaled_page(
        f"{where}\nBoth profiles in the frame of the target, as figure 4.9",
        [target, source],
        1,
        f"The estimate is off by {np.rad2deg(error.rotation_rad):.2f}° and "
        f"{error.translation_mm:.1f} mm.",
    )
    _dots(ax, target, TARGET)
    _dots(ax, source, SOURCE)
    _name_colours(ax, pair, (1.0, 1.0))
    return figure


def _two_frames(pair: ProfilePair, title: str, note: str = "") -> tuple[Figure, list[Axes]]:
    clouds = [_measured(pair.target), _measured(pair.source)]
    figure, axes = _scaled_page(title, clouds, 2, note)
    for ax, name in zip(axes, _view_names(pair), strict=True):
        ax.set_title(name)
    return figure, axes


def _scaled_page(
    title: str, points_mm: Sequence[FloatArray], panels: int, note: str = ""
) -> tuple[Figure, list[Axes]]:
    """Panels of Z over Y side by side, all to one scale that holds every point."""
    points = np.concatenate([p.reshape(-1, 2) for p in points_mm])
    low, high = points.min(axis=0) - 2 * MARGIN_MM, points.max(axis=0) + MARGIN_MM
    room_in = WIDTH_IN - LEFT_IN - 0.3 - (panels - 1) * 0.25
    wide_in = room_in / panels
    tall_in = min(wide_in * (high[1] - low[1]) / (high[0] - low[0]), 6.0)
    wide_in = tall_in * (high[0] - low[0]) / (high[1] - low[1])
    figure = new_figure(title, HEAD_IN + FOOT_IN + tall_in, note)
    axes = []
    for panel in range(panels):
        ax = add_axes(figure, LEFT_IN + panel * (wide_in + 0.25), FOOT_IN, wide_in, tall_in)
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
        ax.set_aspect("equal")
        ax.set_xlabel(AXES[1])
        if panel == 0:
            ax.set_ylabel(AXES[2])
        else:
            ax.tick_params(labelleft=False)
        axes.append(ax)
    return figure, axes


def _polar_page(panels: int, title: str, note: str) -> tuple[Figure, list[PolarAxes]]:
    size_in = 3.4 if panels == 2 else 4.6
    figure = new_figure(title, HEAD_IN + 0.7 + size_in + 0.3, note)
    gap = (WIDTH_IN - panels * size_in) / (panels + 1)
    axes = []
    for panel in range(panels):
        left = gap + panel * (size_in + gap)
        ax = add_axes(figure, left, 0.7, size_in, size_in, projection="polar")
        assert isinstance(ax, PolarAxes)
        ax.set_rlabel_position(67.5)
        axes.append(ax)
    return figure, axes


def _rays(
    ax: PolarAxes,
    circle: GaussCircle,
    turn_rad: float,
    colour: str,
    names: Sequence[str],
    beside_rad: float = 0.0,
) -> None:
    for angle, length, name in zip(
        circle.angle_rad + turn_rad, circle.length_mm, names, strict=True
    ):
        ax.plot([angle, angle], [0.0, length], c=colour, lw=1.8, marker="o", ms=4.0, markevery=[1])
        beyond = length + 0.09 * circle.length_mm.max()
        ax.text(angle + beside_rad, beyond, name, color=colour, ha="center", va="center", size=9)


def _share_radius(axes: Sequence[PolarAxes]) -> None:
    most = max(ax.get_ylim()[1] for ax in axes)
    for ax in axes:
        ax.set_ylim(0.0, 1.08 * most)


def _name_colours(
    ax: Axes, pair: ProfilePair, place: tuple[float, float], source: str = "source"
) -> None:
    names = _view_names(pair)
    names = names[0], names[1].replace("Source", source.capitalize())
    for colour, name in zip(COLOURS, names, strict=True):
        ax.plot([], [], "o", c=colour, ms=5.0, label=name)
    ax.legend(loc="lower right", bbox_to_anchor=place, ncols=2, borderaxespad=0.3)


def _view_names(pair: ProfilePair) -> tuple[str, str]:
    return f"Target: {pair.target_view} view", f"Source: {pair.source_view} view"


def _measured(scan: Scan) -> FloatArray:
    points: FloatArray = scan.points_mm[scan.valid][:, 1:]
    return points


def _estimate(pair: ProfilePair) -> FloatArray:
    """(3,) turn about X in rad and shift along Y and Z in mm."""
    pose = pair.result.T_target_source
    assert pose is not None
    return np.array([pose.rotation.as_rotvec()[0], *np.asarray(pose.translation)[1:]])


def _turned(points_mm: FloatArray, angle_rad: float) -> FloatArray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned: FloatArray = points_mm @ np.array([[cos, sin], [-sin, cos]])
    return turned


def _dots(ax: Axes, points_mm: FloatArray, colour: str) -> None:
    ax.plot(points_mm[:, 0], points_mm[:, 1], ".", ms=2.5, c=colour, mec="none")


def _lines(ax: Axes, ends_mm: FloatArray, colour: str) -> None:
    for ends in ends_mm:
        ax.plot(ends[:, 0], ends[:, 1], "-o", ms=3.0, lw=1.8, c=colour)


def _arrow(ax: Axes, start: FloatArray, end: FloatArray, colour: str) -> None:
    look = {"arrowstyle": "->", "color": colour, "lw": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", (end[0], end[1]), (start[0], start[1]), arrowprops=look)
