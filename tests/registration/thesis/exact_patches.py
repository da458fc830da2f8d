"""Patches as they truly are, and in other frames; poses by which they are moved and compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plane_scans import Plates, plates_from, pose_error
from scipy.spatial.transform import RigidTransform, Rotation

from registration.thesis.patches import Patches


def true_patches(plates: Plates) -> Patches:
    """The patches of plates, exactly."""
    corners = (
        plates.centre_mm[:, None]
        + (np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * plates.half_mm[:, None])
        @ plates.axes[:, :2]
    )
    m = len(plates)
    return Patches(
        normal=plates.axes[:, 2],
        offset_mm=np.einsum("mj,mj->m", plates.axes[:, 2], plates.centre_mm),
        centroid_mm=plates.centre_mm,
        area_mm2=4.0 * plates.half_mm.prod(axis=1),
        corners_mm=corners,
        count=np.full(m, 20),
        profile_first=np.zeros(m, dtype=np.int64),
        profile_last=np.full(m, 19),
        intermediate=np.zeros(m, dtype=bool),
        points_mm=corners.reshape(-1, 3),
        point_patch=np.repeat(np.arange(m), 4),
    )


def move_patches(patches: Patches, T_new_old: RigidTransform) -> Patches:
    """Express patches in another frame; normals keep their side."""
    normal = T_new_old.rotation.apply(patches.normal)
    centroid = T_new_old.apply(patches.centroid_mm)
    shift = np.einsum("mj,j->m", normal, T_new_old.translation)
    corners = T_new_old.apply(patches.corners_mm.reshape(-1, 3)).reshape(-1, 4, 3)
    return replace(
        patches,
        normal=normal,
        offset_mm=patches.offset_mm + shift,
        centroid_mm=centroid,
        corners_mm=corners,
        points_mm=T_new_old.apply(patches.points_mm),
    )


def random_plates(rng: np.random.Generator, m: int = 12) -> Plates:
    """Plates that face the sensor, some of them parallel."""
    normals = np.column_stack([rng.normal(scale=0.5, size=(m, 2)), -np.ones(m)])
    normals[m - 3 :] = normals[:3]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return plates_from(
        normals,
        rng.uniform([0, -250, 700], [300, 250, 1100], size=(m, 3)),
        rng.uniform(20, 90, size=(m, 2)),
    )


def random_pose(rng: np.random.Generator, turn_rad: float = np.pi) -> RigidTransform:
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * rng.uniform(0.0, turn_rad))
    return RigidTransform.from_components(rng.uniform(-500, 500, 3), turn)


def assert_same_pose(T_a: RigidTransform, T_b: RigidTransform, tolerance: float = 1e-9) -> None:
    """Within the tolerance in rad, and in mm per metre."""
    angle_deg, distance_mm = pose_error(T_a, T_b)
    assert np.radians(angle_deg) < tolerance
    assert distance_mm < 1e3 * tolerance
