"""Intervals and the sign test, against the equations that define them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from harness.scoring.chance import FEWEST, LEVEL, median_interval, sign_test, wilson_interval


@given(trials=st.integers(0, 200), share=st.floats(0.0, 1.0))
def test_the_wilson_interval_holds_the_rate_and_solves_its_equation(
    trials: int, share: float
) -> None:
    successes = round(share * trials)
    low, high = wilson_interval(successes, trials)
    assert 0.0 <= low <= high <= 1.0
    if trials == 0:
        assert (low, high) == (0.0, 1.0)
        return
    rate = successes / trials
    assert low <= rate <= high
    # The bounds are the rates p at which the observed one is 1.96 standard errors away.
    for bound in (low, high):
        if 0.0 < bound < 1.0:
            assert abs(rate - bound) == pytest.approx(
                1.959963984540054 * np.sqrt(bound * (1.0 - bound) / trials), rel=1e-6
            )


def test_an_impossible_count_is_refused() -> None:
    with pytest.raises(ValueError, match="5 successes of 4 trials"):
        wilson_interval(5, 4)


@pytest.mark.parametrize(
    ("only_a", "only_b", "p"), [(0, 0, 1.0), (0, 1, 1.0), (0, 5, 0.0625), (5, 0, 0.0625),
                                (1, 6, 0.125), (0, 10, 2 * 0.5**10)]
)  # fmt: skip
def test_the_sign_test_is_the_binomial_test(only_a: int, only_b: int, p: float) -> None:
    assert sign_test(only_a, only_b) == pytest.approx(p)


@given(st.lists(st.floats(0.01, 100.0), min_size=FEWEST, max_size=80))
def test_the_interval_of_a_median_holds_it_as_often_as_it_says(values: list[float]) -> None:
    """Its ends are the order statistics that the binomial law asks for, and no nearer ones do."""
    low, high = median_interval(np.array(values))
    ordered = sorted(values)
    n = len(values)
    # Of distinct values in their order the ends are the ranks themselves.
    ends = median_interval(np.arange(1.0, n + 1.0))
    k = int(ends[0])
    assert ends[1] == n + 1 - k
    assert (low, high) == (ordered[k - 1], ordered[n - k])
    assert 1.0 - 2.0 * binom.cdf(k - 1, n, 0.5) >= LEVEL
    assert 1.0 - 2.0 * binom.cdf(k, n, 0.5) < LEVEL


def test_too_few_values_have_no_interval() -> None:
    assert median_interval(np.ones(FEWEST - 1)) is None
