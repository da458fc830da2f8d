"""The discussion of section 6.6: the command, small, and the laws of what it computes."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.cli import main
from experiments.discussion_tables import enough, moved_table, rms_interval, turned_table
from experiments.discussion_trials import Asked, load_discussion
from experiments.turned_rotation import Turning, turn
from harness.workers.pool import MakeExecutor, process_pool

CONFIGS = Path(__file__).parents[2] / "configs"
SMALL = [
    "stages.repeats=1",
    "turned.repeats=1",
    "turned.axes=2",
    "turned.angles_deg=[0, 1]",
    "moved.repeats=2",
    "overlap.repeats=1",
    "overlap.turns_deg=[30]",
    "overlap.apart_mm=[0, 240]",
    "bracket.repeats=1",
    "bracket.times=[0, 10]",
]


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The config beside those that it builds on, with fewer profiles."""
    folder = tmp_path_factory.mktemp("configs")
    for name in ("discussion.yaml", "desk.yaml", "foam.yaml"):
        shutil.copy(CONFIGS / name, folder)
    desk = folder / "desk.yaml"
    desk.write_text(desk.read_text().replace("profiles: 130", "profiles: 44"))
    return folder / "discussion.yaml"


def turnings(config: Path) -> dict[str, Turning]:
    """One pair of the desk by both methods."""
    asked = load_discussion(config, SMALL)[1]
    chosen = [a.trial for a in asked if a.question == "turned" and a.value == "6.4"]
    return {trial.label: Turning(trial, (0.0, 1.0), 2) for trial in chosen}


