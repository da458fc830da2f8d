"""Where the views of an experiment are taken from, and what the thesis prints about them."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from harness.config.choices import LATER, joined_json
from harness.config.errors import ConfigError, nearest
from harness.config.schema import (
    AimedView,
    Experiment,
    NextView,
    PrintedPose,
    RelativeView,
    RotationLabels,
    ScanLine,
    StartView,
)
from harness.scoring.poses import pose_from_parameters
from registration.scan import FloatArray
from sensors.arm import ArmParams, ReachError, next_view, start_view, viewing_line
from sensors.paths import (
    ALONG_X,
    Direction,
    Line,
    ViewPath,
    aimed_view,
    straight_line,
    travel_of,
)

Vector = tuple[float, float, float]

# For each reading of the labels, which printed angle is the turn about the sensor's X, Y, Z.
LABEL_ORDER: dict[RotationLabels, tuple[int, int, int]] = {
    "printed": (0, 1, 2),
    "swapped": (2, 1, 0),
    "cyclic": (2, 0, 1),
}


@dataclass(frozen=True)
class PoseStep:
    """One change of frame on the way to a view; psi, phi, theta as in (4-6), then (4-7)."""

    rotation_deg: Vector
    translation_mm: Vector
    inverted: bool

    @property
    def pose(self) -> RigidTransform:
        """The frame that is reached, in the frame before."""
        pose = pose_from_parameters(np.array(self.rotation_deg), np.array(self.translation_mm))
        return pose.inv() if self.inverted else pose


@dataclass(frozen=True)
class ArmStep:
    """The way from the first profile of one view to that of the next: waist and track move."""

    waist_deg: float
    track_mm: float


@dataclass(frozen=True)
class VerticalLine:
    """Appendix B's line along the laboratory's vertical.

    end_mm: the height of the world at which it begins, or None for where the view puts it.
    """

    direction: Direction
    end_mm: float | None


@dataclass(frozen=True)
class ViewSpec:
    """Where one view is taken from, in the numbers of the config: a first view and steps from it.

    The name is part of it: two views from one place are two scans.
    arm: what carries the sensor there, or None for the exact straight line.
    rest_seed: draws where within a count of its encoder each joint comes to rest.
    line: the vertical line it is scanned along, or None for one along the sensor's own X.
    """

    name: str
    aim: AimedView | StartView
    steps: tuple[PoseStep | ArmStep, ...]
    arm: ArmParams | None = None
    rest_seed: int | None = None
    line: VerticalLine | None = field(default=None, metadata=LATER)

    @functools.cached_property
    def text(self) -> str:
        """Its canonical JSON, made once for all the trials that share it."""
        return joined_json(self)

    def path(self, profiles: int, step_mm: float) -> ViewPath:
        """The viewing line of this view as it is driven; raises LineError."""
        T_world_view, arm = self._asked(profiles, step_mm)
        travel = self._travel(T_world_view)
        if arm is None:
            return straight_line(T_world_view, profiles, step_mm, travel)
        return viewing_line(T_world_view, profiles, step_mm, arm, self.rest_seed, travel)

    def commanded(self, profiles: int, step_mm: float) -> RigidTransform:
        """T_world_view of the first profile as the config asks for it; raises LineError."""
        return self._asked(profiles, step_mm)[0]

    def _asked(self, profiles: int, step_mm: float) -> tuple[RigidTransform, ArmParams | None]:
        """The pose of the first profile, and the arm, held on the track where a step leaves it."""
        T_world_view, arm = self._first(profiles, step_mm)
        if self.line is not None and self.line.end_mm is not None:
            x_mm, y_mm, _ = T_world_view.translation
            T_world_view = RigidTransform.from_components(
                [x_mm, y_mm, self.line.end_mm], T_world_view.rotation
            )
        for step in self.steps:
            if isinstance(step, PoseStep):
                T_world_view, arm = T_world_view * step.pose, self.arm
                continue
            if arm is None:
                raise ReachError("no arm carries the view, whose waist and track could move")
            travel = self._travel(T_world_view)
            start = viewing_line(T_world_view, profiles, step_mm, arm, travel=travel)
            waist_rad = float(np.deg2rad(step.waist_deg))
            T_world_view, track_mm = next_view(start.counts[0], waist_rad, step.track_mm, arm)
            arm = replace(arm, track_mm=track_mm)
        return T_world_view, arm

    def _first(self, profiles: int, step_mm: float) -> tuple[RigidTransform, ArmParams | None]:
        """The view that all steps start from, and the arm, held where it stands on the track."""
        view = self.aim
        if isinstance(view, StartView):
            if self.arm is None:
                raise ReachError("no arm carries the view, whose joints are given")
            arm = replace(self.arm, track_mm=view.track_mm)
            return start_view(view.joints_deg, view.track_mm, self.arm), arm
        yaw_rad, pitch_rad, roll_rad = np.deg2rad(
            [view.yaw_deg, view.pitch_deg, view.roll_deg]
        ).tolist()
        how: tuple[Line, Direction] = ("sensor_x", "up")
        if self.line is not None:
            how = "vertical", self.line.direction
        T_world_view = aimed_view(
            view.aim_mm, view.distance_mm, yaw_rad, pitch_rad, roll_rad, profiles, step_mm, *how
        )
        return T_world_view, self.arm

    def _travel(self, T_world_view: RigidTransform) -> FloatArray:
        """(3,) direction of the motion in the frame of a view at a commanded pose."""
        if self.line is None:
            return ALONG_X
        return travel_of(T_world_view, "vertical", self.line.direction)


def relabelled(pose: PrintedPose, labels: RotationLabels) -> tuple[Vector, Vector]:
    """psi, phi, theta in degrees and the translation in mm of a pose the thesis printed."""
    x, y, z = (pose.rotation_deg[index] for index in LABEL_ORDER[labels])
    return (x, y, z), pose.translation_mm


def view_spec(experiment: Experiment, name: str, file: Path) -> ViewSpec:
    """Follow a view to the aimed view that it hangs on, in the order from there to here."""
    steps: list[PoseStep | ArmStep] = []
    seen = [name]
    while not isinstance(view := experiment.views[seen[-1]], AimedView | StartView):
        key = ("views", seen[-1])
        step: PoseStep | ArmStep
        if isinstance(view, NextView):
            if experiment.arm is None:
                raise ConfigError(file, (*key, "next_of"), "moves the arm, and `arm` names none")
            other, field = view.next_of, "next_of"
            step = ArmStep(view.waist_deg, view.track_mm)
        elif isinstance(view, RelativeView):
            other, field = view.relative_to, "relative_to"
            step = PoseStep(view.rotation_deg, view.translation_mm, inverted=False)
        else:
            other, step = _placing(experiment, seen[-1], view.placed_by, file)
            field = "placed_by"
        if other not in experiment.views:
            message = f"unknown view {other!r}; {nearest(other, experiment.views)}"
            raise ConfigError(file, (*key, field), message)
        if other in seen:
            chain = " -> ".join([*seen, other])
            raise ConfigError(file, (*key, field), f"goes in a circle: {chain}")
        steps.insert(0, step)
        seen.append(other)
    line = vertical_line(experiment.scan)
    if line is not None and line.end_mm is not None and any(type(s) is PoseStep for s in steps):
        message = "gives a pose whose height is not that of scan.low_mm or high_mm; leave those out"
        raise ConfigError(file, ("views", name), message)
    if isinstance(view, StartView) and experiment.arm is None:
        raise ConfigError(file, ("views", seen[-1]), "gives joints, and `arm` names no arm")
    return ViewSpec(name, view, tuple(steps), line=line)


def vertical_line(scan: ScanLine) -> VerticalLine | None:
    """The vertical line that a config asks for, or None."""
    if scan.line == "sensor_x":
        return None
    return VerticalLine(scan.direction, scan.low_mm if scan.direction == "up" else scan.high_mm)


def _placing(experiment: Experiment, name: str, pair_name: str, file: Path) -> tuple[str, PoseStep]:
    """The other view of a pair, and the printed pose as the step from it to this view."""
    key = ("views", name, "placed_by")
    if pair_name not in experiment.pairs:
        message = f"unknown pair {pair_name!r}; {nearest(pair_name, experiment.pairs)}"
        raise ConfigError(file, key, message)
    pair = experiment.pairs[pair_name]
    if name not in (pair.source, pair.target):
        raise ConfigError(file, key, f"pair {pair_name!r} does not have this view")
    if pair.printed is None:
        raise ConfigError(file, key, f"pair {pair_name!r} has no printed pose")
    rotation_deg, translation_mm = relabelled(pair.printed, experiment.rotation_labels)
    if name == pair.source:
        return pair.target, PoseStep(rotation_deg, translation_mm, inverted=False)
    return pair.source, PoseStep(rotation_deg, translation_mm, inverted=True)
