"""The process that workers are forked from, begun so early that it imports beside this one."""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing import forkserver, resource_tracker

from harness.workers.threads import limit_threads

TRIALS = ["harness.workers.preload"]
# They bring matplotlib, pandas and trimesh, which trials that are not drawn need not wait for.
DRAWING = ["harness.figures.pair", "harness.figures.overview"]


def start_server(draws: bool = True) -> None:
    """Begin to import, in the background, what the workers need; a later call does nothing.

    draws: whether pictures are made of the trials too.
    """
    limit_threads()
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(TRIALS + DRAWING if draws else TRIALS)
    resource_tracker.ensure_running()  # it would lift the block below
    # Ctrl-C reaches every process of the terminal, and the server does not expect it as it imports.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
