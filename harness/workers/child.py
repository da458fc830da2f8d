"""What a worker process does: trials, one after the other, as they come through a connection."""

from __future__ import annotations

import ctypes
import functools
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from harness.config.limits import Limits
from harness.provenance import Sources, code_fingerprint
from harness.trials.specs import Trial

PR_SET_PDEATHSIG = 1  # of prctl


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

    @property
    def draws(self) -> bool:
        """Whether there is much to draw, which takes longer than the trial."""
        return self.pictures is not None or self.clouds is not None

    @property
    def leaves_files(self) -> bool:
        """Whether an answer about files follows the row."""
        return self.draws or self.records is not None


@dataclass(frozen=True)
class Drawn:
    """The files that were written of a trial, and what went wrong while drawing."""

    files: tuple[Path, ...] = ()
    error: str = ""


def serve(connection: Connection, limits: Limits) -> None:
    """Do what comes until the connection closes: lists of tasks, or a function and arguments.

    Of a task goes back its row with the seconds it took, then what was drawn of it if anything is;
    of a function its result or the exception that it raised.
    """
    # Ctrl-C reaches every process of the terminal; the main one decides what happens.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _die_with_the_run()
    if limits.worker_mb is not None:
        _limit_memory(limits.worker_mb)
    from harness.execution import perform

    try:
        connection.send(None)  # ready
        while True:
            asked = connection.recv()
            if isinstance(asked, list):
                for task in asked:
                    start = time.perf_counter()
                    outcome = perform(task.trial)
                    connection.send((outcome.row, time.perf_counter() - start))
                    if task.leaves_files:
                        connection.send(_draw(task, outcome.pair))
            else:
                connection.send(_call(*asked))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return  # nobody waits for an answer any more


def _draw(task: Task, pair: Any) -> Drawn:
    if pair is None:
        return Drawn()
    files: list[Path] = []
    try:
        if task.pictures is not None:
            from harness.figures.pair import draw_pair

            files += draw_pair(pair, task.pictures)
        if task.clouds is not None:
            from harness.figures.clouds import write_clouds

            files += write_clouds(pair, task.clouds)
        if task.records is not None:
            from harness.report.records import keep

            files += keep(pair, task.trial, task.records, task.pictures is not None)
    except Exception as error:
        return Drawn(tuple(files), f"{type(error).__name__}: {error}".splitlines()[0])
    return Drawn(tuple(files))


def _call(
    function: Callable[..., Any], arguments: Sequence[Any], named: dict[str, Any]
) -> tuple[bool, Any]:
    try:
        return True, function(*arguments, **named)
    except Exception as error:
        return False, error


@functools.cache  # what a process has imported stays, whatever becomes of the files
def loaded_code(sources: Sources) -> str:
    """The fingerprint of the code that this process computes with."""
    return code_fingerprint(*sources)


def _die_with_the_run() -> None:
    """A worker in the middle of an endless trial must not outlive its run (Linux only)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _limit_memory(worker_mb: int) -> None:
    """Let allocations beyond the limit fail, which is a MemoryError of the trial."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    taken = pages * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (taken + worker_mb * 2**20,) * 2)