def test_the_command_answers_every_question_and_takes_its_rows_again(
    config: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    options = [str(config), "--out", str(tmp_path)]
    for change in SMALL:
        options += ["--set", change]
    assert main([*options, "--report-only"]) == 2
    assert "lacks" in capsys.readouterr().err
    # The stages ask for the bracket as it is, too: one trial, for both.
    assert main([*options, "--set", "bracket.times=[0, 1]", "--dry-run"]) == 0
    count = re.search(r"(\d+) trials, (\d+) of them to compute", capsys.readouterr().out)
    assert count is not None
    assert count[1] == count[2]
    assert not any(tmp_path.iterdir())
    used: list[int] = []

    def counted(workers: int) -> MakeExecutor:
        used.append(workers)
        return process_pool(workers)

    monkeypatch.setattr("experiments.discussion.process_pool", counted)
    assert main([*options, "--workers", "1"]) == 0
    assert used == [1]
    shown = capsys.readouterr().out
    tables = {path.stem: pd.read_csv(path) for path in (tmp_path / "tables").glob("*.csv")}
    assert set(tables) == {
        "rotation_error",
        "stages",
        "stages_true_rotation",
        "icp_on_gauss_sphere",
        "y_against_z",
        "overlap",
        "bracket",
        "sensor_card",
    }
    assert "Card of the sensor" not in shown
    figures = {path.stem for path in (tmp_path / "figures").glob("*.png")}
    assert figures == {
        "rotation_error",
        "densest_shift",
        "plane_distances",
        "icp_on_top",
        "y_against_z",
        "overlap",
        "bracket",
    }
    assert "What does the bracket" not in shown  # a figure's title
    assert "What the bracket does to the theoretical values" in shown

    bracket = tables["bracket"].set_index("Bracket times")
    assert (bracket.loc[0.0, "Theoretical (mm)"] < 0.1).all()
    assert (bracket.loc[10.0, "Theoretical (mm)"] > 5.0).all()
    assert (tmp_path / "run.json").exists()
    facts = (tmp_path / "run.json").read_text()

    assert main([*options, "--dry-run"]) == 0
    assert " 0 of them to compute" in capsys.readouterr().out
    assert main([*options, "--report-only"]) == 0
    # What is noted when rows are computed is untouched: none was.
    assert (tmp_path / "run.json").read_text() == facts
    for name, table in tables.items():
        again = pd.read_csv(tmp_path / "tables" / f"{name}.csv")
        pd.testing.assert_frame_equal(again, table)


def test_a_trial_is_replayed_and_writes_nothing(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [str(config), "--out", str(tmp_path)]
    for change in SMALL:
        options += ["--set", change]
    asked = load_discussion(config, SMALL)[1]
    trial = next(
        a.trial for a in asked if a.question == "moved" and a.trial.label == "gauss_sphere"
    )
    assert main([*options, "--trial", trial.id]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"trial {trial.id}: ")
    assert "estimated  rotation" in shown
    assert main([*options, "--trial", "no such"]) == 2
    assert "'no such' is no trial of" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_a_turn_of_nothing_leaves_the_translation_the_same_everywhere(config: Path) -> None:
    rows = {label: pd.DataFrame(turn(t)) for label, t in turnings(config).items()}
    for found in rows.values():
        straight = found[found["angle_deg"] == 0.0]
        np.testing.assert_allclose(
            straight["translation_error_mm"], straight["middle_error_mm"], atol=1e-9
        )
        assert straight["translation_error_mm"].nunique() == 1
        assert (straight["lever_mm"] < 1e-9).all()
        assert (found.loc[found["angle_deg"] == 1.0, "lever_mm"] > 0.0).all()
    # The same axes for both methods, so the same levers.
    np.testing.assert_array_equal(rows["thesis"]["lever_mm"], rows["gauss_sphere"]["lever_mm"])
    assert rows["gauss_sphere"]["translation_error_mm"].notna().all()


def test_turning_is_repeatable(config: Path) -> None:
    turning = turnings(config)["gauss_sphere"]
    assert turn(turning) == turn(replace(turning))


def test_an_error_that_is_all_lever_is_called_so() -> None:
    angles = [0.0, 0.5, 1.0]
    rows = pd.DataFrame(
        {
            "method": "thesis",
            "angle_deg": np.repeat(angles, 8),
            "translation_error_mm": np.repeat([1.0, 9.0, 18.0], 8),
            "middle_error_mm": 1.0,
            "lever_mm": np.repeat([0.0, 8.7, 17.5], 8),
        }
    )
    assert "almost all lever: 100%" in turned_table(rows).note
    rows["middle_error_mm"] = rows["translation_error_mm"]
    assert "lever in part: 0%" in turned_table(rows).note


def test_enough_overlap_is_where_nothing_above_fails() -> None:
    overlap = np.repeat([0.1, 0.35, 0.5, 0.7, 0.9], 4)
    right = np.repeat([1, 0, 1, 1, 1], 4).astype(bool)
    rows = pd.DataFrame(
        {
            "scene": "desk",
            "method": "thesis",
            "overlap": overlap,
            "status": np.where(right, "ok", "failed"),
            "rotation_error_deg": 0.1,
            "translation_error_mm": 1.0,
        }
    )
    assert enough(rows, "desk", "thesis") == pytest.approx(0.45)
    assert enough(rows.assign(status="failed"), "desk", "thesis") is None


def test_errors_along_the_axes_are_told_apart() -> None:
    rng = np.random.default_rng(0)
    rows = pd.DataFrame(
        {
            "method": "thesis",
            "value": "Y",
            "status": ["ok"] * 40 + ["failed"] * 2,
            **{
                f"error_{a}_mm": rng.normal(0.0, s, 42)
                for a, s in zip("xyz", (1, 8, 2), strict=True)
            },
            **{f"middle_{a}_mm": rng.normal(0.0, 1.0, 42) for a in "xyz"},
        }
    )
    table = moved_table(rows, 200.0)
    assert list(table.frame["Answered"]) == [40, 40]
    errors = rows["error_y_mm"].to_numpy()[:40]
    low, high = rms_interval(errors)
    assert low < np.sqrt(np.mean(errors**2)) < high
    assert f"[{low:.2f}, {high:.2f}]" in table.frame.loc[0, "Y (mm)"]


def test_trials_are_those_of_the_configs(config: Path) -> None:
    asked = load_discussion(config, SMALL)[1]
    of: dict[str, list[Asked]] = {}
    for a in asked:
        of.setdefault(a.question, []).append(a)
    assert {a.value for a in of["stages"]} == {"6.1", "6.4", "6.5"}
    brackets = {a.value: a.trial.spec.target.arm.bracket_mm for a in of["bracket"]}
    assert brackets == {0: (0.0, 0.0, 0.0), 10: (30.0, 30.0, 30.0)}
    assert len({(a.trial.pair, a.trial.label, a.trial.spec.given) for a in of["overlap"]}) == 8


def test_a_wrong_key_is_told_in_one_line(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(config), "--set", "overlap.repeats=0"]) == 2
    assert "overlap.repeats" in capsys.readouterr().err
    assert main([str(config), "--set", "desk=nowhere.yaml"]) == 2
    assert "nowhere.yaml" in capsys.readouterr().err
    shutil.copy(CONFIGS / "precision.yaml", config.parent)
    assert main([str(config), "--set", "desk=precision.yaml"]) == 2
    assert "precision.yaml" in capsys.readouterr().err
