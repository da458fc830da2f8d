"""Cuts the tasks of a run into batches that are worth sending to a worker."""

from __future__ import annotations

from collections.abc import Sequence

from harness.workers.child import Task

TARGET_S = 0.4  # a batch takes; little is lost when the run is killed, and sending costs nothing
WHOLE = 4.0  # times that, to keep trials together that share their scans
WEIGHT = 0.3  # of a new measurement in the running mean


class Batches:
    """The tasks that wait, in an order in which those that share their scans stand together.

    Each is asked for as it is sent, so that they may be made then. How long a trial takes is learnt
    from those that ended, by method.
    """

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._waiting = len(tasks)
        self._tasks = iter(tasks)
        self._first = next(self._tasks, None)
        self._seconds: dict[str, float] = {}

    def __len__(self) -> int:
        return self._waiting

    def next(self, slots: int) -> list[Task]:
        """The next batch, of one task as long as nothing is known about its method.

        slots: workers there are; towards the end they share what is left.
        """
        most = max(1, self._waiting // (2 * slots))
        batch: list[Task] = []
        expected, begun = 0.0, False
        while self._first is not None and len(batch) < most:
            task = self._first
            seconds = self._seconds.get(task.trial.label)
            alone = seconds is None or task.draws
            limit = TARGET_S * (WHOLE if begun else 1.0)
            if batch and (alone or expected + (seconds or 0.0) > limit):
                break
            batch.append(task)
            expected += seconds or 0.0
            self._first = next(self._tasks, None)
            scans = task.trial.spec.scan_key
            begun = self._first is not None and self._first.trial.spec.scan_key == scans
            if alone:
                break
        self._waiting -= len(batch)
        return batch

    def learn(self, batch: Sequence[Task], seconds: Sequence[float]) -> None:
        """Note how long the trials of a batch took."""
        for task, took in zip(batch, seconds, strict=True):
            known = self._seconds.get(task.trial.label)
            mean = took if known is None else known + WEIGHT * (took - known)
            self._seconds[task.trial.label] = mean
