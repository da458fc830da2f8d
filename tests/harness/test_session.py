"""Requests on a results folder that holds rows of another configuration."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import pandas as pd
import pytest

from experiments.commands import export, run_all
from harness.session import open_session, plan, report
from harness.store import Row, Store, StoreError, load
from harness.workers.cluster import ClusterError

OTHER = ["scan.step_mm=20"]


@pytest.fixture
def ran(small_file: Path, tmp_path: Path) -> Path:
    """A results folder with rows of two of four trials."""
    session = open_session(small_file, tmp_path / "ran")
    with Store(session.folder) as store:
        store.begin(session.trials)
        store.add_all([Row(trial.id, "{}", "failed") for trial in session.trials[:2]], "code")
    (session.folder / "config.yaml").write_text("as it was", encoding="utf-8")
    return session.folder


def unchanged(folder: Path) -> bool:
    same = (folder / "config.yaml").read_text(encoding="utf-8") == "as it was"
    return same and len(load(folder)) == 2


def test_redrawing_without_any_row_changes_nothing(
    small_file: Path, ran: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(StoreError, match="has no row of this configuration; run it first"):
        run_all(open_session(small_file, ran, OTHER), 1, redraw=True)
    assert capsys.readouterr().out == ""
    assert unchanged(ran)


def test_redrawing_reuses_the_rows_that_are_there(small_file: Path, ran: Path) -> None:
    session = open_session(small_file, ran)
    with Store(ran) as store:
        planned = plan(session, store, redraw=True)
    assert (planned.missing, planned.reused, planned.outdated) == (0, 2, 2)


def test_a_scheduler_that_is_not_there_changes_nothing(
    small_file: Path, ran: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreachable(_: str) -> NoReturn:
        raise ClusterError("no scheduler answers")

    monkeypatch.setattr("experiments.commands.cluster_pool", unreachable)
    for folder in (ran, tmp_path / "new"):
        with pytest.raises(ClusterError):
            run_all(open_session(small_file, folder, OTHER), 1, redraw=False, scheduler="tcp://x")
    assert unchanged(ran)
    assert not (tmp_path / "new").exists()


def test_only_rows_of_the_configuration_are_exported(
    small_file: Path, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rows.csv"
    with pytest.raises(StoreError, match="has no row of this configuration; run it first"):
        export(open_session(small_file, ran, OTHER), file)
    assert not file.exists()
    assert export(open_session(small_file, ran), file) == 0
    assert capsys.readouterr().out == f"{file}: 2 rows, 2 different trials have none\n"
    with Store(ran) as store:
        rest = open_session(small_file, ran).trials[2:]
        store.add_all([Row(trial.id, "{}", "ok") for trial in rest], "code")
        store.begin(open_session(small_file, ran).trials)
    few = open_session(small_file, ran, ["repeats=1"])
    assert export(few, file) == 0
    assert capsys.readouterr().out == f"{file}: {len(few.trials)} rows\n"
    assert list(pd.read_csv(file)["id"]) == [trial.id for trial in few.trials]


def test_figures_of_what_is_no_longer_asked_for_go(small_file: Path, ran: Path) -> None:
    figures = ran / "figures"
    figures.mkdir()
    stay = "study_b_thesis_1_planes.png"  # of a pair that is called so
    for name in ("study_overlap.png", "random_bound.png", stay):
        (figures / name).touch()
    report(open_session(small_file, ran))
    assert [file.name for file in figures.iterdir()] == [stay]
