"""The CRS F3 on its track: joints, encoders, and poses to joint angles and back.

Joint values are a row (track mm, joints 1 to 6 rad). At zero the arm stretches out level to the
front, the upper arm and the forearm in line, and the flange's X points up; joints 2 and 3 turn
downwards, the others by the right hand about their own axes. The limits only make sense with these
zeros, which neither the thesis nor the quoted tables state. The link lengths and limits are widely
quoted values, not the thesis's; the pulses of the joints are the thesis's (section 3.3), those of
the track an assumption: 260000 pulses (appendix B) then are 2.6 m.
"""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from registration.scan import BoolArray, FloatArray

JOINTS = ("track", "joint 1", "joint 2", "joint 3", "joint 4", "joint 5", "joint 6")
D1_MM, A1_MM, A2_MM, D4_MM, D6_MM = 350.0, 100.0, 265.0, 270.0, 75.0
LIMITS = np.array(
    [(0.0, 2600.0)]
    + [(np.deg2rad(low), np.deg2rad(high)) for low, high in
       [(-180, 180), (-135, 45), (-135, 135), (-180, 180), (-135, 135), (-180, 180)]]
)  # fmt: skip
PULSES = np.array([100.0, *np.rad2deg([569.0] * 3), *np.rad2deg([455.0] * 3)])
REACH_MM = A2_MM + D4_MM

# Denavit-Hartenberg rows of joints 1 to 6: (theta sign, theta offset, d, a, twist).
_DH = (
    (1.0, 0.0, D1_MM, A1_MM, np.pi / 2),
    (-1.0, 0.0, 0.0, A2_MM, 0.0),
    (-1.0, np.pi / 2, 0.0, 0.0, np.pi / 2),
    (1.0, 0.0, D4_MM, 0.0, -np.pi / 2),
    (1.0, 0.0, 0.0, 0.0, np.pi / 2),
    (1.0, 0.0, D6_MM, 0.0, 0.0),
)


class Solutions(NamedTuple):
    """Ways to hold the flange along a line of poses.

    joints: (..., 8, profiles, 7) shoulder to the front and to the back, elbow up and down, wrist
        one way and the other; continuous from profile to profile.
    excess_mm: (..., 8, profiles) by how much the wrist is out of reach; there the joints are those
        of the arm stretched or folded towards it.
    """

    joints: FloatArray
    excess_mm: FloatArray


def to_pulses(joints: FloatArray) -> NDArray[np.int64]:
    """Round joint values (..., 7) to encoder counts."""
    counts: NDArray[np.int64] = np.rint(joints * PULSES).astype(np.int64)
    return counts


def from_pulses(counts: NDArray[np.int64]) -> FloatArray:
    """Joint values (..., 7) of encoder counts."""
    values: FloatArray = counts / PULSES
    return values


def flange_by_controller(joints: FloatArray) -> RigidTransform:
    """Poses of the flange in the base frame, (n, 7) -> (n,), by the product of the DH matrices."""
    pose = RigidTransform.from_translation(np.outer(joints[:, 0], [0.0, 1.0, 0.0]))
    for (sign, offset_rad, d_mm, a_mm, twist_rad), value in zip(_DH, joints[:, 1:].T, strict=True):
        turn = RigidTransform.from_rotation(
            Rotation.from_euler("z", sign * value[:, None] + offset_rad)
        )
        link = RigidTransform.from_components(
            [a_mm, 0.0, d_mm], Rotation.from_euler("x", twist_rad)
        )
        pose = pose * turn * link
    return pose


def flange_by_simulator(joints: FloatArray) -> RigidTransform:
    """Poses of the flange in the base frame, (n, 7) -> (n,), from the MuJoCo model."""
    model = _model()
    data = mujoco.MjData(model)
    flange = model.body("flange").id
    positions_m, matrices = np.empty((len(joints), 3)), np.empty((len(joints), 9))
    for k, values in enumerate(to_qpos(joints)):
        data.qpos[:] = values
        mujoco.mj_kinematics(model, data)
        positions_m[k], matrices[k] = data.xpos[flange], data.xmat[flange]
    return RigidTransform.from_components(
        1000.0 * positions_m, Rotation.from_matrix(matrices.reshape(-1, 3, 3))
    )


def to_qpos(joints: FloatArray) -> FloatArray:
    """Joint values (..., 7) as MuJoCo takes them: the track in metres."""
    qpos: FloatArray = joints * np.array([0.001, 1, 1, 1, 1, 1, 1])
    return qpos


def self_contact(joints: FloatArray) -> tuple[int, str, str] | None:
    """First row of joint values (n, 7) at which the arm touches itself, and the bodies that meet.

    By the rough shapes of the model, the sensor's box among them.
    """
    model = _model()
    data = mujoco.MjData(model)
    for k, values in enumerate(to_qpos(joints)):
        data.qpos[:] = values
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon:
            bodies = model.geom_bodyid[data.contact.geom[0]]
            return k, model.body(bodies[0]).name, model.body(bodies[1]).name
    return None


def model_spec() -> mujoco.MjSpec:
    """A fresh copy of the MuJoCo model of arm and track."""
    return mujoco.MjSpec.from_string(files("sensors").joinpath("assets/f3.xml").read_text("utf-8"))


