"""Parameters of the method, a dataclass a stage.

Lengths that are compared with measurements are in multiples of the scan's own noise wherever one
can be given; the rest are in mm and fit scanners with tenths of a millimetre to a few millimetres
of noise on objects of centimetres to metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from registration.gauss_sphere.ranges import Checked


@dataclass(frozen=True)
class SegmentParams(Checked):
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
class PatchParams(Checked):
    """Planes grown over the profiles and fitted to their points.

    join_gain: chi-square that joining a segment to a patch, or two patches, may cost.
    tolerance_sigma: rms deviation, in standard deviations, that it may cost besides.
    max_tilt: tangent of a plane's inclination along X that young patches are held to, softly.
    bridge_profiles: a patch goes on over this many profiles less one without a segment of it, and
        over gaps between profiles of as many and a half usual ones.
    min_profiles, min_points: smaller patches are dropped.
    gate_sigma: points farther from their plane lose their label.
    fit_rounds: Gauss-Newton steps of a fit on all points, one at least, after one on a sample;
        up to two more where one moves the plane far or leaves beams out: see plane_fit.py.
    edge_pixels: points at both ends of a segment that are left out: the laser spot lies across.
    bias_rounds: turns in which a plane and its bias settle, on a sample of its points.
    """

    join_gain: float = 25.0
    tolerance_sigma: float = 0.6
    max_tilt: float = 4.0
    bridge_profiles: int = 2
    min_profiles: int = 3
    min_points: int = 40
    gate_sigma: float = 3.5
    fit_rounds: int = 1
    edge_pixels: int = 1
    bias_rounds: int = 2


@dataclass(frozen=True)
class RotationParams(Checked):
    """Rotation candidates from pairs of directions.

    close_rad: patches of directions closer together are one direction (thesis: CloseNormal).
    directions: only so many, of the largest area, are paired.
    least_angle_rad: directions of a pair are at least so far from parallel.
    angle_tolerance_rad: by how much the angles of two pairs may differ.
    overlap_tolerance_rad: directions closer together after the turn overlap.
    distinct_rad: candidates closer together are one.
    capacity: candidates that are looked at; kept: that go on to the translation.
    """

    close_rad: float = 0.05
    directions: int = 14
    least_angle_rad: float = 0.26
    angle_tolerance_rad: float = 0.06
    overlap_tolerance_rad: float = 0.09
    distinct_rad: float = 0.07
    capacity: int = 8192
    kept: int = 40


@dataclass(frozen=True)
class TranslationParams(Checked):
    """Translation candidates from pairs of planes.

    patches: only so many of each view, of the largest area, are paired.
    angle_tolerance_rad: normals of a pair differ by less after the turn.
    pairs: pairs, of the largest area, that are tried together, two of them at a time; tries: how
        often at most for a rotation; starts: how many of these may lead to a shift.
    distance_tolerance_mm: by how much the distances of two planes may differ under a shift, and
        tilt_tolerance_rad: besides, over the size of the patches, for an imprecise rotation.
    reach: outlines overlap within so many standard deviations of their points.
    distinct_mm: shifts closer together are one; kept_per_rotation: that go on to verification, or
        more where the rotations are so few that kept shifts are not reached.
    """

    patches: int = 24
    angle_tolerance_rad: float = 0.10
    pairs: int = 64
    tries: int = 2000
    starts: int = 200
    distance_tolerance_mm: float = 8.0
    tilt_tolerance_rad: float = 0.03
    reach: float = 1.8
    distinct_mm: float = 15.0
    kept_per_rotation: int = 4
    kept: int = 80


@dataclass(frozen=True)
class WideParams(TranslationParams):
    """The same for a wider search, at the best rotation and where no pose is sure.

    At the best rotation kept shifts go on; the first VerificationParams.ranked of them are looked
    at, and all where no pose is sure.
    """

    patches: int = 64
    pairs: int = 1000
    tries: int = 8000
    starts: int = 4000
    kept_per_rotation: int = 5
    kept: int = 200


@dataclass(frozen=True)
class RefineParams(Checked):
    """Maximum likelihood over pairs of planes.

    rounds: most steps; tail: squared distance at which a pair's pull is halved.
    floors_mm: systematic errors of a plane's offset to try, smallest first, with floor_lever_mm:
        distance over which they are its tilt; with a calibration none below how well it knows the
        bias. The smallest is taken under which consistent_share of the matched area, and four pairs
        or all, have a squared distance below consistent_distance2.
    capped_distance2: squared distances count up to this when the covariance is made to agree with
        them; widest_mm: largest systematic error that it is given.
    held_mm, held_rad: standard deviations by which the middle of the matched surface may move, and
        the pose turn, at a time.
    """

    rounds: int = 10
    tail: float = 25.0
    floors_mm: tuple[float, ...] = (0.005, 0.05, 0.15, 0.5, 1.5, 4.0)
    floor_lever_mm: float = 150.0
    consistent_distance2: float = 14.0
    consistent_share: float = 0.6
    capped_distance2: float = 25.0
    widest_mm: float = 30.0
    held_mm: float = 10.0
    held_rad: float = 0.1


@dataclass(frozen=True)
class VerificationParams(Checked):
    """Comparison of a pose with the space that both views saw.

    samples: points of each view that are compared.
    normal_tolerance_rad: a point supports a plane whose normal differs by less from its own's.
    free_space_mm: a point so far before all that is measured around it contradicts.
    contradiction_weight: support that a contradiction outweighs.
    rough_tolerance_mm, rough_stride: distance within which a point supports a candidate at first,
        and of how many samples one is looked at. few_stride: of how many one is looked at first
        where most poses come to nothing, as turned ones.
    ranked: candidates that are looked at, of most agreement; kept: that are settled at most,
        and so many again of the other shifts at the rotation of the best.
    worth_settling: share of the best score they need; worth_refining: and then, for the last steps.
    """

    samples: int = 1500
    normal_tolerance_rad: float = 0.26
    free_space_mm: float = 10.0
    contradiction_weight: float = 2.0
    rough_tolerance_mm: float = 20.0
    rough_stride: int = 12
    few_stride: int = 36
    ranked: int = 40
    kept: int = 10
    worth_settling: float = 0.4
    worth_refining: float = 0.4


@dataclass(frozen=True)
class MatchParams(Checked):
    """Planes matched under a pose, stage by stage.

    tolerances_mm: distance within which a point lies on the other view's plane; floors_mm:
        systematic error allowed to the planes; strides: of how many samples one is looked at.
    least_samples: points of one plane that must lie on the other.
    """

    tolerances_mm: tuple[float, ...] = (20.0, 10.0, 5.0, 5.0)
    floors_mm: tuple[float, ...] = (4.0, 1.5, 0.5, 0.15)
    strides: tuple[int, ...] = (4, 4, 1, 1)
    least_samples: int = 3


@dataclass(frozen=True)
class BendingParams(Checked):
    """What is left of a bias in the scans, from how far it bends their planes.

    samples: points of each view that are looked at; least_points: of them, that a plane needs.
    close_rad, close_mm: patches closer than this may be pieces of one bent plane.
    least_mm: root mean square by which a bias of the full size must bend a plane to be seen there.
    flat_to_mm: how flat things are, at best; with a calibration, how well it knows the bias.
    sure: standard deviations from which on a bias is believed.
    """

    samples: int = 2000
    least_points: int = 40
    close_rad: float = 0.1
    close_mm: float = 8.0
    least_mm: float = 0.1
    flat_to_mm: float = 0.05
    sure: float = 4.0


@dataclass(frozen=True)
class WholePlaneParams(Checked):
    """Pieces of one plane put together, when the answer has been found.

    distance2: squared distance (three degrees of freedom) within which pieces are of one plane.
    loosest_mm: how well it must be known where a piece should lie (standard deviation).
    rounds: planes of one view that join in with those of the other, one after the other.
    most_floor_mm: a larger systematic error bends planes: their pieces are left apart.
    floor_share: of the systematic error, what pieces of a plane do not have in common.
    moved_distance2: squared distance (six degrees of freedom) by which the pose may move.
    """

    distance2: float = 9.0
    loosest_mm: float = 1.0
    rounds: int = 6
    most_floor_mm: float = 0.12
    floor_share: float = 0.5
    moved_distance2: float = 22.5


@dataclass(frozen=True)
class OutlineParams(Checked):
    """Outlines of faces, asked where planes give no answer that is "ok", or one that seems denied.

    behind_mm: a face ends where what comes next lies so much farther away, at most missing_pixels
        on. near_mm: points of an outline so close make its line, which errs by line_mm.
    most_points: of a view's outlines that are looked at.
    every: of so many profiles and pixels one is looked at for ends of faces where an answer is
        "ok": if the views deny more than refuted_share of those that they know of, outlines are
        asked, and it is taken back where that is true of them, and of refuting_share of them all.
        Of right answers the views denied up to 9 % (16 % where profiles lie 30 mm apart), of wrong
        ones, a ring of like things turned, 22 % and more.
        Poses that symmetry allows are told apart by the same ends, before all are asked.
    off_mm: how far to both sides of an outline the other view is asked, or half a cell of both
        views together, if that is more; on_mm: how far from its plane.
    least, confirmed_share: points, and share of all, that must be confirmed. denied_share: of those
        that the other view says something of, what it may deny of the best pose; dropped_share:
        poses of which it denies a share larger by this than the least are dropped.
    slide_mm: how far along an open direction a pose is moved, in steps of cell_mm, over which ends
        say the same; peak_share: of what most ends say for a shift, what makes another one a rival,
        and worth_starting how many ends must. carried_mm: how far planes may carry it off again.
        gate_mm: of matches.
    """

    behind_mm: float = 12.0
    missing_pixels: int = 12
    near_mm: float = 25.0
    off_mm: float = 8.0
    on_mm: float = 5.0
    most_points: int = 600
    every: int = 12
    refuted_share: float = 0.2
    refuting_share: float = 0.09
    least: int = 20
    confirmed_share: float = 0.12
    denied_share: float = 0.1
    dropped_share: float = 0.3
    slide_mm: float = 400.0
    cell_mm: float = 8.0
    peak_share: float = 0.3
    worth_starting: int = 5
    carried_mm: float = 60.0
    gate_mm: float = 8.0
    line_mm: float = 3.0


@dataclass(frozen=True)
class DecisionParams(Checked):
    """When an answer is given.

    least_support: share of the seen surface that must lie on the other view's; weak_support: where
        it is less, other poses are looked for once more.
    most_contradiction: contradiction allowed, as a share of the support.
    sure_planes: different planes that must agree, each within agreeing_distance2. One less will do
        where contradiction is below plain_contradiction, and any number on large_support of the
        surface. Unrelated scenes reached three or four planes, and 19 % of the surface.
    appeal_support: the same as large_support where outlines had to say where planes lie: like
        parts of one scene reached three planes on 36 %. appeal_planes: that must agree there: two
        are any edge of a box.
    turned_planes: where at most so many agree, the pose is tried turned about the directions of
        them, and moved along them, and other settled poses are asked: three tiers and the floor
        have seven to nine, a hub with bolts twenty. Rivals among these need repeat_share of the
        score and no more than plain_contradiction, and, moved along more than sure_planes,
        repeat_planes of them.
        turned_denied: by how much a larger share of ends of faces than of the best pose the views
        may deny. silent_planes, silent_share: where at most so many planes agree, one with such a
        share of the score is named of which ends of faces say nothing.
    same_plane_rad, same_plane_mm: planes closer than this are pieces of one.
    rival_share: share of the best score at which another pose makes the answer ambiguous.
    repeat_share: the same for a pose on which as many planes agree, or repeat_planes of them as a
        share, and against which repeat_contradiction speaks at most, as a share of its support;
        sliding_planes and sliding_contradiction for one that leaves a direction open.
    open_rad, open_mm: a direction known no better than this is open.
    distinct_rad, distinct_mm: poses closer than this are one.
    """

    least_support: float = 0.08
    weak_support: float = 0.15
    most_contradiction: float = 0.15
    sure_planes: int = 5
    plain_contradiction: float = 0.02
    large_support: float = 0.3
    appeal_support: float = 0.45
    appeal_planes: int = 3
    turned_planes: int = 30
    turned_denied: float = 0.1
    silent_planes: int = 6
    silent_share: float = 0.6
    agreeing_distance2: float = 14.0
    same_plane_rad: float = 0.03
    same_plane_mm: float = 5.0
    rival_share: float = 0.75
    repeat_share: float = 0.3
    repeat_planes: float = 0.5
    sliding_planes: float = 0.6
    repeat_contradiction: float = 0.25
    sliding_contradiction: float = 0.1
    open_rad: float = 0.035
    open_mm: float = 10.0
    distinct_rad: float = 0.05
    distinct_mm: float = 15.0


@dataclass(frozen=True)
class GaussSphereParams:
    """All stages of the method.

    calibration: path of the file that the precision experiment wrote for the sensor: its bias is
        taken out of the scans and its noise weights their points. Empty for none: then the bias
        stays in, and the answers are the less accurate for it.
    wide: how shifts are looked for at the best rotation once more, and at all rotations where the
        answer would be none or on less than decision.weak_support of the seen surface.
    """

    calibration: str = ""
    segments: SegmentParams = field(default_factory=SegmentParams)
    patches: PatchParams = field(default_factory=PatchParams)
    rotation: RotationParams = field(default_factory=RotationParams)
    translation: TranslationParams = field(default_factory=TranslationParams)
    wide: WideParams = field(default_factory=WideParams)
    refine: RefineParams = field(default_factory=RefineParams)
    verification: VerificationParams = field(default_factory=VerificationParams)
    match: MatchParams = field(default_factory=MatchParams)
    decision: DecisionParams = field(default_factory=DecisionParams)
    bending: BendingParams = field(default_factory=BendingParams)
    outlines: OutlineParams = field(default_factory=OutlineParams)
    whole_planes: WholePlaneParams = field(default_factory=WholePlaneParams)

    @property
    def strides(self) -> tuple[int, ...]:
        """All shares of the samples that comparisons look at: they are spread over the scan."""
        looks = self.verification
        return looks.few_stride, looks.rough_stride, *self.match.strides
