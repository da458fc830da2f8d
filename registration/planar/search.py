"""The exhaustive search over pairs of normals (section 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.planar.circle import pair_pose, wrapped
from registration.planar.overlap import total_overlaps
from registration.planar.params import PlanarParams
from registration.scan import BoolArray, FloatArray
from registration.thesis.segments import Segments


@dataclass(frozen=True)
class Ranking:
    """Every pose that a pair of segments implies, the one that wins first.

    pose: (h, 3) dphi in rad, dx and dy in mm, as in (4-1) to (4-3).
    overlap_mm: (h,) total overlap of all segments under it.
    parallel: (h,) whether all lines that overlap under it are parallel; such poses come last
        unless params.winners is "any".
    """

    pose: FloatArray
    overlap_mm: FloatArray
    parallel: BoolArray

    def rivals(self, params: PlanarParams) -> list[int]:
        """Indices of poses that are other answers than the first and than each other, in order."""
        kept = [0]
        for k in range(1, len(self.pose)):
            if self.overlap_mm[k] <= 0.0 or len(kept) > params.candidates:
                break
            turn = np.abs(wrapped(self.pose[kept, 0] - self.pose[k, 0]))
            shift = np.hypot(*(self.pose[kept, 1:] - self.pose[k, 1:]).T)
            if np.all((turn > params.tie_angle_rad) | (shift > params.tie_mm)):
                kept.append(k)
        return kept[1:]


def rank_poses(
    target: Segments,
    source: Segments,
    target_lines: FloatArray,
    source_lines: FloatArray,
    params: PlanarParams,
) -> Ranking:
    """Try every pair of normals and rank its pose by the overlap of all segments.

    target_lines, source_lines: line tables of the segments.
    """
    poses = pair_poses(target, source)
    totals, spreads = total_overlaps(
        target_lines, source_lines, poses, params.angle_tolerance_rad, params.offset_tolerance_mm
    )
    parallel = spreads <= np.sin(params.parallel_rad)
    # Of equals, the pair that was tried first.
    last = parallel if params.winners == "determined" else np.zeros_like(parallel)
    order = np.lexsort((-totals, last))
    return Ranking(poses[order], totals[order], parallel[order])


def pair_poses(target: Segments, source: Segments) -> FloatArray:
    """(n m, 3) dphi, dx, dy of every pair of segments, those of the target's first one first.

    By (4-1) to (4-3), corrected.
    """
    pose = pair_pose(
        target.normal[:, None, 1:],
        source.normal[None, :, 1:],
        target.centroid_mm[:, None, 1:],
        source.centroid_mm[None, :, 1:],
    )
    return np.stack(pose, axis=-1).reshape(-1, 3)
