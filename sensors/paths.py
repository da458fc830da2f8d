"""Where a sensor is while it scans: one exact pose a profile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation


@dataclass(frozen=True)
class ViewPath:
    """The poses from which one view was scanned.

    T_world_profile: (profiles,) exact poses of the sensor, translations in mm.
    step_mm: the distance along X that the sensor is believed to move between profiles; what it
        really moved is in the poses.
    """

    T_world_profile: RigidTransform
    step_mm: float

    def __post_init__(self) -> None:
        _check_step(self.step_mm)
        if self.T_world_profile.single or len(self.T_world_profile) == 0:
            raise ValueError("T_world_profile holds no sequence of poses; expected one a profile")

    @property
    def profiles(self) -> int:
        """Number of profiles."""
        return len(self.T_world_profile)

    @property
    def T_world_view(self) -> RigidTransform:  # noqa: N802 - poses keep their name everywhere
        """The pose of the first profile, which is the frame of the scan."""
        return self.T_world_profile[0]


def straight_line(T_world_view: RigidTransform, profiles: int, step_mm: float) -> ViewPath:
    """Move the sensor along its own X without turning: profile k lies at x = k step_mm."""
    if profiles < 1:
        raise ValueError(f"profiles is {profiles}; expected at least 1")
    _check_step(step_mm)
    along = np.zeros((profiles, 3))
    along[:, 0] = step_mm * np.arange(profiles)
    return ViewPath(T_world_view * RigidTransform.from_translation(along), step_mm)


def aimed_view(
    aim_mm: ArrayLike,
    distance_mm: float,
    yaw_rad: float,
    pitch_rad: float,
    roll_rad: float,
    profiles: int,
    step_mm: float,
) -> RigidTransform:
    """Pose of the first profile of a straight line whose middle looks at the aim.

    At yaw 0 the optical axis (Z) points along the world's X; positive yaw turns it towards the
    world's Y, positive pitch dips it below the horizontal. Unpitched and unrolled, X is up and Y
    lies to the right; positive roll turns X towards Y about the optical axis. The line of motion
    is the sensor's own X, so it tilts and rolls along.

    aim_mm: (3,) world coordinates; distance_mm: from the sensor's front to it, half-way along.
    """
    facing = Rotation.from_euler("ZY", [yaw_rad, pitch_rad])
    # Columns: the sensor's X, Y and Z in the world, for an optical axis along the world's X.
    level = Rotation.from_matrix([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    rotation = facing * level * Rotation.from_rotvec([0.0, 0.0, roll_rad])
    half_line_mm = 0.5 * step_mm * (profiles - 1)
    origin_mm = np.asarray(aim_mm, dtype=float) - rotation.apply([half_line_mm, 0.0, distance_mm])
    return RigidTransform.from_components(origin_mm, rotation)


def _check_step(step_mm: float) -> None:
    if not (np.isfinite(step_mm) and step_mm > 0.0):
        raise ValueError(f"step_mm is {step_mm}; expected a length above 0 mm")
