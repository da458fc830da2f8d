"""Which rows are right, and how far off they are: what every table of rows counts."""

from __future__ import annotations

import numpy as np
import pandas as pd

from harness.scoring.poses import Tolerance
from registration.scan import BoolArray, FloatArray

ERRORS = {"rotation_error_deg": "deg", "translation_error_mm": "mm"}


def within(rows: pd.DataFrame, tolerance: Tolerance) -> BoolArray:
    """(n,) which rows are answered "ok" and within the tolerance."""
    close = tolerance.holds(rows["rotation_error_deg"], rows["translation_error_mm"])
    right: BoolArray = ((rows["status"] == "ok") & close).to_numpy(dtype=bool)
    return right


def error_quantiles(errors: pd.DataFrame) -> dict[str, float]:
    """Median and 90 % quantile of both ERRORS, infinite where there is no answer, by column."""
    return {
        f"{column.split('_')[0].capitalize()} {name} ({unit})": observed_quantile(
            errors[column].to_numpy(), q
        )
        for column, unit in ERRORS.items()
        for name, q in (("median", 0.5), ("90 %", 0.9))
    }


def observed_quantile(values: FloatArray, q: float) -> float:
    """One of the values, not one between two: half of infinity means nothing. NaN of none."""
    return float(np.quantile(values, q, method="higher")) if len(values) else np.nan
