"""Exact profiles: plates seen edge-on, as segments and as scans of one profile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from registration import Scan
from registration.thesis.segments import Segments

FloatArray = NDArray[np.float64]


def motion(psi_rad: float, y_mm: float, z_mm: float) -> RigidTransform:
    """A motion in the laser plane."""
    return RigidTransform.from_components(
        [0.0, y_mm, z_mm], Rotation.from_rotvec([psi_rad, 0.0, 0.0])
    )


def random_lines(rng: np.random.Generator, n: int = 6) -> FloatArray:
    """(n, 2, 3) ends of lines some 800 mm away, of different lengths and directions."""
    angle = rng.uniform(-1.2, 1.2, n)
    half = 0.5 * rng.uniform(25.0, 110.0, n)
    middle = np.stack(
        [np.zeros(n), rng.uniform(-250.0, 250.0, n), rng.uniform(700.0, 950.0, n)], axis=1
    )
    along = np.stack([np.zeros(n), np.cos(angle), np.sin(angle)], axis=1)
    return middle[:, None] + np.array([-1.0, 1.0])[:, None] * (half[:, None] * along)[:, None]


def as_segments(ends_mm: FloatArray) -> Segments:
    """Lines as the exact segments of profile 0, their normals to the side where Z is smaller."""
    n = len(ends_mm)
    span = ends_mm[:, 1] - ends_mm[:, 0]
    length = np.linalg.norm(span, axis=1)
    direction = span / length[:, None]
    normal = np.stack([np.zeros(n), direction[:, 2], -direction[:, 1]], axis=1)
    first = 40 * np.arange(n)
    return Segments(
        np.zeros(n, dtype=np.int64), first, first + 39, ends_mm.mean(axis=1), direction, normal,
        length, ends_mm, np.full(n, 40),
    )  # fmt: skip


def moved(ends_mm: FloatArray, pose: RigidTransform) -> FloatArray:
    """The same lines in another frame."""
    return pose.apply(ends_mm.reshape(-1, 3)).reshape(-1, 2, 3)


def scan_outline(corners_mm: FloatArray, pixels: int = 512, noise_mm: float = 0.0,
                 rng: np.random.Generator | None = None) -> Scan:  # fmt: skip
    """One profile of an open outline (k, 2) of Y and Z, seen from the origin."""
    slopes = np.linspace(-0.45, 0.45, pixels)
    a, b = corners_mm[:-1], corners_mm[1:]
    span = b - a
    # The beam s (slope, 1) meets a + p (b - a): cross both with the beam's direction.
    across = span[:, 0] - slopes[:, None] * span[:, 1]
    p = (slopes[:, None] * a[:, 1] - a[:, 0]) / across
    depth = np.where((p >= 0.0) & (p <= 1.0), a[:, 1] + p * span[:, 1], np.inf).min(axis=1)
    depth[~np.isfinite(depth)] = np.nan
    if rng is not None:
        depth = depth + rng.normal(0.0, noise_mm, pixels)
    points = np.stack([np.zeros(pixels), slopes * depth, depth], axis=1)
    return Scan.from_points(points[None], step_mm=5.0)
