"""Scans of rectangular plates, made by intersecting beams with them analytically."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from registration import Scan

HALF_ANGLE_RAD = np.radians(13.2)
APEX_BEHIND_MM = 60.0
# Seen from above at a slant: floor and wall of a room in the frame of a sensor that looks along Z.
ROOM = Rotation.from_euler("YX", [35.0, 20.0], degrees=True)
MIDDLE = np.array([150.0, 0.0, 930.0])  # of what is seen


@dataclass(frozen=True)
class Plates:
    """centre_mm: (m, 3); axes: (m, 3, 3), rows along the sides and the normal; half_mm: (m, 2)."""

    centre_mm: np.ndarray
    axes: np.ndarray
    half_mm: np.ndarray

    def __len__(self) -> int:
        return len(self.centre_mm)


def move_plates(plates: Plates, T_new_old: RigidTransform) -> Plates:
    """Express plates in another frame."""
    turned = T_new_old.rotation.apply(plates.axes.reshape(-1, 3)).reshape(-1, 3, 3)
    return Plates(T_new_old.apply(plates.centre_mm), turned, plates.half_mm)


def scan_plates(
    plates: Plates,
    profiles: int = 60,
    pixels: int = 256,
    step_mm: float = 5.0,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    half_angle_rad: float = HALF_ANGLE_RAD,
) -> Scan:
    """Scan plates given in the frame of the first profile, with a fan of beams per profile.

    noise: scales a depth noise of 0.3 mm at 230 mm to 1.5 mm at 1235 mm from the apex, along the
        beam; 0 gives the exact points.
    """
    tangent = np.tan(half_angle_rad) * np.linspace(-1.0, 1.0, pixels)
    beam = np.stack([np.zeros(pixels), tangent, np.ones(pixels)], axis=1)
    apex = np.zeros((profiles, 3))
    apex[:, 0] = step_mm * np.arange(profiles)
    apex[:, 2] = -APEX_BEHIND_MM
    depth = np.full((profiles, pixels), np.inf)
    for centre, axes, half in zip(plates.centre_mm, plates.axes, plates.half_mm, strict=True):
        slope = beam @ axes[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = ((centre - apex) @ axes[2])[:, None] / slope[None, :]
            hit = apex[:, None] + along[..., None] * beam - centre
        inside = (along > 0.0) & (np.abs(hit @ axes[:2].T) <= half).all(axis=2)
        depth = np.where(inside & (along < depth), along, depth)
    depth[~np.isfinite(depth)] = np.nan
    if noise > 0.0:
        assert rng is not None
        sigma = noise * (0.3 + (depth - 230.0) * (1.2 / 1005.0))
        depth = depth + rng.normal(size=depth.shape) * np.where(np.isfinite(sigma), sigma, 0.0)
    points = apex[:, None] + depth[..., None] * beam
    return Scan.from_points(points, step_mm, apex_mm=apex[0])


def plates_from(normals: np.ndarray, centres_mm: np.ndarray, half_mm: np.ndarray) -> Plates:
    """Plates whose first side is as upright (along X) as their normal allows."""
    upright = np.array([1.0, 0.0, 0.0]) - normals[:, :1] * normals
    upright /= np.linalg.norm(upright, axis=1, keepdims=True)
    axes = np.stack([upright, np.cross(normals, upright), normals], axis=1)
    return Plates(centres_mm, axes, half_mm)


def box_faces(T_world_box: RigidTransform, half_mm: np.ndarray) -> Plates:
    """The six faces of a box."""
    centres, axes, halves = [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = sign * np.eye(3)[axis]
            first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            centres.append(normal * half_mm[axis])
            axes.append([first, second, normal])
            halves.append([half_mm[(axis + 1) % 3], half_mm[(axis + 2) % 3]])
    return move_plates(Plates(np.array(centres), np.array(axes), np.array(halves)), T_world_box)


def stairs(*others: tuple[list[float], str, list[float]]) -> Plates:
    """Steps along the room's Y that do not end, no two alike, and other plates.

    others: place in the room, which way one faces ("riser" as the steps' fronts, "side" across
    them), and half sizes: upright and along Y, or upright and in depth.
    """
    up, along, away = np.eye(3)
    facing = {
        "tread": (away, along, up),
        "riser": (up, along, -away),
        "side": (up, away, -along),
    }
    plates, (x, z) = list(others), (-110.0, -60.0)
    for rise, run in ((30.0, 70.0), (52.0, 34.0), (41.0, 58.0), (64.0, 45.0)):
        plates.append(([x, 0.0, z + 0.5 * run], "tread", [0.5 * run, 900.0]))
        plates.append(([x + 0.5 * rise, 0.0, z + run], "riser", [0.5 * rise, 900.0]))
        x, z = x + rise, z + run
    places, faces, halves = zip(*plates, strict=True)
    axes = np.array([ROOM.apply(facing[face]) for face in faces])
    return Plates(MIDDLE + ROOM.apply(places), axes, np.array(halves))


def join(*parts: Plates) -> Plates:
    return Plates(
        *(np.concatenate([getattr(p, f) for p in parts]) for f in ("centre_mm", "axes", "half_mm"))
    )


def random_clutter(rng: np.random.Generator, boxes: int = 7) -> Plates:
    """Boxes at random in front of a tilted wall, in the frame of a sensor that looks along Z."""
    parts = [
        plates_from(
            np.array([[0.15, -0.1, -1.0]]) / np.linalg.norm([0.15, -0.1, -1.0]),
            np.array([[150.0, 0.0, 1150.0]]),
            np.array([[400.0, 500.0]]),
        )
    ]
    for _ in range(boxes):
        centre = rng.uniform([0.0, -260.0, 800.0], [320.0, 260.0, 1050.0])
        turn = Rotation.from_rotvec(rng.normal(scale=0.5, size=3))
        parts.append(
            box_faces(RigidTransform.from_components(centre, turn), rng.uniform(40.0, 90.0, size=3))
        )
    return join(*parts)


def random_view(
    rng: np.random.Generator, turn_deg: float = 25.0, other_deg: float = 5.0
) -> RigidTransform:
    """T_second_first of a view turned about X, around a point in the middle of the scene."""
    turn = Rotation.from_euler(
        "ZYX", np.radians([*rng.uniform(-other_deg, other_deg, 2), rng.uniform(-1, 1) * turn_deg])
    )
    pivot = np.array([150.0, 0.0, 930.0])
    return RigidTransform.from_components(pivot - turn.apply(pivot) + rng.uniform(-20, 20, 3), turn)


def pose_error(T_a: RigidTransform, T_b: RigidTransform) -> tuple[float, float]:
    """Angle in degrees and distance in mm between two poses."""
    difference = T_a.inv() * T_b
    return (
        float(np.degrees(difference.rotation.magnitude())),
        float(np.linalg.norm(T_a.translation - T_b.translation)),
    )


class Pair(NamedTuple):
    target: Scan
    source: Scan
    T_target_source: RigidTransform


def clutter_pair(seed: int, noise: float) -> Pair:
    rng = np.random.default_rng(seed)
    plates = random_clutter(rng)
    T_source_target = random_view(rng)
    return Pair(
        scan_plates(plates, noise=noise, rng=rng),
        scan_plates(move_plates(plates, T_source_target), noise=noise, rng=rng),
        T_source_target.inv(),
    )


def stairs_pair(plates: Plates, seed: int) -> Pair:
    """Stairs, from two views that differ by up to 12 degrees."""
    rng = np.random.default_rng(seed)
    T_source_target = random_view(rng, turn_deg=12.0)
    target, source = (
        scan_plates(each, profiles=90, step_mm=3.0, noise=1.0, rng=rng)
        for each in (plates, move_plates(plates, T_source_target))
    )
    return Pair(target, source, T_source_target.inv())
