"""What shows an experiment as a whole: the arm before the scene, and all views superposed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy.spatial.transform import RigidTransform

from harness.execution import scan_view, scene_of, sensor_of
from harness.figures.arm import draw_arm
from harness.figures.clouds import write_cloud
from harness.figures.looks import FRONT, TOP
from harness.figures.page import name_clouds, page_style, projections, save, scatter_mixed, thinned
from harness.figures.pair_view import PairView
from harness.file_names import file_slug
from harness.scoring.multiview import NO_COVARIANCE, middle_view, poses_in, usable
from harness.scoring.poses import exact_pose, pose_error
from harness.trials.specs import Trial, TrialSpec
from harness.trials.views import ViewSpec
from harness.workers.pool import MakeExecutor
from registration.pose_graph import RelativePose
from registration.scan import FloatArray
from scenes.picture import VIEW_COLOURS

Estimate = tuple[RigidTransform, FloatArray]  # the pose and its covariance
PREFIX = "views_"
SHOWN = 5_000  # points of each view in a panel


class Drawn(NamedTuple):
    """A trial whose figures are drawn, and its spec."""

    trial: Trial
    spec: TrialSpec


def draw_overview(
    trials: Sequence[Trial],
    labels: Collection[str],
    rows: pd.DataFrame,
    folder: Path,
    make_executor: MakeExecutor,
) -> list[Path]:
    """Draw the arm at every view, and all views laid on each other by each of the methods.

    labels: of the methods that are drawn. rows: as store.load gives them. folder: the results;
    figures and merged clouds go below it. Returns the files.
    """
    for kind in ("figures", "scans"):
        for old in (folder / kind).glob(f"{PREFIX}*"):
            old.unlink()
    drawn = [
        Drawn(trial, trial.spec)
        for trial in trials
        if isinstance(trial.spec, TrialSpec)
        and trial.spec.repeat == 0
        and not trial.spec.given
        and trial.label in labels
    ]
    if not drawn:
        return []
    found = {
        row["id"]: (RigidTransform.from_matrix(row["T_estimated"]), usable(row["covariance"]))
        for row in rows.to_dict("records")
        if row["status"] == "ok"
    }
    with make_executor() as executor:
        jobs = [
            executor.submit(_draw_arm, drawn, folder),
            executor.submit(_draw_superpositions, drawn, found, folder),
        ]
        return [file for job in jobs for file in job.result()]


def _views(drawn: Sequence[Drawn]) -> dict[str, tuple[TrialSpec, ViewSpec]]:
    """Each view by its name, with a spec that has it."""
    views: dict[str, tuple[TrialSpec, ViewSpec]] = {}
    for _, spec in drawn:
        for view in (spec.source, spec.target):
            views.setdefault(view.name, (spec, view))
    return dict(sorted(views.items()))  # the same colours whatever pair comes first


def _draw_arm(drawn: Sequence[Drawn], folder: Path) -> list[Path]:
    views = _views(drawn)
    arms = [view.arm for _, view in views.values() if view.arm is not None]
    if not arms:
        return []
    spec = drawn[0].spec
    paths = {name: spec.path(view) for name, (spec, view) in views.items()}
    file = folder / "figures" / f"{PREFIX}arm.png"
    file.parent.mkdir(parents=True, exist_ok=True)
    title = f"{spec.scene.name}: the arm before the scene"
    return [draw_arm(scene_of(spec), sensor_of(spec), arms[0], paths, title, file)]


def _draw_superpositions(
    drawn: Sequence[Drawn], found: Mapping[str, Estimate], folder: Path
) -> list[Path]:
    """A figure and a cloud for each method that answered; of two views the pair's own will do."""
    views = _views(drawn)
    if len(views) < 3:
        return []
    scans = {name: scan_view(spec, view) for name, (spec, view) in views.items()}
    points_mm = {name: scan.points_mm[scan.valid] for name, scan in scans.items()}
    colours = _colours(points_mm)
    files = []
    for label in dict.fromkeys(trial.label for trial, _ in drawn):
        estimated, exact = _links([each for each in drawn if each.trial.label == label], found)
        if not estimated:
            continue
        reference = middle_view(exact, list(views))
        poses, truth = (poses_in(reference, links) for links in (estimated, exact))
        title = f"{drawn[0].spec.scene.name}: all views in the frame of {reference}, method {label}"
        slug = f"{PREFIX}{file_slug(label)}"
        file = folder / "figures" / f"{slug}_superposed.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        with page_style():
            files.append(save(superposition(points_mm, poses, truth, title), file))
        moved = [pose.apply(points_mm[name]) for name, pose in poses.items()]
        rgb = [_bytes(colours[name]) for name in poses]
        files.append(write_cloud(folder / "scans" / f"{slug}_merged.ply", moved, rgb))
    return files


def draw_superposed_pairs(pairs: Sequence[PairView], title: str) -> Figure:
    """All views of some pairs in the frame of the middle one, by the estimates and exactly.

    A pair without an estimate links no views; one at least has to have one.
    """
    points_mm: dict[str, FloatArray] = {}
    estimated, exact = [], []
    for pair in pairs:
        names = pair.target_view, pair.source_view
        for name, scan in zip(names, (pair.target, pair.source), strict=True):
            points_mm[name] = scan.points_mm[scan.valid]
        exact.append(RelativePose(*names, pair.T_target_source_exact, NO_COVARIANCE))
        pose = pair.result.T_target_source
        if pose is not None:
            estimated.append(RelativePose(*names, pose, usable(pair.result.covariance)))
    points_mm = dict(sorted(points_mm.items()))  # the same colours whatever pair comes first
    reference = middle_view(exact, list(points_mm))
    poses, truth = (poses_in(reference, links) for links in (estimated, exact))
    return superposition(points_mm, poses, truth, title)


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
    colours = _colours(points_mm)
    for column, side in enumerate(sides):
        clouds = [thinned(points)[:SHOWN] for points in side.values()]
        for row, projection in enumerate((FRONT, TOP)):
            paint = [colours[name] for name in side]
            scatter_mixed(axes[row][column], clouds, paint, projection)
    name_clouds(figure, axes[0][0], colours)
    return figure


def _links(
    drawn: Sequence[Drawn], found: Mapping[str, Estimate]
) -> tuple[list[RelativePose], list[RelativePose]]:
    """What a method found for its pairs, where it answered, and the exact poses of all of them."""
    estimated, exact = [], []
    for trial, spec in drawn:
        names = spec.target.name, spec.source.name
        T_exact = exact_pose(*spec.paths)
        exact.append(RelativePose(*names, T_exact, NO_COVARIANCE))
        if trial.id in found:
            estimated.append(RelativePose(*names, *found[trial.id]))
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


def _colours(names: Iterable[str]) -> dict[str, str]:
    return {name: VIEW_COLOURS[i % len(VIEW_COLOURS)] for i, name in enumerate(names)}


def _bytes(colour: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue
