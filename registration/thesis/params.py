"""The parameters of the thesis method, one frozen dataclass a stage.

The defaults take the corrected equations and, where the text leaves room, the most literal reading
that still registers noisy scans and registers exact scans of separate plates to a sample. This was
decided on random boxes and plates, never on a reported scene. configs/readings.yaml shows on table
6.4, with noise, what each literal reading does by itself. Of 3 repeats the defaults register 3; the
line through the first three points, profiles that must agree in every segment, and Y carried from
the first profile (which leaves any face that is not upright) register none; all others still
register 3. Intermediate patches gave way to the exact plates alone.

`ThesisParams.literal()` takes all these sentences at their word together, and registers none. Some
things it keeps: angles always come from the corrected equations, a rotation always has determinant
+1, and the checks of BeliefParams stay on.
What chapter 7 and section 6.6 propose is off by default; configs/chapter7.yaml and
chapter7_random.yaml show what each proposal is worth.
Lengths are in mm, angles in rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from registration.checks import one_of, whole, within
from registration.thesis.view_params import (
    MergeParams,
    PatchParams,
    PreprocessParams,
    SegmentParams,
)

RotationSolver = Literal["nine_by_nine", "svd"]
Density = Literal["per_axis", "3d", "hierarchical"]
ShiftEstimate = Literal["centroids", "plane_distances"]
ZeroRotation = Literal["none", "z"]


@dataclass(frozen=True)
class SphereParams:
    """Compaction of the Gauss sphere (section 5.5): CloseNormal, a chord of the unit sphere."""

    close_normal: float = 0.025

    def __post_init__(self) -> None:
        within(self, "close_normal", 0.0, 2.0)


@dataclass(frozen=True)
class RotationParams:
    """Search over triplets of normals (sections 4.3.2, 5.6 and 6.6).

    angle_tolerance_rad: two angles are equal, and a triplet is degenerate, within this.
    overlap_tolerance_rad: two normals overlap within this.
    solver: "nine_by_nine" solves (4-12) to (4-14) and projects on the rotations, "svd" is the
        least-squares rotation of the triplet weighted by area.
    refit: solve once more over all normals that overlap (not in the thesis).
    orthogonality: largest Frobenius distance between the solution and its projection.
    max_normals: only so many of the heaviest normals of a view form triplets.
    max_hypotheses: at most so many triplet pairs are tried, the heaviest first.
    zero_rotation: "z" lets the search fall back to two rotations when triplets are missing (6.6),
        the turn about Z taken as zero, as in (4-18).
    candidates: how many distinct rotations are kept for the report and to break ties.
    min_area_ratio: triplets pair normals only when the smaller area is at least this share of the
        larger; 0 pairs any. Chapter 7 asks for constraints beside the angles; this and the next.
    distance_tolerance_mm: triplets pair normals only when some patches of theirs are as far apart
        in one view as in the other, centroid to centroid, within this; null pairs any.
    """

    angle_tolerance_rad: float = 0.025
    overlap_tolerance_rad: float = 0.025
    solver: RotationSolver = "nine_by_nine"
    refit: bool = False
    orthogonality: float = 0.1
    max_normals: int = 30
    max_hypotheses: int = 20_000
    zero_rotation: ZeroRotation = "none"
    candidates: int = 5
    min_area_ratio: float = 0.0
    distance_tolerance_mm: float | None = None

    def __post_init__(self) -> None:
        within(self, "angle_tolerance_rad", 0.0, math.pi / 2, above_low=True)
        within(self, "overlap_tolerance_rad", 0.0, math.pi / 2, above_low=True)
        one_of(self, "solver", RotationSolver)
        within(self, "orthogonality", 0.0, math.inf, above_low=True)
        whole(self, "max_normals", 3)
        whole(self, "max_hypotheses", 1)
        one_of(self, "zero_rotation", ZeroRotation)
        whole(self, "candidates", 1)
        within(self, "min_area_ratio", 0.0, 1.0)
        if self.distance_tolerance_mm is not None:
            within(self, "distance_tolerance_mm", 0.0, math.inf, above_low=True)


@dataclass(frozen=True)
class TranslationParams:
    """Densest shift between centroids (sections 5.7 and 6.6).

    density: "per_axis" as the thesis ran it, "3d" as its section 6.6 proposes, "hierarchical" from
        the densest wide ball to ever smaller ones within, as chapter 7 does.
    levels: "hierarchical" only: how often the width is halved until it is the window's.
    window_mm: width of the densest interval, or diameter of the densest ball; the thesis gives no
        number.
    area_ratio_weights: average with the area ratios of (4-28) as in (4-27); else plainly (4-26).
    estimate: the mean shift of the "centroids" that agree, or the one that lays their planes on
        each other, "plane_distances", as section 6.6 proposes.
    """

    density: Density = "per_axis"
    levels: int = 3
    window_mm: float = 20.0
    area_ratio_weights: bool = True
    estimate: ShiftEstimate = "centroids"

    def __post_init__(self) -> None:
        one_of(self, "density", Density)
        whole(self, "levels", 1)
        one_of(self, "estimate", ShiftEstimate)
        within(self, "window_mm", 0.0, math.inf, above_low=True)


@dataclass(frozen=True)
class IcpParams:
    """ICP on top of an answer, as section 6.6 proposes: point to plane, on the points themselves.

    rounds: at most so many; 0 leaves the answer alone.
    reach_mm: points farther apart than this do not correspond; halved as the pose settles, down to
        least_reach_mm.
    normals_within_rad: nor do points whose surfaces lie at a larger angle.
    """

    rounds: int = 0
    reach_mm: float = 40.0
    least_reach_mm: float = 5.0
    normals_within_rad: float = 0.35

    def __post_init__(self) -> None:
        whole(self, "rounds", 0)
        within(self, "least_reach_mm", 0.0, math.inf, above_low=True)
        within(self, "reach_mm", self.least_reach_mm, math.inf)
        within(self, "normals_within_rad", 0.0, math.pi / 2, above_low=True)


@dataclass(frozen=True)
class BeliefParams:
    """When an answer is too weak to be called one; the thesis has no such check.

    min_overlap: smallest overlap of normals, as a share of the smaller sphere's total weight.
    min_shifts: fewest different patches, in each view, that agree on the shift. Scans of unrelated
        boxes reached 3 once in 180 pairs, with an overlap of 0.12; where related ones reached
        only 2, every fifth pose was wrong.
    tie_margin: another rotation that comes this close in overlap and in agreeing shifts, both
        relatively, makes the answer ambiguous.
    tie_angle_rad: rotations nearer than this are the same answer.
    """

    min_overlap: float = 0.25
    min_shifts: int = 3
    tie_margin: float = 0.02
    tie_angle_rad: float = 0.17

    def __post_init__(self) -> None:
        within(self, "min_overlap", 0.0, 1.0)
        whole(self, "min_shifts", 1)
        within(self, "tie_margin", 0.0, 1.0)
        within(self, "tie_angle_rad", 0.0, math.pi, above_low=True)


@dataclass(frozen=True)
class ThesisParams:
    """All stages together."""

    preprocess: PreprocessParams = field(default_factory=PreprocessParams)
    segments: SegmentParams = field(default_factory=SegmentParams)
    merge: MergeParams = field(default_factory=MergeParams)
    patches: PatchParams = field(default_factory=PatchParams)
    sphere: SphereParams = field(default_factory=SphereParams)
    rotation: RotationParams = field(default_factory=RotationParams)
    translation: TranslationParams = field(default_factory=TranslationParams)
    belief: BeliefParams = field(default_factory=BeliefParams)
    icp: IcpParams = field(default_factory=IcpParams)

    @classmethod
    def literal(cls) -> ThesisParams:
        """Every reading at its word; under sensor noise it finds next to no patches."""
        return cls(
            preprocess=PreprocessParams(median_across_gaps=True),
            segments=SegmentParams(
                seed="first_points", seed_points=3, fit="regression", min_points=3
            ),
            merge=MergeParams(rule="literal"),
            patches=PatchParams(
                triplets="carried",
                plane="uncentred",
                intermediate=True,
            ),
            rotation=RotationParams(candidates=1),
        )
