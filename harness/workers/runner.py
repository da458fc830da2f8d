"""Runs the trials that are missing on several processes and keeps each row as it comes."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path

from harness.config.limits import NO_LIMITS, Limits
from harness.provenance import Sources
from harness.store import Row, Store
from harness.workers.batches import Batches
from harness.workers.child import Task
from harness.workers.cluster import is_loss
from harness.workers.pool import MakeExecutor, shutting_down, slots_of
from harness.workers.supervise import Ended, Origin, perform_all

# Batches at a worker and on the way to it, so that it never waits for the next.
AHEAD = 2
# Times that a batch is sent out again when the machine that had it is lost.
ATTEMPTS = 3


@dataclass(frozen=True)
class Done:
    """What came of a task: its row, the files written, and what went wrong while drawing."""

    task: Task
    row: Row
    files: tuple[Path, ...] = ()
    drawing_error: str = ""


def run(
    tasks: Sequence[Task],
    store: Store,
    code: str,
    make_executor: MakeExecutor,
    limits: Limits = NO_LIMITS,
    sources: Sources | None = None,
) -> Iterator[Done]:
    """Perform the tasks, committing each row before it is handed on, in the order they end.

    make_executor: makes an executor of the concurrent.futures interface. Whoever stops consuming,
        stops the run; what was handed on is kept.
    sources: what `code` is made of, so that workers with other code are refused, by OtherCodeError.
    """
    origin = None if sources is None else Origin(code, sources)
    batches = Batches(tasks)
    again: deque[tuple[list[Task], int]] = deque()  # batches that were lost, and how often
    running: dict[Future[list[Ended]], tuple[list[Task], int]] = {}
    with shutting_down(make_executor()) as executor:
        while batches or again or running:
            while (batches or again) and len(running) < AHEAD * slots_of(executor):
                batch, lost = again.popleft() if again else (batches.next(slots_of(executor)), 0)
                running[executor.submit(perform_all, batch, limits, origin)] = batch, lost
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                batch, lost = running.pop(future)
                error = future.exception()
                if error is None:
                    ended = future.result()
                    batches.learn(batch, [each.seconds for each in ended])
                elif not is_loss(error):
                    raise error
                elif lost + 1 < ATTEMPTS:
                    again.append((batch, lost + 1))
                    continue
                else:
                    ended = [_lost(task) for task in batch]
                yield from _kept(batch, ended, store, code)


def _kept(batch: list[Task], ended: list[Ended], store: Store, code: str) -> Iterator[Done]:
    done = [
        Done(task, each.row, each.drawn.files, each.drawn.error)
        for task, each in zip(batch, ended, strict=True)
    ]
    store.add_all((each.row for each in done if each.task.keep), code)
    yield from done


def _lost(task: Task) -> Ended:
    trial = task.trial
    reason = f"{ATTEMPTS} machines that had it were lost"
    return Ended(Row(trial.id, trial.spec.text, "error", reason=reason), 0.0)
