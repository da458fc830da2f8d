"""The shifts that are kept of all that are tried."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from registration.gauss_sphere.candidates.shift_search import _keep

Tried = st.lists(st.tuples(st.integers(0, 9), st.integers(1, 50)), max_size=40)


@settings(deadline=None)  # the first example may compile
@given(Tried)
def test_the_best_of_distinct_shifts_are_kept_best_first(tried: list[tuple[int, int]]) -> None:
    shifts, scores, n = np.zeros((4, 3)), np.zeros(4), 0
    best: dict[int, int] = {}
    for place, score in tried:
        shift = np.array([100.0 * place, 0.0, 0.0])
        n = _keep(shift, float(score), 15.0, shifts, scores, n)
        best[place] = max(best.get(place, 0), score)
    assert list(scores[:n]) == sorted(best.values(), reverse=True)[:4]
    for shift, score in zip(shifts[:n], scores[:n], strict=True):
        assert best[round(shift[0] / 100.0)] == score
