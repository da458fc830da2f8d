"""What shows an experiment as a whole: the arm before the scene, and all views superposed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy.spatial.transform import RigidTransform

from harness.arm_figure import draw_arm
from harness.chain import Link, middle_view, poses_in
from harness.clouds import measured_points, write_cloud
from harness.execution import scan_view
from harness.figures_page import (
    FRONT,
    TOP,
    Style,
    mixed_order,
    projections,
    save,
    thinned,
)
from harness.pair_view import file_slug
from harness.scoring import exact_pose, pose_error
from harness.trials import Trial, TrialSpec
from harness.views import ViewSpec
from registration.scan import FloatArray
from scenes import SCENES
from scenes.picture import VIEW_COLOURS
from sensors import SENSORS

PREFIX = "views_"


class Drawn(NamedTuple):
    """A trial whose figures are drawn, and its spec."""

    trial: Trial
    spec: TrialSpec


def draw_overview(
    trials: Sequence[Trial], labels: Collection[str], rows: pd.DataFrame, folder: Path
) -> list[Path]:
    """Draw the arm at every view, and all views laid on each other by each of the methods.

    labels: of the methods that are drawn. rows: as store.load gives them. folder: the results;
    figures and merged clouds go below it. Returns the files.
    """
    drawn = [
        Drawn(trial, trial.spec)
        for trial in trials
        if isinstance(trial.spec, TrialSpec) and trial.spec.repeat == 0 and not trial.spec.given
    ]
    if not drawn:
        return []
    pictures, clouds = folder / "figures", folder / "scans"
    for old in [*pictures.glob(f"{PREFIX}*"), *clouds.glob(f"{PREFIX}*")]:
        old.unlink()
    views: dict[str, tuple[TrialSpec, ViewSpec]] = {}
    for _, spec in drawn:
        for view in (spec.source, spec.target):
            views.setdefault(view.name, (spec, view))
    files = []
    (first, _), *_ = views.values()
    arms = [view.arm for _, view in views.values() if view.arm is not None]
    if arms:
        paths = {name: spec.path(view) for name, (spec, view) in views.items()}
        title = f"{first.scene.name}: the arm before the scene"
        pictures.mkdir(parents=True, exist_ok=True)
        file = pictures / f"{PREFIX}arm.png"
        scene = SCENES[first.scene.name].builder(first.scene.params)
        sensor = SENSORS[first.sensor.name].factory(first.sensor.params)
        files.append(draw_arm(scene, sensor, arms[0], paths, title, file))
    if len(views) < 3:
        return files
    points_mm = {
        name: measured_points(scan_view(spec, view)) for name, (spec, view) in views.items()
    }
    for label in labels:
        estimated, exact = _links(drawn, rows, label)
        if not estimated:
            continue
        reference = middle_view(exact, list(views))
        poses, truth = (poses_in(reference, links) for links in (estimated, exact))
        title = f"{first.scene.name}: all views in the frame of {reference}, method {label}"
        slug = f"{PREFIX}{file_slug(label)}"
        with Style():
            figure = superposition(points_mm, poses, truth, title)
            files.append(save(figure, pictures / f"{slug}_superposed.png"))
        moved = [poses[name].apply(points_mm[name]) for name in poses]
        colours = dict(zip(points_mm, _colours(len(points_mm)), strict=True))
        rgb = [_bytes(colours[name]) for name in poses]
        files.append(write_cloud(clouds / f"{slug}_merged.ply", moved, rgb))
    return files


def superposition(
    points_mm: Mapping[str, FloatArray],
    poses: Mapping[str, RigidTransform],
    truth: Mapping[str, RigidTransform],
    title: str,
) -> Figure:
    """All views in one frame, by the estimates and by the exact poses, front and top.

    points_mm: (n, 3) of each view in its own frame. poses, truth: T_reference_view; a view without
    an estimated one is left out on that side.
    """
    sides = [
        {name: pose.apply(points_mm[name]) for name, pose in chosen.items()}
        for chosen in (poses, truth)
    ]
    columns = ["By the estimated poses", "By the exact poses"]
    figure, axes = projections(
        title, columns, [p for side in sides for p in side.values()], _note(points_mm, poses, truth)
    )
    colours = dict(zip(points_mm, _colours(len(points_mm)), strict=True))
    for column, side in enumerate(sides):
        shown = {name: thinned(points) for name, points in side.items()}
        points = np.concatenate(list(shown.values()))
        paint = np.concatenate(
            [np.tile(to_rgb(colours[name]), (len(part), 1)) for name, part in shown.items()]
        )
        order = mixed_order(len(points))
        for row, projection in enumerate((FRONT, TOP)):
            axes[row][column].scatter(
                points[order, projection.right], points[order, projection.up],
                c=paint[order], s=1.3, lw=0,
            )  # fmt: skip
    for name, colour in colours.items():
        axes[0][0].scatter([], [], s=24, lw=0, c=colour, label=name)
    figure.legend(
        *axes[0][0].get_legend_handles_labels(),
        loc="upper right",
        bbox_to_anchor=(1.0, 1.0 - 0.17 / figure.get_figheight()),
        ncols=len(colours),
        borderaxespad=0.2,
    )
    return figure


def _links(drawn: Sequence[Drawn], rows: pd.DataFrame, label: str) -> tuple[list[Link], list[Link]]:
    """What a method found at repeat 0, where it answered, and the exact poses of the same pairs."""
    found = {row["id"]: row for row in rows.to_dict("records") if row["status"] == "ok"}
    estimated, exact = [], []
    for trial, spec in drawn:
        if trial.label != label:
            continue
        names = spec.target.name, spec.source.name
        paths = spec.path(spec.target), spec.path(spec.source)
        exact.append(Link(*names, exact_pose(*paths)))
        if trial.id in found:
            pose = RigidTransform.from_matrix(found[trial.id]["T_estimated"])
            estimated.append(Link(*names, pose))
    return estimated, exact


def _note(
    points_mm: Mapping[str, FloatArray],
    poses: Mapping[str, RigidTransform],
    truth: Mapping[str, RigidTransform],
) -> str:
    parts = []
    for name in points_mm:
        if name not in poses:
            parts.append(f"{name} is not linked by an answer and left out")
            continue
        error = pose_error(truth[name], poses[name])
        if error.rotation_rad or error.translation_mm:
            parts.append(
                f"{name} is off by {np.rad2deg(error.rotation_rad):.2f}° and "
                f"{error.translation_mm:.1f} mm"
            )
    return f"Pair by pair from the middle view: {'; '.join(parts)}."


def _colours(count: int) -> list[str]:
    return [VIEW_COLOURS[i % len(VIEW_COLOURS)] for i in range(count)]


def _bytes(colour: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue
