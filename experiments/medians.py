"""Medians with their intervals, as the summaries print them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.scoring.chance import median_interval
from harness.scoring.row_scores import observed_quantile
from harness.tables.table import printed
from registration.scan import FloatArray


class Median(NamedTuple):
    """A median with its 95 % confidence interval, NaN where too few values bound it."""

    middle: float
    low: float
    high: float

    def text(self, specification: str) -> str:
        """As in a table, the interval in brackets."""
        if not np.isfinite(self.middle):
            return "none"
        middle = printed(self.middle, specification)
        if np.isnan(self.low) or np.isnan(self.high):
            return middle
        return f"{middle} [{printed(self.low, specification)}, {printed(self.high, specification)}]"


def median_of(values: FloatArray) -> Median:
    """The median of values (n,), infinite ones among them, and its interval, NaN of too few."""
    return Median(observed_quantile(values, 0.5), *(median_interval(values) or (np.nan, np.nan)))
