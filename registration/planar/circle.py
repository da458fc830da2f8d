"""The modified Gauss circle, and the pose that one pair of its normals implies (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from registration.scan import FloatArray
from registration.thesis.segments import Segments


@dataclass(frozen=True)
class GaussCircle:
    """The normals of a profile, all drawn from one point (figure 4.6).

    angle_rad: (n,) of each segment's normal, from Y towards Z. length_mm: (n,) of its segment.
    """

    angle_rad: FloatArray
    length_mm: FloatArray

    def __len__(self) -> int:
        return len(self.angle_rad)


def gauss_circle(segments: Segments) -> GaussCircle:
    """Map every segment of a profile to its normal, as long as the segment."""
    return GaussCircle(
        np.arctan2(segments.normal[:, 2], segments.normal[:, 1]), segments.length_mm.copy()
    )


def circle_overlap(
    target: GaussCircle, source: GaussCircle, dphi_rad: float, tolerance_rad: float
) -> float:
    """Total overlap in mm of two Gauss circles after the source's is turned (4-5).

    dphi_rad: as in (4-1). A pair of normals within the tolerance adds the shorter length of both.
    """
    apart = wrapped(source.angle_rad[None] - dphi_rad - target.angle_rad[:, None])
    shorter = np.minimum(target.length_mm[:, None], source.length_mm[None])
    return float(shorter[np.abs(apart) <= tolerance_rad].sum())


def pair_pose(
    normal_1: ArrayLike, normal_2: ArrayLike, centroid_1_mm: ArrayLike, centroid_2_mm: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """dphi in rad, dx and dy in mm that lay segment 2 on segment 1, by (4-1) to (4-3).

    All arrays (..., 2), in the thesis's x and y, which are the sensor's Y and Z; the shapes are
    broadcast. Corrected: (4-1) by atan2, wrapped to (-pi, pi], and the signs of (4-3), which with
    (4-1) and (4-2) belong to the matrix [[cos, sin], [-sin, cos]] of section C.1: a turn by -dphi.
    """
    n1, n2, cp1, cp2 = (
        np.asarray(a, dtype=np.float64) for a in (normal_1, normal_2, centroid_1_mm, centroid_2_mm)
    )
    angle_1, angle_2 = (np.arctan2(n[..., 1], n[..., 0]) for n in (n1, n2))
    dphi = wrapped(angle_2 - angle_1)
    cos, sin = np.cos(dphi), np.sin(dphi)
    dx = cp1[..., 0] - cp2[..., 0] * cos - cp2[..., 1] * sin
    dy = cp1[..., 1] + cp2[..., 0] * sin - cp2[..., 1] * cos
    return dphi, dx, dy


def planar_transform(pose: ArrayLike) -> RigidTransform:
    """T_target_source in mm of a motion in the plane: a turn about X by -dphi, and a shift.

    pose: (3,) or (n, 3) dphi in rad, dx and dy in mm, as in (4-1) to (4-3).
    """
    along_x = np.array([1.0, 0.0, 0.0])
    p = np.asarray(pose, dtype=np.float64)
    shift_mm = p * (1.0 - along_x)
    return RigidTransform.from_components(shift_mm, Rotation.from_rotvec(-p * along_x))


def wrapped(angle_rad: ArrayLike) -> FloatArray:
    """Angles as the same ones in (-pi, pi]."""
    angle: FloatArray = np.pi - np.mod(np.pi - np.asarray(angle_rad, dtype=np.float64), 2.0 * np.pi)
    return angle
