"""Where a sensor is while it scans: one exact pose a profile."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from registration.scan import LEAST_ALONG_X, FloatArray

Line = Literal["sensor_x", "vertical"]
Direction = Literal["up", "down"]
ALONG_X: FloatArray = np.array([1.0, 0.0, 0.0])
ALONG_X.setflags(write=False)


class LineError(ValueError):
    """No sensor can scan along a viewing line; the message says why."""


@dataclass(frozen=True)
class ViewPath:
    """The poses from which one view was scanned.

    T_world_profile: (profiles,) exact poses of the sensor, translations in mm.
    step_mm: how far the sensor is believed to move between profiles; what it really moved is in
        the poses.
    travel: (3,) unit vector in the sensor frame along which it is believed to move, as of Scan.
    """

    T_world_profile: RigidTransform
    step_mm: float
    travel: FloatArray = field(default_factory=lambda: ALONG_X, kw_only=True)

    def __post_init__(self) -> None:
        _check_step(self.step_mm)
        if self.T_world_profile.single or len(self.T_world_profile) == 0:
            raise ValueError("T_world_profile holds no sequence of poses; expected one a profile")

    @property
    def profiles(self) -> int:
        """Number of profiles."""
        return len(self.T_world_profile)

    @property
    def origins_mm(self) -> FloatArray:
        """(profiles, 3) in the frame of the view, where the sensor is believed to be."""
        steps = self.step_mm * np.arange(self.profiles)
        origins: FloatArray = steps[:, None] * self.travel
        return origins

    @property
    def T_world_view(self) -> RigidTransform:  # noqa: N802 - poses keep their name everywhere
        """The pose of the first profile, which is the frame of the scan."""
        return self.T_world_profile[0]


def straight_line(
    T_world_view: RigidTransform, profiles: int, step_mm: float, travel: FloatArray = ALONG_X
) -> ViewPath:
    """Move the sensor without turning along travel (3,), a unit vector of its own frame."""
    if profiles < 1:
        raise ValueError(f"profiles is {profiles}; expected at least 1")
    _check_step(step_mm)
    along = step_mm * np.arange(profiles)[:, None] * travel
    poses = T_world_view * RigidTransform.from_translation(along)
    return ViewPath(poses, step_mm, travel=travel)


def travel_of(T_world_view: RigidTransform, line: Line, direction: Direction) -> FloatArray:
    """(3,) unit vector in the sensor frame along which a line moves a sensor held at a pose.

    It is known from how the sensor is mounted, and so to whoever registers the scan. Raises
    LineError where that is nearly within the laser plane, which would then sweep no surface.
    """
    if line == "sensor_x":
        return ALONG_X
    upwards = 1.0 if direction == "up" else -1.0
    travel: FloatArray = T_world_view.rotation.inv().apply([0.0, 0.0, upwards])
    if abs(travel[0]) <= LEAST_ALONG_X:
        raise LineError(
            "the laser plane of the sensor is nearly upright, and a vertical line would move it "
            "within that plane"
        )
    return travel


def aimed_view(
    aim_mm: ArrayLike,
    distance_mm: float,
    yaw_rad: float,
    pitch_rad: float,
    roll_rad: float,
    profiles: int,
    step_mm: float,
    line: Line = "sensor_x",
    direction: Direction = "up",
) -> RigidTransform:
    """Pose of the first profile of a straight line whose middle looks at the aim.

    At yaw 0 the optical axis (Z) points along the world's X; positive yaw turns it towards the
    world's Y, positive pitch dips it below the horizontal. Unpitched and unrolled, X is up and Y
    lies to the right; positive roll turns X towards Y about the optical axis. A line along the
    sensor's own X tilts and rolls along; a vertical one does not.

    aim_mm: (3,) world coordinates; distance_mm: from the sensor's front to it, half-way along.
    """
    facing = Rotation.from_euler("ZY", [yaw_rad, pitch_rad])
    # Columns: the sensor's X, Y and Z in the world, for an optical axis along the world's X.
    level = Rotation.from_matrix([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    rotation = facing * level * Rotation.from_rotvec([0.0, 0.0, roll_rad])
    travel = travel_of(RigidTransform.from_rotation(rotation), line, direction)
    half_line_mm = 0.5 * step_mm * (profiles - 1)
    middle_mm = half_line_mm * travel + [0.0, 0.0, distance_mm]
    return RigidTransform.from_components(np.asarray(aim_mm) - rotation.apply(middle_mm), rotation)


def _check_step(step_mm: float) -> None:
    if not (np.isfinite(step_mm) and step_mm > 0.0):
        raise ValueError(f"step_mm is {step_mm}; expected a length above 0 mm")
