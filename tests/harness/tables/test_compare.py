"""Paired statistics of two runs: by hand on small cases, and their laws."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.cli import main
from harness.tables.compare import (
    changed_table,
    comparison_table,
    matched,
    median_difference,
    summary,
    trial_count,
)

NAMES = ("before", "after")


def rows(errors_mm: list[float | None], params: str = "x", seed: int = 0) -> pd.DataFrame:
    """Rows of one method on as many repeats; None for no answer."""
    return pd.DataFrame(
        [
            {
                "id": f"{params}{repeat}", "pair": "p", "method": "m", "given": "",
                "repeat": repeat, "status": "failed" if error is None else "ok", "reason": "",
                "rotation_error_deg": np.nan if error is None else 0.01 * error,
                "translation_error_mm": np.nan if error is None else error,
                "ms_registration": 10.0,
                "spec": json.dumps({"method": params, "repeat": repeat, "seed": seed}),
            }
            for repeat, error in enumerate(errors_mm)
        ]
    )  # fmt: skip


def few_or_many(least: int, most: int) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(-5, 5), min_size=least, max_size=most)


@settings(max_examples=25, deadline=None)
@given(few_or_many(6, 8) | few_or_many(14, 20), st.floats(0.1, 3.0))  # between, SciPy takes seconds
def test_the_median_difference_lies_in_its_interval_and_turns_with_its_sign(
    values: list[float], shift: float
) -> None:
    differences = np.round(np.array(values), 3)
    middle, low, high, p = median_difference(differences)
    assert low <= high
    assert 0.0 <= p <= 1.0
    if differences.any():
        turned = median_difference(-differences)
        assert turned[0] == pytest.approx(-middle)
        assert turned[3] == pytest.approx(p)
    moved = median_difference(differences + shift)
    assert moved[0] == pytest.approx(middle + shift)


def test_a_shift_of_every_error_is_found_and_chance_is_not() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 1.0, 40)
    _, low, high, p = median_difference(noise + 1.5)
    assert 0.5 < low < high < 2.5
    assert p < 1e-5
    assert median_difference(noise - np.median(noise))[3] > 0.05
    assert np.isnan(median_difference(noise[:5])[1:]).all()


def test_trials_match_by_scans_and_label_whatever_the_parameters() -> None:
    before = rows([1.0, 2.0, None, 4.0], "old")
    after = rows([1.0, None, 3.0, 3.0, 9.0], "new")
    pairs = matched(before, after)
    assert list(pairs["repeat"]) == [0, 1, 2, 3]
    assert matched(before, rows([1.0], "new", seed=1)).empty
    (record,) = comparison_table(pairs, NAMES).frame.to_dict("records")
    assert (record["both"], record["only before"], record["only after"]) == (2, 1, 1)
    assert record["Median difference (mm)"] == pytest.approx(-0.5)
    assert record["Time ratio"] == 1.0
    changed = changed_table(pairs, NAMES).frame
    assert list(changed["Trial in before"]) == ["old1", "old2"]  # lost, then won
    assert "3 of 4 right in before, 3 in after (p 1)" in summary(pairs, NAMES)


def swept(column: str, errors_mm: dict[float, float], params: str) -> pd.DataFrame:
    """Rows of two repeats at each value of a parameter of the method, each off by that much."""
    blocks = [
        rows([error, error + 0.1], f"{params} {value}").assign(
            **{"sweep.point": point, "sweep.varied": "", f"sweep.{column}": value}
        )
        for point, (value, error) in enumerate(errors_mm.items())
    ]
    return pd.concat(blocks, ignore_index=True)


def test_points_of_sweeps_match_by_what_is_swept() -> None:
    before = swept("m.n", {3: 1.0, 4: 5.0}, "old")
    after = swept("m.n", {4.0: 4.0, 3.0: 1.0, 7.0: 9.0}, "new")
    pairs = matched(before, after)
    assert [(a[4], b[4]) for a, b in zip(pairs["id_a"], pairs["id_b"], strict=True)] == [
        ("3", "3"), ("3", "3"), ("4", "4"), ("4", "4"),
    ]  # fmt: skip
    assert list(pairs["repeat"]) == [0, 1, 0, 1]


def test_a_trial_that_several_points_share_counts_once() -> None:
    before, after = (swept("other.n", {3: 1.0, 4: 5.0}, name) for name in ("old", "new"))
    for each in (before, after):
        each["id"] = [f"of repeat {repeat}" for repeat in each["repeat"]]
    assert list(matched(before, after)["repeat"]) == [0, 1]
    assert trial_count(before) == 2


def test_a_trial_with_several_partners_is_refused() -> None:
    before, after = rows([1.0, 2.0], "old"), swept("m.n", {3: 1.0, 4: 5.0}, "new")
    with pytest.raises(ValueError, match=r"several trials .* differ in m\.n only"):
        matched(before, after)
    assert len(matched(before, after[after["sweep.point"] == 0])) == 2


def test_the_command_compares_two_runs(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [tmp_path / name for name in NAMES]
    options = [str(small_file), "--workers", "1", "--set", "methods.thesis.figures=false"]
    assert main([*options, "--out", str(folders[0])]) == 0
    literal = ["--set", 'methods.thesis.preset="literal"']
    assert main([*options, *literal, "--out", str(folders[1])]) == 0
    capsys.readouterr()
    out = tmp_path / "compared"
    asked = ["--compare", *map(str, folders), "--out", str(out)]
    assert main(asked) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "4 trials in common, of 4 in before and 4 in after." in told
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "after against before" in page
    frame = pd.read_csv(out / "tables" / "comparison.csv")
    assert list(frame["Trials"]) == [4]
    assert (out / "figures" / "errors.png").stat().st_size > 5_000

    assert main([*options, "--seed", "99", "--out", str(tmp_path / "other")]) == 0
    capsys.readouterr()
    assert main(["--compare", str(folders[0]), str(tmp_path / "other")]) == 2
    told = capsys.readouterr().err
    assert "have no trial in common" in told
    assert told.count("\n") == 1
    assert main(["--compare", str(folders[0]), str(tmp_path / "absent")]) == 2
    assert main([str(small_file), *asked]) == 2
