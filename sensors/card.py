"""The card of a Jupiter: every published number, measured on the simulated sensor's own scans."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from registration.scan import FloatArray, Scan
from sensors.calibration import OFFSET_Z_MM, PUBLISHED, Published
from sensors.jupiter import Jupiter, JupiterParams
from sensors.target_scans import scan_target

PROFILES, STEP_MM = 40, 5.0
TILT_RAD = np.radians(2.0)  # carries the target through several steps of the depth
CENTRE, EDGE = 16, 4  # beams that count as the centre of a profile, and as either edge


@dataclass(frozen=True)
class CardRow:
    """A published number and what the simulated sensor shows in its place."""

    number: Published
    measured_mm: float

    @property
    def raw_depth_mm(self) -> float:
        """Z' of section 3.2.2, by which the figures of the thesis are labelled."""
        return OFFSET_Z_MM - self.number.depth_mm


def measure_card(params: JupiterParams, seed: int = 0) -> tuple[CardRow, ...]:
    """Measure every published number on scans of a flat target.

    The range limits are switched off: the farthest target of the precision analysis, and the
    planes that bound the field, would be cut by them. A number of an effect that is switched off
    comes out as 0.
    """
    sensor = Jupiter(replace(params, range_limits=False))
    depths_mm = sorted({number.depth_mm for number in PUBLISHED})
    facing, tilted = {}, {}
    for k, depth_mm in enumerate(depths_mm):
        # Two streams for each: the numbers do not hang on each other.
        rngs = [np.random.default_rng([seed, k, i]) for i in (0, 1)]
        facing[depth_mm] = scan_target(sensor, depth_mm, 0.0, 0.0, PROFILES, STEP_MM, rngs[0]).scan
        tilted[depth_mm] = scan_target(
            sensor, depth_mm, 0.0, TILT_RAD, PROFILES, STEP_MM, rngs[1]
        ).scan
    scale = (params.pixels - 1) / 255.0  # the published spacings are those of 256 points
    rows = []
    for number in PUBLISHED:
        scan = facing[number.depth_mm]
        middle = slice((params.pixels - CENTRE) // 2, (params.pixels + CENTRE) // 2)
        if number.quantity == "depth step":
            value_mm = float(np.median(depth_steps_mm(tilted[number.depth_mm])[middle]))
        elif number.quantity == "bulge":
            value_mm = bulge_of(scan)
        elif number.quantity == "width":
            value_mm = float(np.abs(spacings_mm(scan).sum()))
        elif number.quantity == "mean spacing":
            value_mm = scale * float(spacings_mm(scan).mean())
        elif number.quantity == "centre spacing":
            value_mm = scale * float(spacings_mm(scan)[middle].mean())
        else:
            value_mm = scale * float(spacings_mm(scan)[[*range(EDGE), *range(-EDGE, 0)]].mean())
        rows.append(CardRow(number, value_mm))
    return tuple(rows)


def spacings_mm(scan: Scan) -> FloatArray:
    """(pixels - 1,) distance along Y between neighbouring points, mean over the profiles.

    NaN where a pixel was never measured.
    """
    spacing: FloatArray = np.diff(mean_over_profiles(scan.points_mm[..., 1]))
    return spacing


def mean_depths_mm(scan: Scan) -> FloatArray:
    """(pixels,) depth of each beam, mean over the profiles; NaN where there is none."""
    return mean_over_profiles(scan.points_mm[..., 2])


def mean_over_profiles(values: FloatArray) -> FloatArray:
    """(pixels,) mean of what is finite of (profiles, pixels), NaN where nothing is."""
    valid = np.isfinite(values)
    count = valid.sum(axis=0)
    mean: FloatArray = np.where(valid, values, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan)
    return mean


def bulge_of(scan: Scan) -> float:
    """How far the middle of a target that faces the sensor comes out before its edges, in mm."""
    z_mm = mean_depths_mm(scan)
    middle = len(z_mm) // 2
    centre = z_mm[middle - CENTRE // 2 : middle + CENTRE // 2]
    return float(np.mean(z_mm[[*range(EDGE), *range(-EDGE, 0)]]) - np.mean(centre))


def depth_steps_mm(scan: Scan) -> FloatArray:
    """(pixels,) distance between neighbouring depths that a beam can report.

    From the different depths that occurred: the target should be tilted so that a beam goes
    through several. 0 where hardly any depth occurs twice, as without quantisation; NaN where
    fewer than 3 are at hand.
    """
    steps = np.full(scan.points_mm.shape[1], np.nan)
    for i, column in enumerate(scan.points_mm[..., 2].T):
        depths = np.sort(column[np.isfinite(column)])
        if len(depths) < 3:
            continue
        gaps = np.diff(depths)
        gaps = gaps[gaps > 1e-6]
        if len(gaps) + 1 > 0.9 * len(depths):
            steps[i] = 0.0
        elif len(gaps):
            steps[i] = np.median(gaps[gaps < 1.5 * gaps.min()])
    return steps
