"""What studies reckon with: cut errors, chance, gains and losses, indices."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.config.reading import validated
from harness.config.sweep_schema import Sweep
from harness.studies.indices import sobol_indices
from harness.studies.numbers import beyond_chance, gained_lost, outcomes
from harness.trials.points import point_count, sweep_points


def test_failures_count_with_errors_at_the_cut() -> None:
    rows = pd.DataFrame(
        {
            "given": [""] * 4,
            "status": ["ok", "failed", "ok", "ambiguous"],
            "rotation_error_deg": [0.5, np.nan, 90.0, 0.1],
            "translation_error_mm": [2.0, np.nan, 10.0, 0.1],
        }
    )
    known = outcomes(rows)
    assert known["right"].tolist() == [True, False, False, False]
    assert known["rotation_cut_deg"].tolist() == [0.5, 5.0, 5.0, 5.0]
    assert known["translation_cut_mm"].tolist() == [2.0, 30.0, 10.0, 30.0]


@given(st.lists(st.floats(0.0, 1.0), max_size=12))
def test_holm_holds_as_its_definition_says(p_values: list[float]) -> None:
    held = beyond_chance(p_values)
    ordered = sorted(p_values)
    n = len(p_values)
    most = next((k for k in range(n) if ordered[k] > 0.05 / (n - k)), n)
    assert held.sum() == most
    assert sorted(np.asarray(p_values)[held]) == ordered[:most]


def test_gains_and_losses_are_of_pairs() -> None:
    ours = pd.DataFrame({"pair": list("abcd"), "repeat": 0, "right": [True, True, True, False]})
    theirs = pd.DataFrame({"pair": list("dcba"), "repeat": 0, "right": [True, False, False, True]})
    gained, lost, p = gained_lost(ours, theirs)
    assert (gained, lost) == (2, 1)
    assert p == 1.0


@pytest.mark.parametrize("reversed_", [False, True])
def test_indices_of_ishigami(reversed_: bool) -> None:
    bounds = {"distribution": "uniform", "from": -np.pi, "to": np.pi}
    keys = ["x1", "x2", "x3"]
    data = {"design": "saltelli", "samples": 1024, "over": dict.fromkeys(keys, bounds)}
    sweep: Sweep = validated(Sweep, data, "file")
    x1, x2, x3 = np.array([list(p.values.values()) for p in sweep_points(sweep)]).T
    if reversed_:
        x1, x3 = x3, x1
    a, b = 7.0, 0.1
    outputs = np.sin(x1) + a * np.sin(x2) ** 2 + b * x3**4 * np.sin(x1)
    found = sobol_indices(sweep, outputs)
    np.testing.assert_array_equal(found, sobol_indices(sweep, outputs))
    # T. Ishigami and T. Homma, 1990: the variance and its parts are known.
    interplay = 8.0 * b**2 * np.pi**8 / 225.0
    alone = np.array([0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0])
    total = alone + np.array([interplay, 0.0, interplay])
    order = slice(None, None, -1) if reversed_ else slice(None)
    variance = alone.sum() + interplay
    np.testing.assert_allclose(found.first[order], alone / variance, atol=0.06)
    np.testing.assert_allclose(found.total[order], total / variance, atol=0.06)
    inside = np.abs(found.total[order] - total / variance) <= 1.5 * found.total_half[order]
    assert inside.all()
    assert (found.first_half < 0.2).all()


def test_an_output_without_variance_has_no_indices() -> None:
    over = {"x1": {"distribution": "uniform", "from": 0, "to": 1}}
    sweep: Sweep = validated(Sweep, {"design": "saltelli", "samples": 4, "over": over}, "file")
    assert np.isnan(sobol_indices(sweep, np.ones(point_count(sweep))).total).all()
