from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform
from shipped_configs import CONFIGS

from harness.config.reading import load_experiment
from harness.config.schema import Experiment
from harness.scoring.face_gaps import FaceGaps
from harness.scoring.poses import PARAMETERS, pose_error, pose_from_parameters
from harness.session import open_session
from harness.store import Row, Store, load
from harness.tables.experiment import (
    accuracy_table,
    all_tables,
    failure_table,
    stage_table,
    success_table,
)
from harness.tables.pairs import pair_tables
from harness.tables.table import Table, write_tables

DESK = CONFIGS / "desk.yaml"
EXACT = np.array([-25.44, 0.0, 0.0, 0.0, -410.2, 188.8])


def moved(by: list[float]) -> RigidTransform:
    six = EXACT + by
    return pose_from_parameters(six[:3], six[3:])


def rows_with(folder: Path, offsets: list[list[float] | None]) -> tuple[Experiment, pd.DataFrame]:
    """Rows of table 6.4 whose estimates are off by the given parameters, None for a failure."""
    session = open_session(DESK, folder, ["methods=[{name: thesis}]", f"repeats={len(offsets)}"])
    trials = [trial for trial in session.trials if trial.pair == "6.4"]
    exact = moved([0.0] * 6)
    with Store(folder) as store:
        store.begin(session.trials)
        for trial, offset in zip(trials, offsets, strict=True):
            row = Row(trial.id, "{}", "failed", reason="why", T_exact=exact, overlap_source=0.5)
            if offset is not None:
                error = pose_error(exact, moved(offset))
                row = Row(
                    trial.id, "{}", "ok", T_exact=exact, T_estimated=moved(offset),
                    rotation_error_deg=float(np.rad2deg(error.rotation_rad)),
                    translation_error_mm=error.translation_mm, overlap_source=0.5,
                )  # fmt: skip
            store.add(row, "code")
    return session.experiment, load(folder)


def test_table_6_4_holds_exact_values_both_estimates_and_both_errors(tmp_path: Path) -> None:
    experiment, rows = rows_with(tmp_path, [[0.5, 0.0, 0.0, 1.0, 2.0, 2.0], None])
    (table,) = pair_tables(experiment, rows)
    assert table.title == "Table 6.4: left to center, method thesis"
    columns = list(table.frame.columns)
    text = [dict(zip(columns, row, strict=True)) for row in table.text()]
    assert text[0] == {
        "Parameter": "Rotation X (deg)",
        "Label in the thesis": "Rotation (Z)",
        "Exact": "-25.44",
        "Thesis's estimate": "-25.43",
        "Our estimate": "-24.94",
        "Our error": "+0.50",
        "Thesis's error": "+0.01",
        "Our error, all repeats": "+0.50 [+0.50, +0.50]",
    }
    assert text[2]["Label in the thesis"] == "Rotation (X)"
    assert text[2]["Thesis's estimate"] == "0.38"
    assert [row["Thesis's error"] for row in text[3:6]] == ["-1.90", "+13.60", "-2.40"]
    assert text[6]["Our error"] == "0.50"
    assert text[7]["Our error"] == "3.00"
    assert text[7]["Thesis's error"] == f"{np.sqrt(1.9**2 + 13.6**2 + 2.4**2):.2f}"
    assert "1 of 2 repeats have an estimate" in table.note


def test_a_first_repeat_without_an_estimate_leaves_blanks_and_says_why(tmp_path: Path) -> None:
    experiment, rows = rows_with(tmp_path, [None, [0.0] * 6])
    (table,) = pair_tables(experiment, rows)
    assert table.frame["Our estimate"].isna().all()
    assert "Repeat 0: failed: why." in table.note


def test_success_is_counted_over_all_trials(tmp_path: Path) -> None:
    fine, coarse, wrong = [0.0] * 6, [2.0, 0, 0, 0, 0, 0], [9.0, 0, 0, 0, 0, 0]
    _, rows = rows_with(tmp_path, [fine, coarse, wrong, None])
    (counted,) = success_table(rows).frame.to_dict("records")
    assert (counted["Trials"], counted["Answered"]) == (4, 3)
    assert counted["Answered, but wrong"] == 1
    assert counted["Within 5 deg and 30 mm"] == "2/4 [15%, 85%]"
    assert counted["Within 1 deg and 5 mm"] == "1/4 [5%, 70%]"
    successes, everything = accuracy_table(rows).frame.to_dict("records")
    assert (successes["n"], everything["n"]) == (2, 4)
    assert successes["Rotation 90 % (deg)"] == pytest.approx(2.0)
    assert everything["Rotation median (deg)"] == pytest.approx(9.0)
    assert everything["Rotation 90 % (deg)"] == np.inf
    failures = failure_table(rows).frame
    assert list(failures["Repeat"]) == [2, 3]
    assert list(failures["Reason"]) == ["off by 9.00 deg, 0.0 mm", "why"]


