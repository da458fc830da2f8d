"""Worker processes that start at once: forked from a server that has imported everything."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import forkserver

from harness.threads import limit_threads

MakeExecutor = Callable[[], Executor]


def start_server() -> None:
    """Begin to import, in the background, what the workers need; a later call does nothing."""
    limit_threads()
    multiprocessing.get_context("forkserver").set_forkserver_preload(["harness.preload"])
    forkserver.ensure_running()


def process_pool(workers: int) -> MakeExecutor:
    """What makes a pool of so many processes, each of one thread."""
    start_server()
    context = multiprocessing.get_context("forkserver")
    return lambda: ProcessPoolExecutor(workers, mp_context=context, initializer=_ignore_interrupts)


def _ignore_interrupts() -> None:
    """Ctrl-C reaches every process of the terminal; the main one decides what happens."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
