"""Where the views of an experiment are taken from, and what the thesis prints about them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from harness.config_errors import ConfigError, nearest
from harness.schema import (
    AimedView,
    Experiment,
    NextView,
    PrintedPose,
    RelativeView,
    RotationLabels,
)
from harness.scoring import pose_from_parameters
from sensors.arm import ArmParams, ReachError, next_view, viewing_line
from sensors.paths import ViewPath, aimed_view, straight_line

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
class ViewSpec:
    """Where one view is taken from, in the numbers of the config: an aimed view and steps from it.

    The name is part of it: two views from one place are two scans.
    arm: what carries the sensor there, or None for the exact straight line.
    rest_seed: draws where within a count of its encoder each joint comes to rest.
    """

    name: str
    aim: AimedView
    steps: tuple[PoseStep | ArmStep, ...]
    arm: ArmParams | None = None
    rest_seed: int | None = None

    def path(self, profiles: int, step_mm: float) -> ViewPath:
        """The viewing line of this view as it is driven; raises ReachError."""
        T_world_view, arm = self._asked(profiles, step_mm)
        if arm is None:
            return straight_line(T_world_view, profiles, step_mm)
        return viewing_line(T_world_view, profiles, step_mm, arm, self.rest_seed)

    def commanded(self, profiles: int, step_mm: float) -> RigidTransform:
        """T_world_view of the first profile as the config asks for it; raises ReachError."""
        return self._asked(profiles, step_mm)[0]

    def _asked(self, profiles: int, step_mm: float) -> tuple[RigidTransform, ArmParams | None]:
        """The pose of the first profile, and the arm, held on the track where a step leaves it."""
        yaw_rad, pitch_rad, roll_rad = np.deg2rad(
            [self.aim.yaw_deg, self.aim.pitch_deg, self.aim.roll_deg]
        ).tolist()
        T_world_view = aimed_view(
            self.aim.aim_mm, self.aim.distance_mm, yaw_rad, pitch_rad, roll_rad, profiles, step_mm
        )
        arm = self.arm
        for step in self.steps:
            if isinstance(step, PoseStep):
                T_world_view, arm = T_world_view * step.pose, self.arm
                continue
            if arm is None:
                raise ReachError("no arm carries the view, whose waist and track could move")
            start = viewing_line(T_world_view, profiles, step_mm, arm)
            waist_rad = float(np.deg2rad(step.waist_deg))
            T_world_view, track_mm = next_view(start.counts[0], waist_rad, step.track_mm, arm)
            arm = replace(arm, track_mm=track_mm)
        return T_world_view, arm


def relabelled(pose: PrintedPose, labels: RotationLabels) -> tuple[Vector, Vector]:
    """psi, phi, theta in degrees and the translation in mm of a pose the thesis printed."""
    x, y, z = (pose.rotation_deg[index] for index in LABEL_ORDER[labels])
    return (x, y, z), pose.translation_mm


def view_spec(experiment: Experiment, name: str, file: Path) -> ViewSpec:
    """Follow a view to the aimed view that it hangs on, in the order from there to here."""
    steps: list[PoseStep | ArmStep] = []
    seen = [name]
    while not isinstance(view := experiment.views[seen[-1]], AimedView):
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
    return ViewSpec(name, view, tuple(steps))


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
