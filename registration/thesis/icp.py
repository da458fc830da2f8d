"""ICP on top of the answer, as section 6.6 proposes: point to plane, on the measured points."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from registration.local_planes import local_planes
from registration.result import RegistrationResult
from registration.scan import FloatArray, Scan
from registration.thesis.params import IcpParams

FEWEST_PAIRS = 50
# Source points that take part: more cost time and tell little, as their noise averages out.
MOST_POINTS = 6000
SETTLED_RAD, SETTLED_MM = 1e-6, 1e-3
# Damping of the six unknowns, relative to the largest: what no surface fixes hardly moves.
DAMPING = 1e-6


class Surface(NamedTuple):
    """Points (n, 3) mm of a scan and the unit normals (n, 3) of the planes fitted around them."""

    points_mm: FloatArray
    normal: FloatArray


def refined(
    result: RegistrationResult, target: Scan | None, source: Scan | None, params: IcpParams
) -> RegistrationResult:
    """Improve the pose of an answer; one without a pose, or without scans, stays as it is."""
    if result.T_target_source is None or target is None or source is None:
        return result
    pose = point_to_plane(surface(target), surface(source), result.T_target_source, params)
    return replace(result, T_target_source=pose)


def surface(scan: Scan) -> Surface:
    """The points of a scan with the normals of the planes fitted around them."""
    planes = local_planes(scan.points_mm)
    normal = np.stack([planes.along, planes.across, -np.ones_like(planes.along)], axis=2)
    known = np.isfinite(normal).all(axis=2) & scan.valid & (planes.spread_mm > 0.0)
    normal = normal[known] / np.linalg.norm(normal[known], axis=1, keepdims=True)
    return Surface(scan.points_mm[known], normal)


def point_to_plane(
    target: Surface, source: Surface, start: RigidTransform, params: IcpParams
) -> RigidTransform:
    """Lay the source's points on the planes around their nearest target points, in rounds.

    Chen and Medioni 1992 with damped steps. Pairs farther apart than the reach are left out, the
    reach falls to three standard deviations of the distances from the planes, by their median.
    Without FEWEST_PAIRS the pose stays where it is.
    """
    every = max(1, -(-len(source.points_mm) // MOST_POINTS))
    points, normals = source.points_mm[::every], source.normal[::every]
    if len(target.points_mm) < FEWEST_PAIRS or len(points) < FEWEST_PAIRS:
        return start
    tree = cKDTree(target.points_mm)
    pose, reach = start, params.reach_mm
    for _ in range(params.rounds):
        moved = pose.apply(points)
        answer = tree.query(moved, distance_upper_bound=reach)
        distance, nearest = np.asarray(answer[0]), np.asarray(answer[1])
        found = np.flatnonzero(np.isfinite(distance))
        n = target.normal[nearest[found]]
        facing = np.einsum("qj,qj->q", n, pose.rotation.apply(normals[found]))
        kept = facing >= np.cos(params.normals_within_rad)
        found, n = found[kept], n[kept]
        if len(found) < FEWEST_PAIRS:
            return pose
        at, height = moved[found], target.points_mm[nearest[found]] - moved[found]
        gap = np.einsum("qj,qj->q", height, n)
        centre = at.mean(axis=0)
        size = np.sqrt(((at - centre) ** 2).sum(axis=1).mean())
        # Turns in units of the extent, so that the damping means the same for all six.
        design = np.hstack([np.cross(at - centre, n) / size, n])
        normal_matrix = design.T @ design
        damped = normal_matrix + DAMPING * np.trace(normal_matrix) * np.eye(6)
        step = np.linalg.solve(damped, design.T @ gap)
        turn = Rotation.from_rotvec(step[:3] / size)
        shift = step[3:] + centre - turn.apply(centre)
        pose = RigidTransform.from_components(shift, turn) * pose
        settled = (
            np.linalg.norm(step[:3]) / size < SETTLED_RAD and np.linalg.norm(step[3:]) < SETTLED_MM
        )
        narrower = max(
            params.least_reach_mm, min(reach, 3.0 * 1.4826 * float(np.median(np.abs(gap))))
        )
        if settled and narrower >= reach:
            break
        reach = narrower
    return pose
