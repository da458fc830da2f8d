"""What the method saw, for figures and diagnosis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.gauss_sphere.candidates.rotation import rotations_between
from registration.gauss_sphere.candidates.translation import pose_candidates
from registration.gauss_sphere.fan.beams import Fan, profiles_in_fan
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.planes.patches import middle
from registration.gauss_sphere.planes.segments import cutting, find_segments
from registration.gauss_sphere.view import View
from registration.scan import FloatArray, IndexArray, IntArray, Scan


@dataclass(frozen=True)
class PlaneEvidence:
    """Both views with their planes, and the planes that the best pose lays on each other.

    pairs: (m, 2) target and source patch; distance2: (m,) squared Mahalanobis distance of each
    under the pose, three degrees of freedom. Empty where no pose was found. params: what the
    stages ran with, so that what they found on the way can be had again.
    """

    target: View
    source: View
    pairs: IntArray
    distance2: FloatArray
    params: GaussSphereParams


def patch_of_points(scan: Scan, view: View) -> IndexArray:
    """(profiles, pixels) patch of each point of the scan that a view describes, -1 for none."""
    patch = np.full(scan.points_mm.shape[:2], -1, np.int32)
    patch[profiles_in_fan(scan)] = view.patches.label
    return patch


def segment_ends(fan: Fan, params: GaussSphereParams) -> FloatArray:
    """(n, 2, 3) ends in mm of straight pieces of a view's profiles, as planes are grown from.

    With a calibration the planes have changed the depths since, and a few pieces with them.
    """
    found = find_segments(fan, cutting(params.segments))
    w, s, ss, q, sq, _ = found.sums.T
    # The inverse depth is linear in the slope of the beam; the fit is the one of the stage.
    spread = ss - s * s / w
    rise = np.where(spread > 0.0, (sq - s * q / w) / np.where(spread > 0.0, spread, 1.0), 0.0)
    slope = np.stack([found.slope_low, found.slope_high], axis=1)
    depth = 1.0 / (((q - rise * s) / w)[:, None] + rise[:, None] * slope)
    x = np.broadcast_to(fan.x_mm[found.profile][:, None], depth.shape)
    y = fan.apex_mm[1] + slope * depth + fan.lean[0] * x
    z = fan.apex_mm[2] + depth + fan.lean[1] * x
    return np.stack([x, y, z], axis=2)


def pose_shifts(seen: PlaneEvidence) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The poses that the translation stage proposed, before any was verified.

    Returns (c, 3, 3) rotations, (c, 3) shifts in mm, (c,) agreeing area in mm^2, best first.
    """
    params = seen.params
    patches = seen.target.patches, seen.source.patches
    rotations = rotations_between(*patches, params.rotation)
    return pose_candidates(*patches, rotations, params.translation)


def shifts_of_middle(
    seen: PlaneEvidence, rotation: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the proposed poses take the middle of the source, as shifts under one rotation.

    A degree of turn moves a shift, which is about the sensor, by millimetres; seen from the middle
    of the surface, poses that agree lie together. rotation: (3, 3).
    Returns (c, 3) shifts in mm, (c,) angle in rad from the rotation, (c,) agreeing area in mm^2.
    """
    rotations, shifts, area = pose_shifts(seen)
    turn = rotations - rotation
    # |Ra - Rb|^2 = 8 sin^2(angle / 2) for rotations.
    chord = np.sqrt((turn**2).sum(axis=(1, 2)) / 8.0)
    angle: FloatArray = 2.0 * np.arcsin(np.minimum(chord, 1.0))
    return shifts + turn @ middle(seen.source.patches), angle, area
