"""Every config by the command itself, small."""

from __future__ import annotations

import contextlib
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.cli import main
from harness.config.reading import load_experiment, read_mapping
from harness.store import load
from sensors.calibration import PUBLISHED

ROOT = Path(__file__).parents[2]
# Those that make trials; an `experiment:` of its own, as precision.yaml, has tests of its own.
CONFIGS = [
    file
    for file in sorted((ROOT / "configs").glob("*.yaml"))
    if "experiment" not in read_mapping(file)
]
DESK = ROOT / "configs" / "desk.yaml"
SMALL = ["--set", "scan.profiles=24", "--set", "repeats=1"]
PLAIN = ["--set", "methods=[{name: thesis, figures: false}]"]
ONE_PAIR = """\
title: Plates seen twice
scene: {name: separated_planes}
sensor: {name: jupiter}
scan: {profiles: 40, step_mm: 5.0}
views:
  left: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: -8}
  right: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: 8}
pairs:
  plates: {source: left, target: right}
methods:
  - {name: thesis}
"""


def rows_of(folder: Path) -> list[tuple[object, ...]]:
    """The rows as SQLite holds them, without their times."""
    with contextlib.closing(
        sqlite3.connect(f"file:{folder}/trials.sqlite?mode=ro", uri=True)
    ) as connection:
        query = "SELECT * FROM whole_rows ORDER BY id"
        return connection.execute(query).fetchall()


@pytest.mark.parametrize("file", CONFIGS, ids=lambda file: file.stem)
def test_every_config_runs_and_its_results_are_whole(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    experiment = load_experiment(file)
    undrawn = [f"methods.{i}.figures=false" for i in range(len(experiment.methods))]
    if getattr(experiment.scan, "low_mm", None) is None:
        options = [str(file), "--out", str(out), *SMALL]
    else:  # the heights between which the line runs tell the number of profiles
        heights = ["--set", "scan.low_mm=520", "--set", "scan.high_mm=589"]
        options = [str(file), "--out", str(out), "--set", "repeats=1", *heights]
    options += [argument for override in undrawn for argument in ("--set", override)]
    assert main(options) == 0
    shown = capsys.readouterr().out
    rows = load(out)
    assert not (rows["status"] == "error").any()
    assert len(rows)
    assert all(str(pair) in shown for pair in rows["pair"])
    for pair, method in rows[["pair", "method"]].drop_duplicates().itertuples(index=False):
        name = f"table_{pair}_{method.replace(' ', '_')}"
        for ending in ("csv", "md", "tex"):
            assert (out / "tables" / f"{name}.{ending}").stat().st_size > 200
    assert len(pd.read_csv(out / "tables" / "timings.csv")) >= 3
    assert len(pd.read_csv(out / "tables" / "sensor_card.csv")) == len(PUBLISHED)
    assert (out / "config.yaml").exists()
    assert (out / "run.json").exists()
    assert "Written:" in shown

    before = rows_of(out)
    assert main(options) == 0
    assert f"0 trials computed, {len(rows)} reused" in capsys.readouterr().out
    assert rows_of(out) == before


def test_rows_do_not_depend_on_the_workers(tmp_path: Path) -> None:
    for workers in ("1", "2"):
        folder = tmp_path / workers
        options = ["--out", str(folder), "--workers", workers, "--set", "scan.profiles=40"]
        given = "methods=[{name: thesis, given: [patches, rotation], figures: false}]"
        assert main([str(DESK), "--set", "repeats=2", "--set", given, *options]) == 0
    one, two = (rows_of(tmp_path / workers) for workers in ("1", "2"))
    assert len(one) > 8
    assert one == two


def test_a_row_is_replayed_by_its_id(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    options = [str(DESK), "--out", str(out), *PLAIN, "--set", "repeats=1"]
    assert main(options) == 0
    for row in load(out).to_dict("records"):
        capsys.readouterr()
        before = rows_of(out)
        assert main([*options, "--trial", row["id"][:9]]) == 0
        told = capsys.readouterr().out
        assert row["id"] in told
        assert f"{row['estimated_y_mm']:.2f}" in told
        assert f"{row['rotation_error_deg']:.3f} deg" in told
        assert rows_of(out) == before


def test_another_seed_gives_other_scans(tmp_path: Path) -> None:
    for seed in ("0", "1"):
        options = ["--out", str(tmp_path / seed), "--seed", seed]
        assert main([str(DESK), *PLAIN, *options, *SMALL]) == 0
    first, second = (load(tmp_path / seed) for seed in ("0", "1"))
    assert set(first["id"]).isdisjoint(second["id"])
    # Each joint comes to rest elsewhere within its count: nearly the same poses.
    np.testing.assert_allclose(first["exact_y_mm"], second["exact_y_mm"], atol=0.1)
    assert not (first["exact_y_mm"] == second["exact_y_mm"]).any()
    assert (first["n_patches_target"] >= 0).all()


def test_report_only_builds_the_files_again(tmp_path: Path) -> None:
    out = tmp_path / "out"
    file = tmp_path / "one_pair.yaml"
    file.write_text(ONE_PAIR, encoding="utf-8")
    options = [str(file), "--out", str(out)]
    assert main(options) == 0
    rows = rows_of(out)

    def built() -> dict[str, bytes]:
        return {
            str(path.relative_to(out)): path.read_bytes()
            for folder in ("tables", "scans")
            for path in (out / folder).iterdir()
        }

    before, pictures = built(), {path.name for path in (out / "figures").iterdir()}
    for folder in ("tables", "scans", "figures"):
        for path in (out / folder).iterdir():
            path.unlink()
    assert main([*options, "--report-only"]) == 0
    assert built() == before
    assert {path.name for path in (out / "figures").iterdir()} == pictures
    assert rows_of(out) == rows


def test_an_interrupted_run_keeps_its_rows_and_goes_on(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [
        sys.executable, "-m", "experiments.cli", str(DESK), "--out", str(out), "--workers", "1",
        "--set", "repeats=400", *PLAIN, "--set", "scan.profiles=24",
    ]  # fmt: skip
    # A shell without job control starts what it puts in the background with SIGINT ignored.
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            with contextlib.suppress(sqlite3.OperationalError):  # no file or no table yet
                if len(rows_of(out)) >= 3:
                    break
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Interrupted: " in told
    assert "Traceback" not in told
    kept = rows_of(out)
    assert 3 <= len(kept) < 800
    overrides = [o for o in command[4:] if o not in ("--workers", "1")]
    repeats = [o.replace("repeats=400", "repeats=3") for o in overrides]
    assert main([str(DESK), *repeats[repeats.index("--out") :]]) == 0
    again = {row[0]: row for row in rows_of(out)}
    assert all(again[row[0]] == row for row in kept)
    reused = set(load(out)["id"]) & {row[0] for row in kept}
    assert len(reused) >= 3


def test_views_that_share_nothing_are_told_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    options = ["--set", "rotation_labels=printed", "--set", "repeats=1", *PLAIN]
    assert main([str(DESK), "--out", str(out), *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = [line for line in lines if line.startswith("Pair 6.5 was not registered")]
    assert "overlap by 0%" in line
    rows = load(out)
    assert set(rows.loc[rows["pair"] == "6.5", "status"]) == {"no_overlap"}
    assert rows.loc[rows["pair"] == "6.5", "T_estimated"].isna().all()
