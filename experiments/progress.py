"""What the command shows while trials end: how many, how fast, how well, and what went wrong."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from experiments.terminal import outcome, trial_name
from harness.scoring.poses import COARSE
from harness.workers.runner import Done

# A line a trial where nobody watches a bar; of more trials, one now and then.
MOST_LINES = 500
EVERY_S = 10.0
SHOWN_ERRORS = 20
WIDE = 118  # columns of a terminal that hold the words in full, beside the bar


class Tally:
    """Counts what came of the tasks of a run; it does not grow with them."""

    def __init__(self, total: int) -> None:
        self.total = total
        self.ended = self.computed = self.right = self.unanswered = self.errors = self.undrawn = 0
        self.first_errors: list[str] = []
        self._start = time.perf_counter()

    def count(self, done: Done) -> None:
        """Count one task."""
        self.ended += 1
        self.undrawn += bool(done.drawing_error)
        if not done.task.keep:
            return
        row = done.row
        self.computed += 1
        self.right += row.right
        self.unanswered += row.status not in ("ok", "error")
        if row.status == "error":
            self.errors += 1
            if len(self.first_errors) < SHOWN_ERRORS:
                self.first_errors.append(f"trial {row.id}: {row.reason}")

    @property
    def per_s(self) -> float:
        """Tasks that ended in a second, on average so far."""
        return self.ended / max(time.perf_counter() - self._start, 1e-6)

    @property
    def short(self) -> str:
        """The same in as few words as a narrow terminal needs."""
        right = f"{self.right / self.computed:.0%} right, " if self.computed else ""
        return f"{self.per_s:.3g}/s, {right}{self.unanswered} unanswered, {self.errors} errors"

    def __str__(self) -> str:
        """How fast and how well it goes."""
        parts = [f"{self.per_s:.3g} trials/s"]
        if self.computed:
            parts.append(f"{self.right / self.computed:.0%} within {COARSE}")
        parts.append(f"{self.unanswered} without an answer, {self.errors} errors")
        return ", ".join(parts)


class Reporter:
    """Tells of every task that ended: a bar on a terminal, lines elsewhere."""

    def __init__(self, console: Console, progress: Progress | None, tally: Tally) -> None:
        self._console, self._progress, self._tally = console, progress, tally
        self._bar = None if progress is None else progress.add_task("", total=tally.total)
        self._told = time.perf_counter()

    def tell(self, done: Done) -> None:
        """Report one task."""
        tally = self._tally
        tally.count(done)
        if self._progress is not None and self._bar is not None:
            told = str(tally) if self._console.width >= WIDE else tally.short
            self._progress.update(self._bar, advance=1, description=told)
        elif tally.total <= MOST_LINES:
            name = trial_name(done.task.trial)
            what = outcome(done.row) if done.task.keep else "figures"
            self._line(f"{name}: {what}")
        elif time.perf_counter() - self._told > EVERY_S or tally.ended == tally.total:
            self._told = time.perf_counter()
            left_s = (tally.total - tally.ended) / tally.per_s
            self._line(f"{tally}; {duration(left_s)} left")
        if done.drawing_error:
            self._console.print(f"figures of {trial_name(done.task.trial)}: {done.drawing_error}")

    def _line(self, text: str) -> None:
        counted = f"[{self._tally.ended}/{self._tally.total}] {text}"
        self._console.print(counted, soft_wrap=True)


@contextmanager
def reporting(console: Console, tally: Tally) -> Iterator[Reporter]:
    """A reporter for so many tasks."""
    if not console.is_terminal or tally.total == 0:
        yield Reporter(console, None, tally)
        return
    # The bar gives way first: the numbers are what one wants to know.
    counts = Column(no_wrap=True, min_width=2 * len(str(tally.total)) + 1)
    columns = (
        BarColumn(bar_width=None, table_column=Column(ratio=1)),
        MofNCompleteColumn(table_column=counts),
        TimeRemainingColumn(compact=True, table_column=Column(no_wrap=True, min_width=5)),
        TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True)),
    )
    with Progress(*columns, console=console, transient=True, expand=True) as progress:
        yield Reporter(console, progress, tally)


def duration(seconds: float) -> str:
    """A time as one says it."""
    if seconds < 1.0:
        return "under 1 s"
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 100:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
