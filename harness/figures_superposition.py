"""Both scans laid on each other, before and after registration (6.9, 6.21 to 6.23, 6.30)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy.spatial.transform import RigidTransform

from harness.figures_page import mixed_order, projections, thinned
from harness.looks import FRONT, SOURCE, TARGET, TOP, Projection
from harness.pair_view import PairView
from harness.scoring import pose_error
from registration.scan import FloatArray


def draw_superposition(pair: PairView, title: str) -> Figure:
    """The scans in the target's frame: as if the sensor had not moved, and by the pose.

    The pose is the estimate; without one it is the exact pose, and the figure says so.
    """
    target = pair.target.points_mm[pair.target.valid]
    source = pair.source.points_mm[pair.source.valid]
    pose = pair.result.T_target_source
    after = _moved(source, pair.T_target_source_exact if pose is None else pose)
    if pose is None:
        column = "Exact pose, the method gave none\nwhat the answer should have been"
    else:
        error = pose_error(pair.T_target_source_exact, pose)
        column = (
            f"After: estimated pose\noff by {np.rad2deg(error.rotation_rad):.2f}° and "
            f"{error.translation_mm:.1f} mm"
        )
    figure, axes = projections(
        f"{title}\nSuperposition in the frame of the target",
        ["Before: each scan in its own frame\nas if the sensor had not moved", column],
        [target, source, after],
        _note(pair),
    )
    for place, moved in enumerate((source, after)):
        _draw_both(axes[0][place], target, moved, FRONT)
        _draw_both(axes[1][place], target, moved, TOP)
    for name, view, colour in (
        ("target", pair.target_view, TARGET),
        ("source", pair.source_view, SOURCE),
    ):
        axes[0][0].scatter([], [], s=24, lw=0, c=colour, label=f"{name}: {view} view")
    # On the second line of the title, which is short, whatever the names in the first are.
    figure.legend(
        *axes[0][0].get_legend_handles_labels(),
        loc="upper right",
        bbox_to_anchor=(1.0, 1.0 - 0.17 / figure.get_figheight()),
        ncols=2,
        borderaxespad=0.2,
    )
    return figure


def _draw_both(
    ax: Axes, target_mm: FloatArray, source_mm: FloatArray, projection: Projection
) -> None:
    """Both clouds mixed, so that neither lies on top of the other."""
    clouds = [thinned(cloud) for cloud in (target_mm, source_mm)]
    colours = np.repeat([to_rgb(TARGET), to_rgb(SOURCE)], [len(c) for c in clouds], axis=0)
    points = np.concatenate(clouds)
    mixed = mixed_order(len(points))
    ax.scatter(
        points[mixed, projection.right], points[mixed, projection.up],
        c=colours[mixed], s=1.3, lw=0,
    )  # fmt: skip


def _moved(points_mm: FloatArray, T_new_old: RigidTransform) -> FloatArray:
    moved: FloatArray = T_new_old.apply(points_mm) if len(points_mm) else points_mm
    return moved


def _note(pair: PairView) -> str:
    text = f"The target view sees {pair.overlap:.0%} of the source's points."
    if pair.result.status == "ok":
        return text
    status = pair.result.status
    return f"{text} {status[0].upper()}{status[1:]}: {pair.result.reason}."
