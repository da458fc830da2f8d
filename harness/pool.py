"""Where trials are performed: worker processes on this machine, or those of a Dask cluster."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker

from harness.supervise import Workers
from harness.threads import limit_threads

MakeExecutor = Callable[[], Executor]


def start_server() -> None:
    """Begin to import, in the background, what the workers need; a later call does nothing."""
    limit_threads()
    multiprocessing.get_context("forkserver").set_forkserver_preload(["harness.preload"])
    resource_tracker.ensure_running()  # it would lift the block below
    # Ctrl-C reaches every process of the terminal, and the server does not expect it as it imports.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
