"""What chance may do to what was counted: intervals of rates and of medians, and a sign test."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import binomtest, quantile_test

from registration.scan import FloatArray

LEVEL = 0.95
FEWEST = 6  # values below which a median has no interval at that level
DEVIATIONS = 1.959963984540054  # standard deviations to either side that hold LEVEL of a normal law


def sign_test(gained: int, lost: int) -> float:
    """The exact two-sided p of so uneven a split if both were alike; 1.0 of no difference at all.

    Of trials that only one of two methods gets right it is McNemar's test: Q. McNemar,
    Psychometrika 12 (1947) 153, with the binomial distribution itself.
    """
    return float(binomtest(gained, gained + lost).pvalue) if gained + lost else 1.0


def median_interval(values: FloatArray) -> tuple[float, float] | None:
    """The interval of a median by order statistics, or None of fewer than FEWEST values.

    Source: W. J. Conover, Practical nonparametric statistics, 3.2.
    """
    if len(values) < FEWEST:
        return None
    interval: Any = quantile_test(values, q=0.0, p=0.5).confidence_interval(LEVEL)
    return float(interval.low), float(interval.high)


def median_text(values: FloatArray) -> str:
    """A median with its interval, where there are values enough; nothing of none."""
    if not len(values):
        return ""
    text, bounds = f"{np.median(values):.2f}", median_interval(values)
    return text if bounds is None else f"{text} [{bounds[0]:.2f}, {bounds[1]:.2f}]"


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a success rate; (0, 1) when there was no trial.

    Source: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if not 0 <= successes <= trials:
        raise ValueError(
            f"{successes} successes of {trials} trials; expected 0 <= successes <= trials"
        )
    if trials == 0:
        return 0.0, 1.0
    z, rate = DEVIATIONS, successes / trials
    widening = z * z / trials
    centre = (rate + widening / 2.0) / (1.0 + widening)
    half = z / (1.0 + widening) * np.sqrt(rate * (1.0 - rate) / trials + widening / (4.0 * trials))
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    high = 1.0 if successes == trials else min(1.0, centre + half)
    return float(low), float(high)


def rate(count: int, total: int) -> str:
    """A rate with Wilson's 95 % interval."""
    low, high = wilson_interval(count, total)
    return f"{count}/{total} [{low:.0%}, {high:.0%}]"
