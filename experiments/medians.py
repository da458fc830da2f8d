"""Medians and rates with their intervals, as the summaries print them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from harness.scoring import wilson_interval
from harness.table_files import printed
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


def median_interval(values: FloatArray) -> Median:
    """The median of values (n,), infinite ones among them, and its distribution-free interval.

    The interval is of order statistics (scipy.stats.quantile_test, after Conover, Practical
    nonparametric statistics, 3.2); below six values there is none.
    """
    if len(values) == 0:
        return Median(np.nan, np.nan, np.nan)
    # An observed value, not one between two: half of infinity means nothing.
    middle = float(np.quantile(values, 0.5, method="higher"))
    interval: Any = stats.quantile_test(values, q=0.0, p=0.5).confidence_interval(0.95)
    return Median(middle, float(interval.low), float(interval.high))


def rate(count: int, total: int) -> str:
    """A rate with Wilson's 95 % interval."""
    low, high = wilson_interval(count, total)
    return f"{count}/{total} [{low:.0%}, {high:.0%}]"
