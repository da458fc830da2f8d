from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from harness.session import execute, open_session, plan
from harness.store import Store, load
from harness.workers.child import Task
from harness.workers.cluster import OtherCodeError
from harness.workers.pool import process_pool
from harness.workers.runner import run

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


class Lasting(ThreadPoolExecutor):
    """An executor whose workers outlive a run, as those of a cluster do."""

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        return


@pytest.fixture
def lasting() -> Iterator[Lasting]:
    executor = Lasting(1)
    yield executor
    ThreadPoolExecutor.shutdown(executor)


def test_a_worker_that_outlives_a_run_does_not_compute_with_older_code(
    small_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lasting: Lasting
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    method = tmp_path / "changing.py"
    text = """\
from registration import RegistrationResult

def give_up(target, source, params):
    return RegistrationResult(None, "failed", "version one")
"""
    for version in ("one", "two"):
        method.write_text(text.replace("version one", f"version {version}"), encoding="utf-8")
        session = open_session(
            small_file, tmp_path / "run", ["methods=[{name: 'changing:give_up'}]", "repeats=1"]
        )
        with Store(session.folder) as store:
            list(execute(session, store, plan(session, store), lambda: lasting))
        assert set(load(session.folder)["reason"]) == {f"version {version}"}


def test_workers_that_loaded_other_code_are_refused(
    small_file: Path, tmp_path: Path, lasting: Lasting
) -> None:
    session = open_session(small_file, tmp_path / "run")
    session = replace(session, code="0123456789abcdef")
    with Store(session.folder) as store:
        planned = plan(session, store)
        with pytest.raises(OtherCodeError, match="has other code than this run") as caught:
            list(execute(session, store, planned, lambda: lasting))
        assert "\n" not in str(caught.value)
        assert plan(session, store).missing == planned.missing


def test_a_run_starts_without_what_only_its_tables_need(small_file: Path, tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; import experiments.commands; "
        "from harness.session import open_session, plan; from harness.store.rows import Store\n"
        "session = open_session(Path(sys.argv[1]), Path(sys.argv[2]))\n"
        "with Store(session.folder) as store: plan(session, store)\n"
        "print({'pandas', 'matplotlib', 'scipy.stats'} & sys.modules.keys())"
    )
    command = [sys.executable, "-c", program, str(small_file), str(tmp_path / "run")]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "set()"
