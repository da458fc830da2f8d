"""Random pairs by the command itself."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from harness.execution import perform
from harness.session import open_session
from harness.store import load

CONFIG = Path(__file__).parents[2] / "configs" / "random_pairs.yaml"
SMALL = [
    option
    for family in ("desk", "foam_chair", "clutter")
    for option in ("--set", f"families.{family}.pairs=1")
] + ["--set", "scan.profiles=40", "--set", "scan.step_mm=10.0"]  # fmt: skip


def test_the_shipped_config_runs_and_its_rows_are_those_of_any_process(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(CONFIG.parents[1])  # its calibration file is named from there
    out = tmp_path / "out"
    assert main([str(CONFIG), "--out", str(out), "--workers", "2", *SMALL]) == 0
    shown = capsys.readouterr().out
    rows = load(out, specs=True)
    assert len(rows) == 9
    assert rows["bounds"].notna().all()
    assert "Successes" in shown
    names = {path.name for path in (out / "figures").iterdir()}
    assert {"random_success.png", "random_bound.png", "random_times.png"} <= names
    for name in ("success", "curves", "bound", "calibration", "times", "statuses"):
        assert (out / "tables" / f"{name}.csv").stat().st_size > 100
    capsys.readouterr()
    identity = rows["id"].iloc[0]
    assert main([str(CONFIG), "--out", str(out), *SMALL, "--trial", identity]) == 0
    assert f"{rows['rotation_error_deg'].iloc[0]:.3f} deg" in capsys.readouterr().out
    resolved = open_session(out / "config.yaml", None)
    assert [trial.id for trial in resolved.trials] == list(rows["id"])
    # Backwards, so that every pair is drawn and scanned with other things at hand than before.
    for trial, (_, row) in reversed(list(zip(resolved.trials, rows.iterrows(), strict=True))):
        # As a row comes from a worker: pickling a pose may round its last bit once more.
        here = pickle.loads(pickle.dumps(perform(trial).row))
        assert (here.spec, here.status) == (row["spec"], row["status"])
        np.testing.assert_array_equal(here.T_exact.as_matrix(), row["T_exact"])
        np.testing.assert_array_equal(here.bounds, row["bounds"])
        if here.T_estimated is not None:
            np.testing.assert_array_equal(here.T_estimated.as_matrix(), row["T_estimated"])


def always_dies(*_: object) -> None:
    raise RuntimeError("it died")


def test_a_run_of_which_every_trial_dies_still_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    method = "methods=[{name: 'test_random_pairs_command:always_dies'}]"
    out = tmp_path / "out"
    command = [str(CONFIG), "--out", str(out), *SMALL, "--set", method, "--workers", "1"]
    assert main(command) == 1
    assert "it died" in capsys.readouterr().out
    assert "it died" in (out / "tables" / "statuses.md").read_text(encoding="utf-8")
