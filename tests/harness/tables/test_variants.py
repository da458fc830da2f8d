from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from harness.config.schema import MethodChoice
from harness.tables.variants import variant_tables

METHODS = [
    MethodChoice(name="thesis", label="plain"),
    MethodChoice(name="thesis", label="better"),
    MethodChoice(name="gauss_sphere"),
]


def rows_of(right: dict[str, list[bool]], error_mm: dict[str, float]) -> pd.DataFrame:
    """Trials of two pairs; the order of the rows is of no account."""
    records = [
        {
            "pair": f"pair {k % 2}",
            "repeat": k // 2,
            "method": method,
            "given": "",
            "status": "ok" if fine else "failed",
            "rotation_error_deg": 0.5 if fine else np.nan,
            "translation_error_mm": error_mm[method] if fine else np.nan,
            "ms_registration": 10.0,
        }
        for method, answers in right.items()
        for k, fine in enumerate(answers)
    ]
    return pd.DataFrame(records).sample(frac=1.0, random_state=0)


def test_trials_are_compared_on_the_same_scans() -> None:
    plain = [True] * 10 + [False] * 10
    better = [True] * 9 + [False] + [True] * 9 + [False]
    rows = rows_of(
        {"plain": plain, "better": better, "gauss_sphere": plain},
        {"plain": 8.0, "better": 2.0, "gauss_sphere": 1.0},
    )

    (table,) = variant_tables(METHODS, rows, random=False)

    frame = table.frame[table.frame["Pairs"] == "all"].set_index("Method")
    assert list(frame.index) == ["plain", "better"]
    line = frame.loc["better"]
    assert (line["Gained"], line["Lost"], line["Both right"]) == (9, 1, 9)
    # Of 10 tosses, 9 or more alike: 2 (1 + 10) / 1024.
    assert line["p"] == pytest.approx(22 / 1024)
    assert line["Translation error, ratio"] == "0.25 [0.25, 0.25]"
    assert line["Right"].startswith("18/20 ")
    assert "more trials right than plain: better; fewer: none" in table.note
    assert "ranslation error smaller: better; larger: none" in table.note
    assert "otation error smaller: none; larger: none" in table.note
    assert set(table.frame["Pairs"]) == {"all", "pair 0", "pair 1"}


def test_methods_that_stand_alone_have_no_variants() -> None:
    assert variant_tables(METHODS[1:], rows_of({"better": [True]}, {"better": 1.0}), False) == []


def test_variants_of_which_none_was_timed_get_their_table() -> None:
    rows = rows_of({"plain": [False] * 2, "better": [False] * 2}, {})
    rows["ms_registration"] = np.nan
    (table,) = variant_tables(METHODS, rows, random=False)
    assert list(table.frame["Time, ratio"]) == [""] * len(table.frame)


def test_trials_that_only_one_variant_has_are_left_out() -> None:
    rows = rows_of({"plain": [True] * 2, "better": [True] * 2}, {"plain": 8.0, "better": 2.0})
    for method in ("plain", "better"):
        lost = (rows["method"] == method) & (rows["repeat"] == 0) & (rows["pair"] == "pair 0")
        (table,) = variant_tables(METHODS, rows[~lost], random=False)
        line = table.frame.set_index(["Pairs", "Method"]).loc[("all", "better")]
        assert line["Trials"] == line["Both right"] == 1
    (table,) = variant_tables(METHODS, rows[rows["method"] == "better"], random=False)
    assert table.frame.set_index(["Pairs", "Method"]).loc[("all", "better"), "Trials"] == 0
