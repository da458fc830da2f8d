"""Errors of rows in units of what they should be: of the bound, and of the method's covariance."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from harness.scoring.bound import parameter_deviations
from harness.scoring.poses import PARAMETERS
from registration.scan import FloatArray

COUNTED = ("all points of shared faces", "points in the overlap only")


def bound_ratios(group: pd.DataFrame, which: int) -> FloatArray:
    """(n, 6) errors of the six parameters in units of the bound's standard deviation.

    which: the index in COUNTED. Rows without an error or a finite bound are left out.
    """
    ratios = []
    for bounds, T_exact, errors in zip(
        group["bounds"],
        group["T_exact"],
        group[[f"error_{c}" for c in PARAMETERS]].to_numpy(float),
        strict=True,
    ):
        if bounds is not None and np.isfinite(bounds[which]).all() and np.isfinite(errors).all():
            pose = RigidTransform.from_matrix(T_exact)
            ratios.append(errors / parameter_deviations(bounds[which], pose))
    return np.array(ratios).reshape(-1, 6)


def squared_distances(group: pd.DataFrame) -> FloatArray:
    """(n,) normalised estimation errors squared of the rows with a covariance."""
    distances = []
    for covariance, estimated, exact in zip(
        group["covariance"], group["T_estimated"], group["T_exact"], strict=True
    ):
        if covariance is None or estimated is None:
            continue
        left = RigidTransform.from_matrix(exact) * RigidTransform.from_matrix(estimated).inv()
        error = np.concatenate([left.rotation.as_rotvec(), left.translation])
        scale = 1.0 / np.sqrt(np.diag(covariance))
        scaled = covariance * np.outer(scale, scale)
        distances.append((scale * error) @ np.linalg.solve(scaled, scale * error))
    return np.array(distances)
