"""Runs the trials that are missing on several processes and keeps each row as it comes."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from harness.pool import MakeExecutor
from harness.store import Row, Store
from harness.trials import Trial


@dataclass(frozen=True)
class Task:
    """A trial to perform, whether its row is wanted, and what to draw of it.

    pictures: folder for the pair's figures, or None. clouds: folder for its PLY files, or None.
    records: folder for what the report shows of it in 3D, or None.
    """

    trial: Trial
    keep: bool
    pictures: Path | None = None
    clouds: Path | None = None
    records: Path | None = None


@dataclass(frozen=True)
class Done:
    """What came of a task: its row, the files written, and what went wrong while drawing."""

    task: Task
    row: Row
    files: tuple[Path, ...] = ()
    drawing_error: str = ""


def work(task: Task) -> Done:
    """Perform one task; runs in a worker."""
    from harness.execution import perform

    outcome = perform(task.trial)
    files: list[Path] = []
    try:
        if outcome.pair is not None and task.pictures is not None:
            from harness.figures import draw_pair

            files += draw_pair(outcome.pair, task.pictures)
        if outcome.pair is not None and task.clouds is not None:
            from harness.clouds import write_clouds

            files += write_clouds(outcome.pair, task.clouds)
        if outcome.pair is not None and task.records is not None:
            from harness.report.records import keep

            files += keep(outcome.pair, task.trial, task.records, task.pictures is not None)
    except Exception as error:
        problem = f"{type(error).__name__}: {error}".splitlines()[0]
        return Done(task, outcome.row, tuple(files), problem)
    return Done(task, outcome.row, tuple(files))


def run(
    tasks: Sequence[Task], store: Store, code: str, make_executor: MakeExecutor
) -> Iterator[Done]:
    """Perform the tasks, committing each row before it is handed on, in the order they end.

    make_executor: makes an executor of the concurrent.futures interface; called again when a
        worker process died. Whoever stops consuming, stops the run; what was handed on is kept.
    """
    waiting = deque(tasks)
    suspects: deque[Task] = deque()
    while waiting or suspects:
        alone = bool(suspects)
        queue = suspects if alone else waiting
        with _shutting_down(make_executor()) as executor:
            running: dict[Future[Done], Task] = {}
            try:
                while queue or running:
                    # Few ahead of the workers: a stop loses little, and a death suspects few.
                    while queue and len(running) < (1 if alone else 8):
                        task = queue.popleft()
                        running[executor.submit(work, task)] = task
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        done = future.result()
                        del running[future]
                        if done.task.keep:
                            store.add(done.row, code)
                        yield done
            except BrokenProcessPool:
                # One of these killed its process. Alone in a new pool, the guilty one shows.
                if not alone:
                    suspects.extend(running.values())
                    continue
                (task,) = running.values()
                spec = task.trial.spec.text
                reason = "its process died, as by a lack of memory or a crash in a library"
                row = Row(task.trial.id, spec, "error", reason=reason)
                if task.keep:
                    store.add(row, code)
                yield Done(task, row)


@contextmanager
def _shutting_down(executor: Executor) -> Iterator[Executor]:
    """Close an executor in the end; at once, without its pending work, when something is raised."""
    try:
        yield executor
    except BaseException:
        processes = list((getattr(executor, "_processes", None) or {}).values())
        executor.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        raise
    executor.shutdown()
