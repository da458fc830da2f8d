"""The parameters of the stages that describe one view: from profiles to patches.

params.py says how the defaults were chosen. Lengths are in mm, angles in rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from registration.checks import one_of, whole, within

LineSeed = Literal["first_points", "running"]
SegmentOrder = Literal["index", "longest_first"]
LineFit = Literal["regression", "total"]
MergeRule = Literal["literal", "global", "segments"]
Triplets = Literal["carried", "measured", "fitted"]
PlaneFit = Literal["uncentred", "centred"]
PatchShape = Literal["rectangle", "irregular"]


@dataclass(frozen=True)
class PreprocessParams:
    """Outliers and smoothing (section 5.2).

    isolated_gap_mm: two points of a profile farther apart are not neighbours (CLIFF).
    isolated_max_points: a run of at most so many points without neighbours is removed; the thesis
        gives no number.
    median_width: 5, odd; 1 switches the filter off.
    median_across_gaps: literal reading; else the window stops at a gap and shrinks symmetrically
        at the ends of a run, which leaves noise-free straight lines untouched.
    """

    isolated_gap_mm: float = 10.0
    isolated_max_points: int = 2
    median_width: int = 5
    median_across_gaps: bool = False

    def __post_init__(self) -> None:
        within(self, "isolated_gap_mm", 0.0, math.inf, above_low=True)
        whole(self, "isolated_max_points", 0)
        whole(self, "median_width", 1)
        if self.median_width % 2 == 0:
            raise ValueError(
                f"PreprocessParams.median_width is {self.median_width}; must be an odd number"
            )


@dataclass(frozen=True)
class SegmentParams:
    """Straight-line segmentation (section 5.3, appendix D).

    warp_mm, cliff_mm: WARP and CLIFF of section 6.1.
    seed: "first_points" judges every point by the line through the first `seed_points` (literal,
        3 points), "running" by the line refitted to all points so far, which survives noise.
    fit: the final line by "regression" of Z on Y (D-3) or "total" least squares (corrected).
    min_points: shorter segments are not kept.
    order: "index" walks a profile from end to end; "longest_first" takes its longest segment, then
        the longest of what is left on either side, as chapter 7 proposes.
    """

    warp_mm: float = 4.0
    cliff_mm: float = 10.0
    seed: LineSeed = "running"
    seed_points: int = 6
    fit: LineFit = "total"
    min_points: int = 6
    order: SegmentOrder = "index"

    def __post_init__(self) -> None:
        within(self, "warp_mm", 0.0, math.inf, above_low=True)
        within(self, "cliff_mm", 0.0, math.inf, above_low=True)
        one_of(self, "seed", LineSeed)
        whole(self, "seed_points", 2)
        one_of(self, "fit", LineFit)
        whole(self, "min_points", 2)
        one_of(self, "order", SegmentOrder)


@dataclass(frozen=True)
class MergeParams:
    """Grouping of neighbouring profiles (sections 4.3.1 and 6.1).

    rule: "literal", two profiles belong together when they have equally many segments and every
        pair agrees; "global", when the Gauss circles overlap after the best common turn;
        "segments", each segment is followed by itself, profiles are never judged as a whole.
    rotation_th_rad: RotationTh: largest angle of a pair, for "global" the largest common turn.
    overlap_th: OverlapTh: largest relative difference of length, as a fraction.
    close_normal_rad: "global" only: two normals overlap after the common turn when this close; the
        printed 0.14 of section 5.5, the only figure given for two independent normals that 1 mm
        of noise does not defeat.
    jump_mm: "global" and "segments" only: a segment that lies farther off the line of its
        predecessor is on another surface (CLIFF); "literal" compares angles and lengths alone.
    """

    rule: MergeRule = "global"
    rotation_th_rad: float = 0.025
    overlap_th: float = 0.20
    close_normal_rad: float = 0.14
    jump_mm: float = 10.0

    def __post_init__(self) -> None:
        one_of(self, "rule", MergeRule)
        within(self, "rotation_th_rad", 0.0, math.pi / 2, above_low=True)
        within(self, "overlap_th", 0.0, 1.0)
        within(self, "close_normal_rad", 0.0, math.pi / 2, above_low=True)
        within(self, "jump_mm", 0.0, math.inf, above_low=True)


@dataclass(frozen=True)
class PatchParams:
    """Planar patches (section 5.4).

    triplets: the three points of a segment: "carried" keeps the Y of the first profile's points
        and reads Z from each later profile (literal), "measured" reads Z at the segment's own
        quarter points, "fitted" takes the quarter points on its fitted line.
    repair, repair_mm: whether profiles whose points deviate from the one before by more than this
        are mended; the thesis gives no number: CLIFF.
    plane: eigenvector of the "uncentred" 4x4 (5-2, 5-3), or of the "centred" scatter (corrected).
    min_profiles: patches of fewer profiles are dropped; 2, the least that makes a plane, keeps all.
    intermediate: patches that bridge two groups where the segments are parallel, which the thesis
        says "might" be made. Between the shrinking profiles at a corner of a face they are slivers
        whose shifts pull the translation off by up to 30 mm, without noise.
    parallel_th_rad: how parallel (RotationTh).
    shape: "irregular" takes a patch for the mask of its segments, as chapter 7 proposes: the plane
        of all their points, area and centroid those of the strips they sweep. "rectangle" has three
        points a segment, however long.
    transitions: "irregular" only: what groups of profiles left in the zones between them, and
        groups that go on beyond one, join the patch whose plane they lie on (chapter 7).
    coplanar_mm: how near, for every end of a segment that joins (WARP).
    """

    triplets: Triplets = "measured"
    repair: bool = True
    repair_mm: float = 10.0
    plane: PlaneFit = "centred"
    min_profiles: int = 2
    intermediate: bool = False
    parallel_th_rad: float = 0.025
    shape: PatchShape = "rectangle"
    transitions: bool = False
    coplanar_mm: float = 4.0

    def __post_init__(self) -> None:
        one_of(self, "triplets", Triplets)
        within(self, "repair_mm", 0.0, math.inf, above_low=True)
        one_of(self, "plane", PlaneFit)
        whole(self, "min_profiles", 2)
        within(self, "parallel_th_rad", 0.0, math.pi / 2, above_low=True)
        one_of(self, "shape", PatchShape)
        within(self, "coplanar_mm", 0.0, math.inf, above_low=True)
        if self.transitions and (self.shape != "irregular" or self.intermediate):
            raise ValueError(
                'PatchParams.transitions needs shape "irregular", and no intermediate patches'
            )
