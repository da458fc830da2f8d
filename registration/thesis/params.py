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
Lengths are in mm, angles in rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

LineSeed = Literal["first_points", "running"]
LineFit = Literal["regression", "total"]
MergeRule = Literal["literal", "global", "segments"]
Triplets = Literal["carried", "measured", "fitted"]
PlaneFit = Literal["uncentred", "centred"]
RotationSolver = Literal["nine_by_nine", "svd"]
Density = Literal["per_axis", "3d"]
ZeroRotation = Literal["none", "z"]


def _within(owner: object, name: str, low: float, high: float, *, above_low: bool = False) -> None:
    value = getattr(owner, name)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if (
        not number
        or not math.isfinite(value)
        or value > high
        or value < low
        or (above_low and value == low)
    ):
        bound = f"above {low:g}" if above_low else f"at least {low:g}"
        ceiling = "" if math.isinf(high) else f" and at most {high:g}"
        raise ValueError(f"{type(owner).__name__}.{name} is {value!r}; must be {bound}{ceiling}")


def _whole(owner: object, name: str, low: int) -> None:
    value = getattr(owner, name)
    if not isinstance(value, int) or isinstance(value, bool) or value < low:
        raise ValueError(
            f"{type(owner).__name__}.{name} is {value!r}; must be a whole number, at least {low}"
        )


def _one_of(owner: object, name: str, choices: object) -> None:
    value = getattr(owner, name)
    if value not in get_args(choices):
        known = ", ".join(get_args(choices))
        raise ValueError(f"{type(owner).__name__}.{name} is {value!r}; must be one of {known}")


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
        _within(self, "isolated_gap_mm", 0.0, math.inf, above_low=True)
        _whole(self, "isolated_max_points", 0)
        _whole(self, "median_width", 1)
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
    """

    warp_mm: float = 4.0
    cliff_mm: float = 10.0
    seed: LineSeed = "running"
    seed_points: int = 6
    fit: LineFit = "total"
    min_points: int = 6

    def __post_init__(self) -> None:
        _within(self, "warp_mm", 0.0, math.inf, above_low=True)
        _within(self, "cliff_mm", 0.0, math.inf, above_low=True)
        _one_of(self, "seed", LineSeed)
        _whole(self, "seed_points", 2)
        _one_of(self, "fit", LineFit)
        _whole(self, "min_points", 2)


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
        _one_of(self, "rule", MergeRule)
        _within(self, "rotation_th_rad", 0.0, math.pi / 2, above_low=True)
        _within(self, "overlap_th", 0.0, 1.0)
        _within(self, "close_normal_rad", 0.0, math.pi / 2, above_low=True)
        _within(self, "jump_mm", 0.0, math.inf, above_low=True)


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
    """

    triplets: Triplets = "measured"
    repair: bool = True
    repair_mm: float = 10.0
    plane: PlaneFit = "centred"
    min_profiles: int = 2
    intermediate: bool = False
    parallel_th_rad: float = 0.025

    def __post_init__(self) -> None:
        _one_of(self, "triplets", Triplets)
        _within(self, "repair_mm", 0.0, math.inf, above_low=True)
        _one_of(self, "plane", PlaneFit)
        _whole(self, "min_profiles", 2)
        _within(self, "parallel_th_rad", 0.0, math.pi / 2, above_low=True)


@dataclass(frozen=True)
class SphereParams:
    """Compaction of the Gauss sphere (section 5.5): CloseNormal, a chord of the unit sphere."""

    close_normal: float = 0.025

    def __post_init__(self) -> None:
        _within(self, "close_normal", 0.0, 2.0)


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

    def __post_init__(self) -> None:
        _within(self, "angle_tolerance_rad", 0.0, math.pi / 2, above_low=True)
        _within(self, "overlap_tolerance_rad", 0.0, math.pi / 2, above_low=True)
        _one_of(self, "solver", RotationSolver)
        _within(self, "orthogonality", 0.0, math.inf, above_low=True)
        _whole(self, "max_normals", 3)
        _whole(self, "max_hypotheses", 1)
        _one_of(self, "zero_rotation", ZeroRotation)
        _whole(self, "candidates", 1)


@dataclass(frozen=True)
class TranslationParams:
    """Densest shift between centroids (sections 5.7 and 6.6).

    density: "per_axis" as the thesis ran it, "3d" as its section 6.6 proposes.
    window_mm: width of the densest interval, or diameter of the densest ball; the thesis gives no
        number.
    area_ratio_weights: average with the area ratios of (4-28) as in (4-27); else plainly (4-26).
    """

    density: Density = "per_axis"
    window_mm: float = 20.0
    area_ratio_weights: bool = True

    def __post_init__(self) -> None:
        _one_of(self, "density", Density)
        _within(self, "window_mm", 0.0, math.inf, above_low=True)


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
        _within(self, "min_overlap", 0.0, 1.0)
        _whole(self, "min_shifts", 1)
        _within(self, "tie_margin", 0.0, 1.0)
        _within(self, "tie_angle_rad", 0.0, math.pi, above_low=True)


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
