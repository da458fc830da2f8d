from __future__ import annotations

import itertools
import tracemalloc
from pathlib import Path

import pytest

from experiments.rehearsal import size_of
from harness.config.errors import ConfigError
from harness.session import open_session, plan
from harness.store import Store
from harness.trials.lazy import Lazy

REPEATS = 4000


def test_a_lazy_sequence_is_one() -> None:
    squares = Lazy(5, lambda index: index**2)
    assert list(squares) == list(squares) == [0, 1, 4, 9, 16]
    assert (squares[1], squares[-1], len(squares)) == (1, 16, 5)
    assert list(squares[1:4]) == [1, 4, 9]
    assert list(squares[::-2]) == [16, 4, 0]
    assert list(reversed(squares)) == [16, 9, 4, 1, 0]
    assert 9 in squares
    with pytest.raises(IndexError):
        squares[5]


def test_memory_does_not_grow_with_the_trials(small_file: Path, tmp_path: Path) -> None:
    def most_bytes(repeats: int) -> float:
        tracemalloc.start()
        session = open_session(
            small_file, tmp_path / str(repeats),
            ["methods=[{name: thesis}]", f"repeats={repeats}", "sweep.over={scan.step_mm: [4, 5]}"],
        )  # fmt: skip
        with Store(session.folder) as store:
            planned = plan(session, store)
            assert len({task.trial.id for task in planned.tasks[:3]}) == 3
            assert planned.missing == len(planned.tasks) == len(session.trials)
            for _ in planned.tasks:
                pass
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    most_bytes(1)  # what is imported and kept
    few, many = most_bytes(10), most_bytes(REPEATS)
    # A number for the scans of each trial and its place are kept, no more.
    assert many - few < 100 * 2 * REPEATS


def test_a_rehearsal_counts_without_keeping_the_trials(small_file: Path) -> None:
    def most_bytes(repeats: int) -> float:
        # The parameter changes nothing of the second method, whose trials are the same everywhere.
        key = "methods.a.params.segments.warp_mm"
        methods = "methods=[{name: thesis, label: a}, {name: thesis, label: b}]"
        overrides = [methods, f"repeats={repeats}", f"sweep.over={{{key}: [4.1, 5.1, 6.1]}}"]
        trials = open_session(small_file, None, overrides).trials
        tracemalloc.start()
        assert size_of(trials) == (3, 2 * (3 + 1) * repeats, 2 * repeats)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    most_bytes(1)
    assert most_bytes(1000) - most_bytes(10) < 100 * 12 * 1000


def test_a_wrong_value_at_the_last_point_is_told_before_the_first(
    small_file: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"point 3 .*scan.step_mm=-1"):
        open_session(
            small_file, tmp_path / "out", ["repeats=2", "sweep.over={scan.step_mm: [4, 5, 6, -1]}"]
        )
    assert not (tmp_path / "out").exists()


def test_tasks_that_share_their_scans_stand_together(small_file: Path, tmp_path: Path) -> None:
    sweep = "sweep.over={methods.thesis.params.segments.warp_mm: [3, 4, 5]}"
    session = open_session(
        small_file, tmp_path / "out", ["methods=[{name: thesis}]", "repeats=2", sweep]
    )
    with Store(session.folder) as store:
        keys = [task.trial.spec.scan_key for task in plan(session, store).tasks]
    turns = sum(one != other for one, other in itertools.pairwise(keys))
    assert turns == len(set(keys)) - 1
