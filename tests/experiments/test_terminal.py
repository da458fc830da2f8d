from __future__ import annotations

import io
from pathlib import Path

import pandas as pd
import pytest
from rich.console import Console

from experiments.progress import Tally, reporting
from experiments.terminal import SHOWN_ROWS, show_tables
from harness.config.reading import load_experiment
from harness.store import Row
from harness.tables.table import Table
from harness.trials.specs import Trial, build_trials
from harness.workers.child import Task
from harness.workers.runner import Done


@pytest.fixture
def small_trial() -> Trial:
    file = Path(__file__).parents[2] / "configs" / "desk.yaml"
    return build_trials(load_experiment(file), file)[0]


@pytest.mark.parametrize("in_full", [False, True])
def test_only_lists_are_cut_and_say_so(in_full: bool) -> None:
    names = [f"row{i:02d}" for i in range(SHOWN_ROWS + 2)]
    page = io.StringIO()
    table = Table("t", "Title", "Caption.", pd.DataFrame({"Name": names}), in_full=in_full)
    show_tables(Console(file=page, width=160), [table])
    shown = [name for name in names if name in page.getvalue()]
    assert shown == (names if in_full else names[:SHOWN_ROWS])
    cut = f"The first {SHOWN_ROWS} of {SHOWN_ROWS + 2}." in " ".join(page.getvalue().split())
    assert cut != in_full


@pytest.mark.parametrize("width", [80, 120])
def test_the_bar_gives_way_before_the_numbers_do(width: int, small_trial: Trial) -> None:
    page = io.StringIO()
    console = Console(file=page, width=width, force_terminal=True, color_system=None)
    row = Row(small_trial.id, small_trial.spec.text, "failed")
    with reporting(console, Tally(100_000)) as reporter:
        for _ in range(3):
            reporter.tell(Done(Task(small_trial, keep=True), row))
    last = page.getvalue().replace("\r", "\n").split("\n")
    told = next(line for line in reversed(last) if "errors" in line)
    assert "3/100000" in told
    assert "3 unanswered, 0 errors" in told or "3 without an answer, 0 errors" in told
    assert "\N{HORIZONTAL ELLIPSIS}" not in told
