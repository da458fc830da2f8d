"""Where trials are performed: processes on this machine, or whatever else is an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from harness.workers.fork_server import start_server
from harness.workers.supervise import Workers

MakeExecutor = Callable[[], Executor]


def process_pool(workers: int) -> MakeExecutor:
    """What makes a pool of so many processes, each of one thread."""
    start_server()
    return lambda: Workers(workers)


def slots_of(executor: Executor) -> int:
    """How many trials an executor performs at once."""
    slots: int = getattr(executor, "slots", 0) or getattr(executor, "_max_workers", 1)
    return slots


@contextmanager
def shutting_down(executor: Executor) -> Iterator[Executor]:
    """Close an executor in the end; at once, without its pending work, when something is raised."""
    try:
        yield executor
    except BaseException:
        stop = getattr(executor, "stop", None)
        if stop is None:
            executor.shutdown(wait=False, cancel_futures=True)
        else:
            stop()
        raise
    executor.shutdown()
