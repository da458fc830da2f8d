"""Studies of random pairs as the page draws them: their points, bars and the trials behind each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from shipped_configs import CONFIGS

from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import load_experiment
from harness.report.pair_studies import pair_study
from harness.studies.study import find

METHODS = ("thesis", "gauss_sphere")
FAMILIES = ("desk", "clutter")


def experiment(name: str) -> RandomPairsExperiment:
    found = load_experiment(CONFIGS / f"{name}.yaml")
    assert isinstance(found, RandomPairsExperiment)
    return found


def rows() -> pd.DataFrame:
    """Of 80 pairs, thesis has those of more overlap right, gauss_sphere all but those of clutter
    with the least."""
    records = []
    for number in range(80):
        family, overlap = FAMILIES[number % 2], 0.1 + 0.7 * number / 79
        for method in METHODS:
            right = overlap > 0.45 if method == "thesis" else family == "desk" or overlap > 0.2
            records.append(
                {
                    "id": f"{method} {number}", "pair": f"{family} {number}", "method": method,
                    "given": "" if number % 7 else "segments", "repeat": 0,
                    "status": "ok" if right else "failed",
                    "rotation_error_deg": 0.1 + 0.001 * number if right else np.nan,
                    "translation_error_mm": 1.0 + 0.01 * number if right else np.nan,
                    "overlap_target": overlap, "overlap_source": 0.9,
                    "ms_registration": 10.0 + number,
                }
            )  # fmt: skip
    return pd.DataFrame(records)


def place(found: dict[str, Any], *values: float | str, method: str = "") -> dict[str, Any]:
    (point,) = (p for p in found["points"] if [*values] == p["values"] and method == p["method"])
    return point


def told(line: pd.Series[Any], column: str) -> list[float]:
    return line[[column, f"{column} low", f"{column} high"]].to_numpy(float).tolist()


def drawn(bars: list[float | None]) -> list[float]:
    return [np.nan if value is None else value for value in bars]


@pytest.mark.parametrize("name", ["overlap", "leaderboard"])
def test_points_hold_what_the_table_and_the_still_do(name: str) -> None:
    made = experiment(name)
    found = pair_study(rows(), made)
    assert found is not None
    frame = find(made, rows()).tables[0].frame
    if name == "overlap":
        assert len(found["points"]) == len(frame) == 7 * 2 * 3
        assert found["methods"] == list(METHODS)
    else:
        assert len(found["points"]) == 3 * len(frame) == 3 * 2
        assert found["methods"] == []
        order = [p["values"][0] for p in found["points"] if p["values"][1] == "all"]
        assert order == list(frame["Method"]) == ["gauss_sphere", "thesis"]
    for _, line in frame.iterrows():
        if name == "overlap":
            middle = round(50.0 * (line["From"] + line["To"]), 6)
            point = place(found, middle, line["Scenes"], method=line["Method"])
        else:
            point = place(found, line["Method"], "all")
            for family in FAMILIES:
                own = place(found, line["Method"], family)
                assert own["coarse"][0] == line[f"Right on {family}"]
        assert point["n"] == line["Pairs"]
        assert point["coarse"] == told(line, "Right")
        for short, column in (
            ("deg", "Median rotation error (deg)"),
            ("mm", "Median translation error (mm)"),
        ):
            bars = [np.nan] * 3 if point[short] is None else drawn(point[short])
            np.testing.assert_array_equal(bars, told(line, column))


@pytest.mark.parametrize("name", ["overlap", "leaderboard"])
def test_behind_a_point_are_its_trials(name: str) -> None:
    known = rows()
    known = known[known["given"] == ""]
    overlap = known["overlap_target"]
    found = pair_study(rows(), experiment(name))
    assert found is not None
    if name == "overlap":
        inside = (overlap >= 0.7) & (overlap <= 0.8) & (known["method"] == "thesis")
        value, method = 75.0, "thesis"
    else:
        inside, value, method = known["method"] == "thesis", "thesis", ""
    point = place(found, value, "clutter", method=method)
    whole = place(found, value, found["whole"], method=method)
    of_clutter = inside & known["pair"].str.startswith("clutter")
    assert point["ids"] == list(known.loc[of_clutter, "id"])
    assert whole["n"] == inside.sum() > point["n"]
    assert set(whole["ids"]) <= set(known.loc[inside, "id"])


def test_scenes_of_one_family_stand_for_all() -> None:
    known = rows()
    found = pair_study(known[known["pair"].str.startswith("desk")], experiment("overlap"))
    assert found is not None
    assert found["whole"] == "desk"
    assert {point["values"][1] for point in found["points"]} == {"desk"}


def test_random_pairs_without_a_study_have_no_points() -> None:
    assert pair_study(rows(), experiment("random_pairs")) is None