def test_an_unsure_answer_is_no_success(tmp_path: Path) -> None:
    _, rows = rows_with(tmp_path, [[0.0] * 6])
    rows["status"] = "ambiguous"
    counted = success_table(rows).frame
    assert counted["Within 5 deg and 30 mm"][0].startswith("0/1")
    assert counted["Answered, but wrong"][0] == 0


@pytest.mark.parametrize(("off_mm", "worse"), [(13.0, False), (15.0, True)])
def test_the_stages_say_when_the_thesis_printed_a_smaller_error(
    tmp_path: Path, off_mm: float, worse: bool
) -> None:
    # Of table 6.4 the thesis's own estimate is 13.9 mm off, the norm of (-1.9, 13.6, -2.4).
    experiment, rows = rows_with(tmp_path, [[0.0, 0.0, 0.0, off_mm, 0.0, 0.0]])
    entered = rows.assign(given="patches", translation_error_mm=0.0)
    gaps = FaceGaps(np.array([[0.0, 3.0, 20.0]] * 4), np.zeros((4, 3)))
    table = stage_table(experiment, pd.concat([rows, entered]), {"6.4": gaps})
    assert "20.2 mm apart" in table.note
    assert "mostly along Z" in table.note
    told = f"thesis is {off_mm:.1f} mm off, more than the thesis printed (13.9 mm)"
    assert (told in table.note) == worse


def test_tables_are_written_three_times_and_old_ones_go(tmp_path: Path) -> None:
    experiment, rows = rows_with(tmp_path / "run", [[0.5, 0.0, 0.0, 0.0, 0.0, 0.0]])
    folder = tmp_path / "tables"
    folder.mkdir()
    (folder / "table_old_method.csv").touch()
    tables = all_tables(experiment, rows)
    write_tables(tables, folder)
    names = {table.name for table in tables}
    assert {file.stem for file in folder.iterdir()} == names
    assert len(list(folder.iterdir())) == 3 * len(names)
    raw = pd.read_csv(folder / "table_6.4_thesis.csv")
    assert raw["Our error"][0] == 0.5
    assert "50\\%" in (folder / "table_6.4_thesis.tex").read_text(encoding="utf-8")


def test_numbers_are_printed_plainly() -> None:
    frame = pd.DataFrame({"x": [-0.001, 0.25, np.nan, np.inf], "n": [0, 1, 2, 3]})
    table = Table("t", "T", "", frame, {"x": "+.2f", "n": "d"})
    assert table.text() == [["0.00", "0"], ["+0.25", "1"], ["", "2"], ["none", "3"]]


def test_a_pair_of_ones_own_has_no_columns_of_the_thesis(small_file: Path, tmp_path: Path) -> None:
    session = open_session(small_file, tmp_path)
    with Store(tmp_path) as store:
        store.begin(session.trials)
        for trial in session.trials:
            store.add(Row(trial.id, "{}", "error", reason="a bug"), "code")
    table = list(pair_tables(load_experiment(small_file), load(tmp_path)))[1]
    assert table.title == "Pair plain: third to left, method thesis"
    assert not any("hesis" in column for column in table.frame.columns)


def test_the_theoretical_pose_stands_beside_the_exact_one(tmp_path: Path) -> None:
    experiment, rows = rows_with(tmp_path, [[0.5, 0.0, 0.0, 1.0, 2.0, 2.0]])
    rows["T_theoretical"] = [moved([0.0, 0.1, 0.0, 0.0, 3.0, 4.0]).as_matrix()]
    six = EXACT + np.array([0.0, 0.1, 0.0, 0.0, 3.0, 4.0])
    for name, value in zip(PARAMETERS, six, strict=True):
        rows[f"theoretical_{name}"] = value
    (table,) = pair_tables(experiment, rows)
    assert list(table.frame.columns[2:5]) == ["Exact", "Theoretical", "Thesis's estimate"]
    np.testing.assert_allclose(table.frame["Theoretical"][:6], six)
    assert "0.100 deg and 5.00 mm off the exact one" in table.note
