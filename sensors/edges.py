"""What goes wrong beside depth steps: shadows of the base line, ghosts and mixed points.

All functions see a view as depths from the apex, where the beams of a profile meet:
    reach_mm: (profiles, pixels) Z plus the apex's depth behind the front, NaN where nothing is met.
    slopes: (pixels,) ascending, Y over reach of each beam.
"""

from __future__ import annotations

import numpy as np

from registration.scan import BoolArray, FloatArray, IntArray
from scenes.rays import cast_rays
from scenes.scene import Scene

OUTER_BEAMS = 16


def shadowed(
    scene: Scene,
    T_world_profile_matrix: FloatArray,
    apexes_mm: FloatArray,
    baseline_mm: float,
    reach_mm: FloatArray,
    slopes: FloatArray,
    surface: IntArray,
) -> BoolArray:
    """Whether a point is hidden from the receiver, which sits beside the apex on the Y axis.

    T_world_profile_matrix: (profiles, 3, 3) rotations; apexes_mm: (profiles, 3) in the world.
    Decided by rays, but only for points that can be hidden. Receiver and beams lie in one plane:
    what stands between receiver and point there is met by a beam on the receiver's side, short of
    the line from receiver to point. Thinner things than the spacing of the beams escape, and
    beyond the outermost beams on the receiver's side, which are always tried, things outside of
    the field.
    """
    order = slice(None, None, -1 if baseline_mm > 0.0 else 1)  # from the receiver's side on
    nearness = np.where(surface >= 0, np.abs(baseline_mm) / reach_mm, -np.inf)[:, order]
    # Tangent at which the receiver sees each point; what is hidden has a larger one before it.
    slope = np.abs(slopes[order] - slopes[order][0])
    seen_at = nearness + slope
    # An edge between two beams may reach beyond both: there an obstacle counts as taller.
    edge = np.diff(surface[:, order], axis=1) != 0
    taller = np.maximum(nearness[:, 1:], nearness[:, :-1]) + slope[1:] + 1.5 * np.diff(slope)
    obstacle = seen_at.copy()
    obstacle[:, 1:][edge] = taller[edge]
    suspect: BoolArray = seen_at < np.maximum.accumulate(obstacle, axis=1)
    suspect[:, :OUTER_BEAMS] = True
    suspect = np.logical_and(suspect[:, order], surface >= 0)
    profile, pixel = np.nonzero(suspect)
    across = T_world_profile_matrix[:, :, 1]
    beams = np.stack([np.zeros(len(pixel)), slopes[pixel], np.ones(len(pixel))], axis=1)
    beams = np.einsum("nij,nj->ni", T_world_profile_matrix[profile], beams)
    # From the receiver: apex + reach beam - (apex + baseline across).
    rays_mm = reach_mm[profile, pixel][:, None] * beams - baseline_mm * across[profile]
    receivers_mm = apexes_mm + baseline_mm * across
    distance, met = cast_rays(scene, receivers_mm / 1000.0, rays_mm / 1000.0, profile)
    # A ray at the very edge of a face may meet the neighbour that shares the edge.
    visible = (met == surface[profile, pixel]) | (np.abs(distance - 1.0) < 1e-9)
    suspect[profile[visible], pixel[visible]] = False
    return suspect


def ghosts(
    reach_mm: FloatArray,
    slopes: FloatArray,
    surface: IntArray,
    reflective: FloatArray,
    normals: FloatArray,
    rotations: FloatArray,
    beams: int,
    least_step_mm: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, BoolArray, IntArray]:
    """Beams beside a depth step that measure the farther surface, drawn out beyond its edge.

    reflective: (profiles, pixels) chance that light thrown off the surface met by a beam outshines
        a nearer one beside it, 0 for most.
    normals: (surfaces + 1, 3) in the world; rotations: (profiles, 3, 3) of the profiles.
    beams: how many beams on the near side of the step can be outshone.
    Returns reach (profiles, pixels), which beams are ghosts, and the surface that each measures.
    """
    ghost_mm, is_ghost, source = reach_mm.copy(), np.zeros(reach_mm.shape, bool), surface.copy()
    chance = rng.random(reach_mm.shape)
    pixels = reach_mm.shape[1]
    step_mm = np.diff(reach_mm, axis=1)
    for side in (1, -1):  # the far surface on the side of larger, then of smaller Y
        profile, gap = np.nonzero(side * step_mm > least_step_mm)
        near, far = (gap, gap + 1) if side > 0 else (gap + 1, gap)
        plane = np.einsum("ni,nij->nj", normals[surface[profile, far]], rotations[profile])
        ahead = plane[:, 1] * slopes[far] + plane[:, 2]
        offset_mm = reach_mm[profile, far] * ahead
        for k in range(beams):
            pixel = near - side * k
            inside = (pixel >= 0) & (pixel < pixels)
            here = pixel.clip(0, pixels - 1)
            met = plane[:, 1] * slopes[here] + plane[:, 2]
            drawn_out_mm = offset_mm / np.where(met < -1e-3, met, np.nan)
            hit = (
                inside
                & (chance[profile, here] < reflective[profile, far])
                & (drawn_out_mm - reach_mm[profile, here] > least_step_mm)
            )
            at = profile[hit], here[hit]
            ghost_mm[at], is_ghost[at] = drawn_out_mm[hit], True
            source[at] = surface[profile, far][hit]
    return ghost_mm, is_ghost, source


def mixed(
    reach_mm: FloatArray,
    surface: IntArray,
    spot_pixels: float,
    largest_step_mm: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Reach after blending across edges: a spot cut by an edge sees both sides.

    spot_pixels: half width of the spot in spacings of the beams. Where between two beams the edge
    runs is drawn; a beam nearer to it than that takes part of the neighbour's depth, up to half.
    """
    step_mm = np.diff(reach_mm, axis=1)
    edge = rng.random(step_mm.shape)  # 0 at the beam before, 1 at the beam after
    cut: BoolArray = (np.abs(step_mm) < largest_step_mm) & (surface[:, 1:] != surface[:, :-1])
    blended = reach_mm.copy()
    before = cut & (edge < spot_pixels)
    share = 0.5 * (1.0 - edge[before] / spot_pixels)
    blended[:, :-1][before] += share * step_mm[before]
    after = cut & (1.0 - edge < spot_pixels)
    share = 0.5 * (1.0 - (1.0 - edge[after]) / spot_pixels)
    blended[:, 1:][after] -= share * step_mm[after]
    return blended
