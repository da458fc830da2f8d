"""The parameters of the registration in the laser plane. Lengths are in mm, angles in rad.

The tolerances are the thesis's; what it has not, `winners`, `min_overlap` and the ties, was decided
on profiles of random clutter, never on a reported scene: of 120 noisy pairs that the defaults
believed 8 were wrong, without `min_overlap` 15 of 132.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from registration.checks import one_of, whole, within
from registration.thesis.view_params import PreprocessParams, SegmentParams

Refinement = Literal["none", "centroids", "lines"]
Winners = Literal["any", "determined"]


@dataclass(frozen=True)
class PlanarParams:
    """Segments of each profile, the search over pairs of them, and when to believe the best.

    preprocess, segments: sections 5.2 and 5.3, as for whole scans.
    angle_tolerance_rad: two segments overlap when this parallel: CloseNormal of section 6.1.
    offset_tolerance_mm: and when their lines are this close; the thesis says "within some tolerance
        level": WARP, the farthest that a point may lie from its own line.
    refinement: "none" keeps the pose of the best pair, "centroids" averages the shifts of all
        pairs that overlap (literal), weighted by their overlap; "lines" finds turn and shift
        together by least squares of the distances between the overlapping lines, which does not
        mind that two views see different parts of a face (not in the thesis).
    winners: "any" takes the largest overlap even where all of it lies on parallel lines, so that
        two faces of a like length may win over the rest of the profile (literal); "determined"
        only lets a pose win that lays lines of two directions on each other.
    parallel_rad: lines that meet at smaller angles count as parallel.
    min_overlap: smallest overlap, as a share of the smaller profile's total length, to believe in.
    tie_margin, tie_angle_rad, tie_mm: another pose, farther than this in angle or in shift, whose
        overlap comes relatively this close makes the answer ambiguous; the thesis has no such
        check.
    candidates: how many other answers are kept for the report.
    """

    preprocess: PreprocessParams = field(default_factory=PreprocessParams)
    segments: SegmentParams = field(default_factory=SegmentParams)
    angle_tolerance_rad: float = 0.025
    offset_tolerance_mm: float = 4.0
    refinement: Refinement = "lines"
    winners: Winners = "determined"
    parallel_rad: float = 0.17
    min_overlap: float = 0.25
    tie_margin: float = 0.02
    tie_angle_rad: float = 0.17
    tie_mm: float = 50.0
    candidates: int = 5

    def __post_init__(self) -> None:
        within(self, "angle_tolerance_rad", 0.0, math.pi / 4)
        within(self, "offset_tolerance_mm", 0.0, math.inf)
        one_of(self, "refinement", Refinement)
        one_of(self, "winners", Winners)
        within(self, "parallel_rad", 0.0, math.pi / 2)
        within(self, "min_overlap", 0.0, 1.0)
        within(self, "tie_margin", 0.0, 1.0)
        within(self, "tie_angle_rad", 0.0, math.pi)
        within(self, "tie_mm", 0.0, math.inf)
        whole(self, "candidates", 0)

    @classmethod
    def thesis(cls) -> PlanarParams:
        """Section 4.2: centroids are averaged, and the largest overlap is always believed."""
        return cls(refinement="centroids", min_overlap=0.0, tie_margin=0.0)

    @classmethod
    def literal(cls) -> PlanarParams:
        """The same, and a pose may win on parallel lines alone, which the text does not forbid."""
        return cls(refinement="centroids", winners="any", min_overlap=0.0, tie_margin=0.0)
