"""Which motions of single profiles lie far from the others, and the mean of the rest."""

from __future__ import annotations

import numpy as np
import pandas as pd

from registration.scan import BoolArray, FloatArray

CUTOFF = 3.5
MOTION = ("rotation_x_deg", "y_mm", "z_mm")  # what a plane tells of a pose


def outliers(values: FloatArray) -> BoolArray:
    """Which of the motions (n, 3) lie far from the others in the turn, along Y or along Z.

    values: degrees, mm, mm; NaN where there is no answer, which is no outlier. Far is a modified
    z-score above 3.5: the distance from the median beyond 3.5 / 0.6745 median absolute deviations
    (Iglewicz and Hoaglin, How to detect and handle outliers, 1993).
    """
    known = np.isfinite(values).all(axis=1)
    far = np.zeros(len(values), dtype=bool)
    if not known.any():
        return far
    distance = np.abs(values[known] - middle(values[known]))
    distance[:, 0] = np.minimum(distance[:, 0] % 360.0, -distance[:, 0] % 360.0)
    deviation = np.median(distance, axis=0)
    # Exact scans agree to rounding: that far is not far.
    far[known] = np.any(0.6745 * distance > CUTOFF * np.maximum(deviation, 1e-6), axis=1)
    return far


def wrapped_deg(angle_deg: FloatArray) -> FloatArray:
    """Angles from -180 to below 180 degrees."""
    wrapped: FloatArray = np.mod(angle_deg + 180.0, 360.0) - 180.0
    return wrapped


def middle(values: FloatArray) -> FloatArray:
    """The median of motions (n, 3), the turn's taken about the one that is nearest to all."""
    turn = values[:, 0]
    apart = wrapped_deg(turn[:, None] - turn[None])
    nearest = np.abs(apart).sum(axis=0).argmin()
    centre: FloatArray = np.median(
        np.column_stack([turn[nearest] + apart[:, nearest], values[:, 1:]]), axis=0
    )
    return centre


def mean_motion(rows: pd.DataFrame) -> FloatArray:
    """(3,) mean of the rows that are answered and no outliers; NaN when there is none."""
    values = rows.loc[~rows["outlier"], list(MOTION)].dropna().to_numpy(dtype=np.float64)
    if len(values) == 0:
        return np.full(3, np.nan)
    centre = middle(values)
    apart = values - centre
    apart[:, 0] = wrapped_deg(apart[:, 0])
    mean: FloatArray = centre + apart.mean(axis=0)
    return mean
