"""From scans of a flat target at known places to a calibration file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial

from registration.calibration import Calibration, Table
from registration.scan import FloatArray, IntArray, Scan
from registration.table_fit import FittedTable, Nuisance, fitted_table

APART_MM, MOST_DEPTHS = 30.0, 16  # distances closer than that are one; beyond 16, even steps
BINS = 10
UNIT_WITHIN, LEAST_COSINE = 1e-3, 0.02  # a target's normal: its length, and its cosine to Z
MARGIN_MM = 10.0  # beyond the nearest and the farthest target
# Tangents of incidence: dense where a flat target's own profile lies, then up to 72 degrees.
TANGENTS = np.array([*np.linspace(0.0, 0.26, 14), 0.32, 0.40, 0.55, 0.80, 1.2, 1.8, 3.0])
SIGMA_TANGENTS = np.array([0.0, 0.25, 0.6, 1.0, 1.6, 2.4, 3.5])
SLOPES = 27
PASSES = 3  # of the bias: its table goes by the measured depth, which the bias shifts


@dataclass(frozen=True)
class TargetScan:
    """A scan of a flat target, and where the target stood: normal . p = offset_mm.

    normal: (3,) unit vector in the frame of the scan. From a ruler, or from the arm's encoders.
    """

    scan: Scan
    normal: FloatArray
    offset_mm: float


@dataclass(frozen=True)
class _Samples:
    """Every measured point (n,): depth, slope of its beam, tangent of incidence, error.

    target: number of its target. misplaced: (n, 3) what a mm and two radians, by which the target
    stood elsewhere than told, add to the error.
    """

    depth_mm: FloatArray
    slope: FloatArray
    tangent: FloatArray
    error_mm: FloatArray
    target: IntArray
    misplaced: FloatArray


def fit_calibration(
    targets: Sequence[TargetScan],
    measured_by: str = "",
    placement_mm: float = 0.0,
    placement_deg: float = 0.0,
) -> Calibration:
    """Fit bias and noise to scans of a flat target.

    placement_mm, placement_deg: how well the bench knows where a target stood, as standard
        deviations of its distance where it crosses Z and of its turn about either axis in its
        plane. What each target stood off is found together with the bias: the shape of a bias
        does not look like a plane elsewhere, and tilted targets join one distance to the next.

    A target parallel to Y at several distances shows the bias, but not what it depends on: there
    the tangent of the incidence and the slope of the beam are equal. At least one tilted set is
    needed; both forms are fitted to all scans, and the one that leaves less is kept. Bias and
    noise hold over the depths and inclinations of the targets. Raises ValueError where fewer than
    two distances or no tilt make that impossible, and where a target was not seen or its place
    cannot be one.
    """
    for number, target in enumerate(targets, start=1):
        _check(number, target)
    apex_mm = beam_apex_mm([target.scan for target in targets])
    samples, depths_mm = _samples(targets, apex_mm)
    slopes = np.linspace(samples.slope.min(), samples.slope.max(), SLOPES)
    if np.abs(samples.tangent - np.abs(samples.slope)).max() < 0.05:
        raise ValueError(
            "no target is tilted: whether the bias depends on incidence or on lateral position "
            "shows only on a tilted one; add scans of it turned by some 20 degrees"
        )
    tangents = TANGENTS[: np.searchsorted(TANGENTS, samples.tangent.max()) + 1]
    spread_law = _spread_law(samples)
    scale = spread_law(samples.depth_mm)
    deviation = np.array([placement_mm, np.deg2rad(placement_deg), np.deg2rad(placement_deg)])
    free = deviation > 0.0
    nuisance = Nuisance(samples.target, samples.misplaced[:, free], deviation[free])
    fits, left = {}, {}
    for name, at, nodes in (
        ("incidence", samples.tangent, tangents),
        ("lateral", samples.slope, slopes),
    ):
        fits[name], left[name] = _bias_table(
            samples, at, scale, depths_mm, nodes, nuisance if free.any() else None
        )
    # In units of the noise: far scans are noisier, and would drown what near ones tell.
    misfit = {name: float(np.mean((r / scale) ** 2)) for name, r in left.items()}
    form: Literal["incidence", "lateral"] = (
        "incidence" if misfit["incidence"] <= misfit["lateral"] else "lateral"
    )
    rms_mm = {
        name: float(np.sqrt(np.mean(r**2)))
        for name, r in {"uncorrected": samples.error_mm, **left}.items()
    }
    sigma = _noise_table(samples, left[form], spread_law, depths_mm)
    known_to_mm = float(np.median(fits[form].deviation_mm))
    return Calibration(form, apex_mm, fits[form].table, sigma, measured_by, rms_mm, known_to_mm)


def _check(number: int, target: TargetScan) -> None:
    """Raise ValueError where nothing can be told from a target."""
    if target.scan.n_valid == 0:
        raise ValueError(f"target {number} has no measured point; leave its scan out")
    normal = np.asarray(target.normal, dtype=np.float64)
    unit = normal.shape == (3,) and abs(np.linalg.norm(normal) - 1.0) < UNIT_WITHIN
    # Edge-on to Z it would cross Z nowhere, and its incidence has no tangent.
    if not (unit and abs(normal[2]) > LEAST_COSINE and np.isfinite(target.offset_mm)):
        raise ValueError(
            f"target {number} stands at normal {normal.tolist()} and {target.offset_mm} mm; "
            "expected a unit vector that does not lie across Z, and a finite distance"
        )


def _bias_table(
    samples: _Samples,
    at: FloatArray,
    scale: FloatArray,
    depths_mm: FloatArray,
    nodes: FloatArray,
    nuisance: Nuisance | None,
) -> tuple[FittedTable, FloatArray]:
    """The bias over measured depth and `at`, and what it and the placements leave of each error.

    Fitted at the depth that a point without noise would have shown: at its own, noise that made a
    point deeper would count as bias of deeper points, and over tilted targets that adds up.
    """
    depth_mm = samples.depth_mm
    for _ in range(PASSES):
        fit = fitted_table(
            depth_mm, at, samples.error_mm, scale, depths_mm, nodes, nuisance=nuisance
        )
        left_mm = samples.error_mm - fit.nuisance - fit.table.value(depth_mm, at)
        depth_mm = samples.depth_mm - left_mm
    return fit, left_mm


def _noise_table(
    samples: _Samples,
    residual_mm: FloatArray,
    spread_law: Callable[[FloatArray], FloatArray],
    depths_mm: FloatArray,
) -> Table:
    """Standard deviation by depth and incidence; what is 5 times the usual counts as that."""
    nodes = SIGMA_TANGENTS[: np.searchsorted(SIGMA_TANGENTS, samples.tangent.max()) + 1]
    # Relative to the first idea: that varies little, and stays above 0 in between.
    ratio = np.clip(residual_mm / spread_law(samples.depth_mm), -5.0, 5.0) ** 2
    scale = np.full(len(ratio), np.sqrt(2.0))  # of the square of a normal variable
    table = fitted_table(samples.depth_mm, samples.tangent, ratio, scale, depths_mm, nodes).table
    factor = np.sqrt(np.maximum(table.value_mm, 0.01))
    return Table(depths_mm, nodes, spread_law(depths_mm)[:, None] * factor)


def beam_apex_mm(scans: Sequence[Scan]) -> FloatArray:
    """(3,) where the beams meet, from scans in which each pixel met several distances.

    Every pixel's points lie on its beam, whatever the error of the depth; the apex is the point
    with the least sum of squared distances from these lines along Y.
    """
    points_mm = np.concatenate([scan.in_profiles_mm for scan in scans])
    y_mm, z_mm = points_mm[..., 1], points_mm[..., 2]
    valid = np.isfinite(z_mm)
    count = valid.sum(axis=0)
    usable = count >= 2
    y_mm, z_mm = (np.where(valid, c, 0.0)[:, usable] for c in (y_mm, z_mm))
    valid, count = valid[:, usable], count[usable]
    mean_y, mean_z = y_mm.sum(axis=0) / count, z_mm.sum(axis=0) / count
    dy, dz = np.where(valid, y_mm - mean_y, 0.0), np.where(valid, z_mm - mean_z, 0.0)
    spread = (dz**2).sum(axis=0)
    if not usable.any() or spread.max() < 1.0:
        raise ValueError("all targets stand at one distance; a calibration needs two at least")
    slope = (dy * dz).sum(axis=0) / np.maximum(spread, 1e-12)
    # y = mean_y + slope (z - mean_z) for every pixel: two unknowns, the apex's y and z.
    weight = np.sqrt(spread)
    system = np.stack([weight, -slope * weight], axis=1)
    y_apex, z_apex = np.linalg.lstsq(system, weight * (mean_y - slope * mean_z), rcond=None)[0]
    return np.array([0.0, y_apex, z_apex])


def _samples(targets: Sequence[TargetScan], apex_mm: FloatArray) -> tuple[_Samples, FloatArray]:
    """All points from the nearest target's middle to the farthest's, and the depths of targets.

    Tables have their nodes at these depths: in between, targets without tilt show nothing.
    """
    columns, middles_mm, misplaced, numbers = [], [], [], []
    for number, target in enumerate(targets):
        valid = target.scan.valid
        points_mm = target.scan.in_profiles_mm[valid]
        reach_mm = points_mm[:, 2] - apex_mm[2]
        slope = (points_mm[:, 1] - apex_mm[1]) / reach_mm
        beams = np.stack([np.zeros_like(slope), slope, np.ones_like(slope)], axis=1)
        origins_mm = target.scan.origins_mm[np.nonzero(valid)[0]]
        apexes_mm = origins_mm + [1.0, 0.0, 0.0] * points_mm + apex_mm * [0.0, 1.0, 1.0]
        ahead = beams @ target.normal
        true_mm = (target.offset_mm - apexes_mm @ target.normal) / ahead
        cosine = np.abs(ahead) / np.sqrt(1.0 + slope**2)
        tangent = np.sqrt(np.maximum(1.0 / cosine**2 - 1.0, 0.0))
        middles_mm.append(np.median(true_mm))
        columns.append(np.stack([points_mm[:, 2], slope, tangent, reach_mm - true_mm]))
        met_mm = apexes_mm + true_mm[:, None] * beams
        misplaced.append(_misplaced(target, met_mm) / ahead[:, None])
        numbers.append(np.full(len(slope), number))
    samples = np.concatenate(columns, axis=1)
    # By the true depth: a cut by the measured one would keep errors of one sign.
    true_mm = samples[0] - samples[3] - apex_mm[2]  # from the apex, as the middles
    inside = (true_mm > min(middles_mm) - MARGIN_MM) & (true_mm < max(middles_mm) + MARGIN_MM)
    middles = np.sort(middles_mm) + apex_mm[2]
    groups = np.split(middles, np.flatnonzero(np.diff(middles) > APART_MM) + 1)
    depths_mm = np.array([group.mean() for group in groups])
    if len(depths_mm) > MOST_DEPTHS:
        depths_mm = np.linspace(depths_mm[0], depths_mm[-1], MOST_DEPTHS)
    if len(depths_mm) < 2:
        raise ValueError("all targets stand at one distance; a calibration needs two at least")
    of_target, effects = np.concatenate(numbers)[inside], np.concatenate(misplaced)[inside]
    depth_mm, slope, tangent, error_mm = samples[:, inside]
    return _Samples(depth_mm, slope, tangent, error_mm, of_target, effects), depths_mm


def _misplaced(target: TargetScan, met_mm: FloatArray) -> FloatArray:
    """(n, 3) how far the target moves along its normal at the points met (n, 3).

    By a unit of its distance, and of its turns about either axis in its plane through the point
    where it crosses Z.
    """
    normal = target.normal
    from_middle_mm = met_mm - [0.0, 0.0, target.offset_mm / normal[2]]
    across = np.cross(normal, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    lever_mm = np.cross(from_middle_mm, normal)
    turns = [lever_mm @ across, lever_mm @ np.cross(normal, across)]
    return np.stack([np.ones(len(met_mm)), *turns], axis=1)


def _spread_law(samples: _Samples) -> Callable[[FloatArray], FloatArray]:
    """A first idea of the noise by depth, from how much errors of successive points differ.

    The bias changes little from point to point. The logarithm is fitted by a parabola in the
    depth, which follows any power of the distance closely and never reaches 0.
    """
    edges = np.linspace(samples.depth_mm.min(), samples.depth_mm.max() + 1e-6, BINS + 1)
    bin_of = np.digitize(samples.depth_mm, edges) - 1
    depths_mm, spreads_mm = [], []
    for k in range(BINS):
        here = bin_of == k
        if here.sum() < 30:
            continue
        differences = np.abs(np.diff(samples.error_mm[here]))
        depths_mm.append(samples.depth_mm[here].mean())
        spreads_mm.append(max(1.4826 * float(np.median(differences)) / np.sqrt(2.0), 1e-3))
    if not depths_mm:
        raise ValueError(
            f"the targets have {len(samples.depth_mm)} points in all, too few to tell the noise; "
            "scan more profiles of each"
        )
    law = Polynomial.fit(depths_mm, np.log(spreads_mm), min(2, len(depths_mm) - 1))

    def spread_mm(depth_mm: FloatArray) -> FloatArray:
        inside = np.clip(depth_mm, depths_mm[0], depths_mm[-1])
        value: FloatArray = np.exp(law(inside))
        return value

    return spread_mm
