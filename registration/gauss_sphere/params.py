"""Parameters of the method, a dataclass a stage."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class SegmentParams:
    """Straight pieces of a profile.

    cliff_mm: depth step between neighbouring points that always ends a piece (thesis: CLIFF).
    max_gap_pixels: missing points that a piece may bridge.
    min_points: shorter pieces are dropped.
    split_gain: chi-square a split must win to be believed.
    tolerance_sigma: rms deviation from a line, in standard deviations of the noise, that is not
        worth a split.
    """

    cliff_mm: float = 10.0
    max_gap_pixels: int = 4
    min_points: int = 6
    split_gain: float = 22.0
    tolerance_sigma: float = 0.25


@dataclass(frozen=True)
class PatchParams:
    """Planes grown over profiles."""

    join_gain: float = 25.0
    tolerance_sigma: float = 0.6
    max_tilt: float = 4.0
    bridge_profiles: int = 2
    min_profiles: int = 3
    min_points: int = 40
    gate_sigma: float = 3.5
    fit_rounds: int = 2
    bias_rounds: int = 2
    edge_pixels: int = 1


@dataclass(frozen=True)
class RotationParams:
    """Rotation candidates from pairs of directions."""

    close_rad: float = 0.05
    directions: int = 14
    least_angle_rad: float = 0.26
    angle_tolerance_rad: float = 0.06
    overlap_tolerance_rad: float = 0.09
    distinct_rad: float = 0.07
    capacity: int = 8192
    kept: int = 40


@dataclass(frozen=True)
class TranslationParams:
    """Translation candidates from pairs of planes."""

    patches: int = 24
    angle_tolerance_rad: float = 0.10
    pairs: int = 64
    starts: int = 200
    distance_tolerance_mm: float = 8.0
    tilt_tolerance_rad: float = 0.03
    reach: float = 1.8
    distinct_mm: float = 15.0
    kept_per_rotation: int = 4


@dataclass(frozen=True)
class RefineParams:
    """Maximum likelihood over pairs of planes."""

    rounds: int = 10
    tail: float = 25.0
    floors_mm: tuple[float, ...] = (0.005, 0.05, 0.15, 0.5, 1.5, 4.0)
    floor_lever_mm: float = 150.0
    consistent_distance2: float = 14.0
    consistent_share: float = 0.6


@dataclass(frozen=True)
class VerificationParams:
    """Comparison of a pose with the space that both views saw."""

    samples: int = 1500
    normal_tolerance_rad: float = 0.26
    free_space_mm: float = 10.0
    contradiction_weight: float = 2.0
    rough_tolerance_mm: float = 20.0
    rough_stride: int = 8
    kept: int = 10
    worth_settling: float = 0.4


@dataclass(frozen=True)
class MatchParams:
    """Planes matched under a pose."""

    tolerances_mm: tuple[float, ...] = (20.0, 10.0, 5.0, 5.0)
    floors_mm: tuple[float, ...] = (4.0, 1.5, 0.5, 0.15)
    strides: tuple[int, ...] = (4, 4, 1, 1)
    least_samples: int = 3


@dataclass(frozen=True)
class DecisionParams:
    """When an answer is given."""

    least_support: float = 0.08
    most_contradiction: float = 0.15
    rival_share: float = 0.75
    sure_planes: int = 5
    plain_contradiction: float = 0.02
    plain_support: float = 0.3
    agreeing_distance2: float = 14.0
    same_plane_rad: float = 0.03
    same_plane_mm: float = 5.0
    open_rad: float = 0.035
    open_mm: float = 10.0
    distinct_rad: float = 0.05
    distinct_mm: float = 15.0


@dataclass(frozen=True)
class GaussSphereParams:
    """All stages of the method.

    calibration: path of the file that the precision experiment wrote for the sensor, or empty: then
        its bias stays in the scans, and the answers are the less accurate for it.
    """

    calibration: str = ""
    segments: SegmentParams = field(default_factory=SegmentParams)
    patches: PatchParams = field(default_factory=PatchParams)
    rotation: RotationParams = field(default_factory=RotationParams)
    translation: TranslationParams = field(default_factory=TranslationParams)
    refine: RefineParams = field(default_factory=RefineParams)
    verification: VerificationParams = field(default_factory=VerificationParams)
    match: MatchParams = field(default_factory=MatchParams)
    decision: DecisionParams = field(default_factory=DecisionParams)
