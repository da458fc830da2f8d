"""The arm carries the sensor along a viewing line: where it was told to be, reads, and truly is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from registration.scan import FloatArray
from sensors import f3
from sensors.paths import ALONG_X, LineError, ViewPath, straight_line

TOOL_CENTRE_POINT = RigidTransform.from_translation([0.0, 0.0, 210.0])
"""T_flange_sensor as the controller believes it, section 3.3."""

Vector = tuple[float, float, float]


class ReachError(LineError):
    """The arm cannot follow a viewing line; the message names joint, value and limit."""


@dataclass(frozen=True)
class ArmParams:
    """Where the arm stands, and how well the sensor is fixed to it.

    base_mm: the foot of the arm at the start of the track, in the world. From the default place
        all views of tables 6.1 to 6.5 can be driven, on scenes that stand at the world's origin.
    base_yaw_deg: the world direction of the base's X, from the world's X towards its Y; the track
        runs along the base's Y.
    track_mm: where on the track the arm stands, or None to choose it for every view.
    track_step_mm: the positions tried when choosing.
    bracket_mm, bracket_deg: where the sensor really is and how it is really turned (a rotation
        vector), in the frame where the nominal tool centre point says it is (section 3.3: the
        bracket was never calibrated).
    """

    base_mm: Vector = (-1050.0, -1300.0, 125.0)
    base_yaw_deg: float = 0.0
    track_mm: float | None = None
    track_step_mm: float = 50.0
    bracket_mm: Vector = (0.0, 0.0, 0.0)
    bracket_deg: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("base_mm", "bracket_mm", "bracket_deg"):
            if np.shape(getattr(self, name)) != (3,):
                raise ValueError(f"{name} is {getattr(self, name)}; expected three numbers")
        numbers = (*self.base_mm, self.base_yaw_deg, *self.bracket_mm, *self.bracket_deg)
        if not np.isfinite(numbers).all():
            raise ValueError("base and bracket hold a number that is not finite; expected mm, deg")
        for name, most in (("base_yaw_deg", 360.0), ("bracket_mm", 1000.0), ("bracket_deg", 180.0)):
            if np.abs(getattr(self, name)).max() > most:
                raise ValueError(f"{name} is {getattr(self, name)}; expected {-most:g} to {most:g}")
        if not 0.0 < self.track_step_mm < np.inf:
            raise ValueError(f"track_step_mm is {self.track_step_mm}; expected a length above 0 mm")
        low, high = f3.LIMITS[0]
        if self.track_mm is not None and not low <= self.track_mm <= high:
            raise ValueError(
                f"track_mm is {self.track_mm}; the track runs from {low:g} to {high:g} mm"
            )

    @property
    def T_world_base(self) -> RigidTransform:  # noqa: N802 - poses keep their name everywhere
        """The pose of the base at the start of the track."""
        turn = Rotation.from_euler("z", self.base_yaw_deg, degrees=True)
        return RigidTransform.from_components(self.base_mm, turn)

    @property
    def T_nominal_sensor(self) -> RigidTransform:  # noqa: N802
        """The real sensor in the frame where the nominal tool centre point has it."""
        turn = Rotation.from_rotvec(self.bracket_deg, degrees=True)
        return RigidTransform.from_components(self.bracket_mm, turn)

    @property
    def tracks_mm(self) -> FloatArray:
        """(t,) positions on the track that a view may be taken from."""
        if self.track_mm is not None:
            return np.array([self.track_mm])
        low, high = f3.LIMITS[0]
        return np.arange(low, high + 1e-9, self.track_step_mm)


@dataclass(frozen=True)
class ArmPath(ViewPath):
    """A viewing line as the arm drove it; T_world_profile is where the sensor truly was.

    T_world_commanded: (profiles,) the straight line that was asked for.
    T_world_encoder: (profiles,) what the encoders and the nominal tool centre point say, the Q1 and
        Q3 Q2 of (3-1): the thesis's "theoretical" poses.
    counts: (profiles, 7) encoder counts of the track and the joints.
    """

    T_world_commanded: RigidTransform
    T_world_encoder: RigidTransform
    counts: np.ndarray[tuple[int, int], np.dtype[np.int64]]

    @property
    def track_mm(self) -> float:
        """Where on the track the arm stood."""
        return float(f3.from_pulses(self.counts)[0, 0])

    @property
    def T_world_encoder_view(self) -> RigidTransform:  # noqa: N802
        """What the encoders say of the first profile, beside the exact T_world_view."""
        return self.T_world_encoder[0]


def viewing_line(
    T_world_view: RigidTransform,
    profiles: int,
    step_mm: float,
    params: ArmParams,
    seed: int | None = None,
    travel: FloatArray = ALONG_X,
) -> ArmPath:
    """Drive the sensor along a straight line in steps of XSTEP, as appendix B does.

    T_world_view: commanded pose of the first profile. travel: (3,) unit vector of the sensor frame
    along which to move. seed: draws where within a count of its
    encoder each joint comes to rest at every profile; None lets it rest in the middle. The joints
    are solved in closed form and rounded to encoder counts; of all ways to hold the arm and all
    positions on the track, the line keeps the one that stays farthest from every limit. Raises
    ReachError. The last lines are remembered.
    """
    place = tuple(T_world_view.as_matrix().ravel().tolist())
    return _line(place, profiles, step_mm, params, seed, tuple(travel.tolist()))


@lru_cache(maxsize=64)
def _line(
    place: tuple[float, ...],
    profiles: int,
    step_mm: float,
    params: ArmParams,
    seed: int | None,
    along: Vector,
) -> ArmPath:
    T_world_view = RigidTransform.from_matrix(np.reshape(place, (4, 4)))
    travel = np.array(along)
    travel.setflags(write=False)
    T_world_commanded = straight_line(T_world_view, profiles, step_mm, travel).T_world_profile
    joints = solve_joints(T_world_commanded, params)
    counts = f3.to_pulses(joints)
    counts.setflags(write=False)
    rest = counts.astype(np.float64)
    if seed is not None:
        rest += np.random.default_rng(seed).uniform(-0.5, 0.5, rest.shape)
        rest[:, 0] = rest[0, 0]  # the track is clamped for the whole line
    flange = f3.flange_by_simulator(rest / f3.PULSES)
    T_world_base = params.T_world_base
    return ArmPath(
        T_world_base * flange * TOOL_CENTRE_POINT * params.T_nominal_sensor,
        step_mm,
        T_world_commanded,
        encoder_poses(counts, params),
        counts,
        travel=travel,
    )


def encoder_poses(
    counts: np.ndarray[tuple[int, int], np.dtype[np.int64]], params: ArmParams
) -> RigidTransform:
    """World poses (profiles,) that encoder counts (profiles, 7) give with the nominal bracket."""
    flange = f3.flange_by_controller(f3.from_pulses(counts))
    return params.T_world_base * flange * TOOL_CENTRE_POINT


def start_view(joints_deg: Sequence[float], track_mm: float, params: ArmParams) -> RigidTransform:
    """The pose in which six joints hold the sensor at a place on the track, in whole counts.

    Raises ReachError beyond a limit.
    """
    joints = np.array([track_mm, *np.deg2rad(joints_deg)])
    _check_limits(joints[None], np.zeros(1))
    return encoder_poses(f3.to_pulses(joints)[None], params)[0]


def next_view(
    counts: np.ndarray[tuple[int], np.dtype[np.int64]],
    waist_rad: float,
    track_mm: float,
    params: ArmParams,
) -> tuple[RigidTransform, float]:
    """The view that appendix B reaches from encoder counts (7,) by moving waist and track.

    Returns its commanded pose and where on the track in mm the arm then stands. Both moves are
    rounded to counts. Raises ReachError where the waist or the track would pass its limit; at the
    end of the track the thesis's program goes on from there with a message.
    """
    moved = np.array(counts, dtype=np.int64)
    moved[:2] += f3.to_pulses(np.array([track_mm, waist_rad, 0.0, 0.0, 0.0, 0.0, 0.0]))[:2]
    joints = f3.from_pulses(moved)
    _check_limits(joints[None], np.zeros(1))
    return encoder_poses(moved[None], params)[0], float(joints[0])


def solve_joints(T_world_sensor: RigidTransform, params: ArmParams) -> FloatArray:
    """Joint values (profiles, 7) that hold the nominal sensor at poses (profiles,) of one line.

    Chooses among the positions on the track and the eight ways to hold the arm the one with the
    largest smallest distance to a limit (joint 3 also keeps away from the stretched arm), less the
    largest turn of a joint between two profiles, passing over those where the arm would touch
    itself. Raises ReachError.
    """
    T_base_flange = params.T_world_base.inv() * T_world_sensor * TOOL_CENTRE_POINT.inv()
    joints, excess_mm = f3.joints_along(T_base_flange, params.tracks_mm)
    joints = joints.reshape(-1, *joints.shape[2:])
    excess_mm = excess_mm.reshape(len(joints), -1)
    turns = joints[..., 1:]
    low, high = f3.LIMITS[1:].T
    slack = np.minimum(turns - low, high - turns).min(axis=(1, 2))
    score = np.minimum(slack, np.abs(turns[..., 2]).min(axis=1))
    if turns.shape[1] > 1:
        score = score - np.abs(np.diff(turns, axis=1)).max(axis=(1, 2))
    # What can be held goes first, then what comes nearest to it; among equals the comfortable.
    order = np.lexsort((-score, -np.minimum(slack, 0.0), excess_mm.max(axis=1)))
    _check_limits(joints[order[0]], excess_mm[order[0]])
    holds = order[(excess_mm[order].max(axis=1) == 0.0) & (slack[order] >= 0.0)]
    contact = None
    for way in holds:
        if (contact := f3.self_contact(joints[way])) is None:
            chosen: FloatArray = joints[way]
            return chosen
    assert contact is not None  # holds has at least the way that passed the check of limits
    profile, one, other = contact
    raise ReachError(
        f"profile {profile}: {one} and {other} of the arm would touch, whichever way it is held "
        "within its limits"
    )


def _check_limits(joints: FloatArray, excess_mm: FloatArray) -> None:
    """Raise ReachError for the worst of joint values (profiles, 7)."""
    where = f"with the arm at {joints[0, 0]:.0f} mm of the track"
    farthest = int(excess_mm.argmax())
    if excess_mm[farthest] > 0.0:
        raise ReachError(
            f"profile {farthest}: joint 3 cannot stretch the arm to "
            f"{f3.REACH_MM + excess_mm[farthest]:.1f} mm from the shoulder to the wrist; its limit "
            f"is {f3.REACH_MM:g} mm, {where}"
        )
    over = np.maximum(f3.LIMITS[:, 0] - joints, joints - f3.LIMITS[:, 1])
    if not (over > 0.0).any():
        return
    over[:, 0] /= 1000.0  # only to compare the track with angles
    profile, joint = np.unravel_index(over.argmax(), over.shape)
    value = joints[profile, joint]
    limit = f3.LIMITS[joint, int(value > f3.LIMITS[joint].mean())]
    if joint == 0:
        raise ReachError(f"the track would have to go to {value:.1f} mm; its limit is {limit:g} mm")
    raise ReachError(
        f"profile {profile}: {f3.JOINTS[joint]} would have to turn to {np.rad2deg(value):.2f} "
        f"degrees; its limit is {np.rad2deg(limit):g} degrees, {where}"
    )