@lru_cache(maxsize=1)
def _model() -> mujoco.MjModel:
    return model_spec().compile()


def joints_along(T_base_flange: RigidTransform, track_mm: FloatArray) -> Solutions:
    """All ways to follow a line of flange poses from each of some track positions, in closed form.

    T_base_flange: (profiles,). track_mm: (t,). Returns Solutions of (t, 8, profiles, 7). The three
    last axes of the F3 meet in the wrist, so its place gives joints 1 to 3 and the rest of the
    rotation joints 4 to 6. Where the wrist is straight, joint 4 stays as it was.
    """
    matrix = T_base_flange.rotation.as_matrix()
    wrist_mm = T_base_flange.translation - D6_MM * matrix[:, :, 2]
    shape = (len(track_mm), 2, 2, 2, len(matrix))
    x, height = wrist_mm[:, 0], wrist_mm[:, 2] - D1_MM
    y = wrist_mm[:, 1] - np.asarray(track_mm)[:, None, None, None, None]
    back = np.array([0.0, 1.0])[:, None, None, None]
    bend = np.array([1.0, -1.0])[:, None, None]
    flip = np.array([0.0, 1.0])[:, None]

    waist = _unwrapped(np.arctan2(y, x) + np.pi * back, 2 * np.pi, 0.0)
    out = np.hypot(x, y) * (1.0 - 2.0 * back) - A1_MM
    distance_mm = np.hypot(out, height)
    excess_mm = np.maximum(distance_mm - REACH_MM, 0.0)
    excess_mm = np.maximum(excess_mm, abs(D4_MM - A2_MM) - distance_mm)
    cosine = (distance_mm**2 - A2_MM**2 - D4_MM**2) / (2.0 * A2_MM * D4_MM)
    cosine = np.clip(cosine, -1.0, 1.0)
    elbow = np.arctan2(bend * np.sqrt(1.0 - cosine**2), cosine)
    shoulder = np.arctan2(-height, out)
    shoulder = shoulder - np.arctan2(D4_MM * np.sin(elbow), A2_MM + D4_MM * np.cos(elbow))
    shoulder = _unwrapped(shoulder, 2 * np.pi, LIMITS[2].mean())

    # The forearm's frame: Z along it, Y to the right of the arm, X upwards when it lies level.
    c1, s1 = np.cos(waist), np.sin(waist)
    cf, sf = np.cos(shoulder + elbow), np.sin(shoulder + elbow)
    c1, s1, cf, sf = np.broadcast_arrays(c1, s1, cf, sf)
    axes = np.stack(
        [
            np.stack([c1 * sf, s1 * sf, cf], axis=-1),
            np.stack([s1, -c1, np.zeros_like(c1)], axis=-1),
            np.stack([c1 * cf, s1 * cf, -sf], axis=-1),
        ],
        axis=-2,
    )
    rest = axes @ matrix  # axes holds the forearm's axes as rows, so it is the inverse rotation
    roll = np.arctan2(rest[..., 1, 2], rest[..., 0, 2])
    roll = _filled(roll, np.hypot(rest[..., 1, 2], rest[..., 0, 2]) > 1e-9)
    roll = _unwrapped(np.unwrap(roll, period=np.pi) + np.pi * flip, 2 * np.pi, 0.0)
    c4, s4 = np.cos(roll), np.sin(roll)
    bow = np.arctan2(c4 * rest[..., 0, 2] + s4 * rest[..., 1, 2], rest[..., 2, 2])
    spin = np.arctan2(
        c4 * rest[..., 1, 0] - s4 * rest[..., 0, 0], c4 * rest[..., 1, 1] - s4 * rest[..., 0, 1]
    )
    spin = _unwrapped(spin, 2 * np.pi, 0.0)
    along = np.asarray(track_mm)[:, None, None, None, None]
    joints = np.stack(
        [np.broadcast_to(v, shape) for v in (along, waist, shoulder, elbow, roll, bow, spin)],
        axis=-1,
    )
    flat = (len(track_mm), 8, len(matrix))
    return Solutions(joints.reshape(*flat, 7), np.broadcast_to(excess_mm, shape).reshape(flat))


def _unwrapped(angle_rad: FloatArray, period_rad: float, about_rad: float) -> FloatArray:
    """Make angles continuous along the last axis, their middle within half a period of a value."""
    smooth = np.unwrap(angle_rad, period=period_rad)
    middle = 0.5 * (smooth.min(axis=-1, keepdims=True) + smooth.max(axis=-1, keepdims=True))
    shifted: FloatArray = smooth - period_rad * np.rint((middle - about_rad) / period_rad)
    return shifted


def _filled(values: FloatArray, known: BoolArray) -> FloatArray:
    """Replace what is not known along the last axis by the last known value, else the first, or 0.

    Both have shape (..., n).
    """
    index = np.where(known, np.arange(values.shape[-1]), -1)
    index = np.maximum.accumulate(index, axis=-1)
    index = np.where(index < 0, np.argmax(known, axis=-1, keepdims=True), index)
    filled = np.take_along_axis(values, index, -1)
    return np.where(np.any(known, axis=-1, keepdims=True), filled, 0.0)
