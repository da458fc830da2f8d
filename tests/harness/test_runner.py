from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from harness.pool import process_pool
from harness.runner import Task, run
from harness.session import execute, open_session, plan
from harness.store import Store, load

MIXED = (
    "methods=[{name: 'own_methods:give_up'}, {name: 'own_methods:die'}, "
    "{name: 'own_methods:crash'}]"
)


def test_a_process_that_dies_costs_its_own_row_only(small_file: Path, tmp_path: Path) -> None:
    session = open_session(small_file, tmp_path / "run", [MIXED, "repeats=1", "scan.profiles=8"])
    with Store(session.folder) as store:
        store.begin(session.trials)
        tasks = [Task(trial, keep=True) for trial in session.trials]
        done = list(run(tasks, store, session.code, process_pool(2)))
    assert len(done) == len(session.trials)
    rows = load(session.folder).set_index("method")
    assert set(rows.loc["own_methods:give_up", "status"]) == {"failed"}
    assert set(rows.loc["own_methods:die", "reason"]) == {
        "its process died twice (exit status 3), as by a lack of memory or a crash in a library"
    }
    assert set(rows.loc["own_methods:crash", "reason"]) == {"ZeroDivisionError: a bug"}


def test_a_run_that_stops_keeps_its_rows_and_goes_on(small_file: Path, tmp_path: Path) -> None:
    session = open_session(
        small_file, tmp_path / "run", ["methods=[{name: 'own_methods:give_up'}]", "repeats=3"]
    )
    with Store(session.folder) as store:
        first = plan(session, store)
        assert (first.missing, first.reused) == (6, 0)
        going = execute(session, store, first, lambda: ThreadPoolExecutor(1))
        for _ in range(2):
            next(going)
        going.close()
        second = plan(session, store)
        assert second.missing + second.reused == 6
        assert second.reused >= 2
        computed = [d.row.id for d in execute(session, store, second, lambda: ThreadPoolExecutor(1))
                    if d.task.keep]  # fmt: skip
        assert len(computed) == second.missing
        assert plan(session, store).missing == 0


def test_errors_are_computed_again(small_file: Path, tmp_path: Path) -> None:
    session = open_session(
        small_file, tmp_path / "run", ["methods=[{name: 'own_methods:crash'}]", "repeats=1"]
    )
    with Store(session.folder) as store:
        done = list(execute(session, store, plan(session, store), lambda: ThreadPoolExecutor(1)))
        assert {d.row.status for d in done} == {"error"}
        assert plan(session, store).missing == 2


@pytest.mark.parametrize("seed", ["seed=5", "scan.step_mm=4"])
def test_another_configuration_shares_no_row(small_file: Path, tmp_path: Path, seed: str) -> None:
    overrides = ["methods=[{name: 'own_methods:give_up'}]", "repeats=1"]
    session = open_session(small_file, tmp_path / "run", overrides)
    changed = open_session(small_file, tmp_path / "run", [*overrides, seed])
    with Store(session.folder) as store:
        for _ in execute(session, store, plan(session, store), lambda: ThreadPoolExecutor(1)):
            pass
        assert plan(changed, store).missing == 2
        assert plan(session, store).missing == 0
