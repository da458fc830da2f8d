"""Both scans laid on each other, before and after registration (6.9, 6.21 to 6.23, 6.30)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import RigidTransform

from harness.figures.looks import FRONT, SOURCE, TARGET, TOP
from harness.figures.page import name_clouds, projections, scatter_mixed, thinned
from harness.figures.pair_view import PairView
from harness.scoring.poses import pose_error
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
        clouds = [thinned(target), thinned(moved)]
        for row, projection in enumerate((FRONT, TOP)):
            scatter_mixed(axes[row][place], clouds, (TARGET, SOURCE), projection)
    names = f"target: {pair.target_view} view", f"source: {pair.source_view} view"
    name_clouds(figure, axes[0][0], dict(zip(names, (TARGET, SOURCE), strict=True)))
    return figure


def _moved(points_mm: FloatArray, T_new_old: RigidTransform) -> FloatArray:
    moved: FloatArray = T_new_old.apply(points_mm) if len(points_mm) else points_mm
    return moved


def _note(pair: PairView) -> str:
    text = f"The target view sees {pair.overlap:.0%} of the source's points."
    if pair.result.status == "ok":
        return text
    status = pair.result.status
    return f"{text} {status[0].upper()}{status[1:]}: {pair.result.reason}."
