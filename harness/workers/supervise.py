"""Keeps a worker process at work: a trial that kills it, or never ends, costs that trial alone.

Runs in a thread for each worker process, here or on a machine of a cluster.
"""

from __future__ import annotations

import multiprocessing
import os
import platform
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

from harness.config.limits import NO_LIMITS, Limits
from harness.provenance import Sources
from harness.store import Row
from harness.workers.child import Drawn, Task, loaded_code, serve
from harness.workers.cluster import OtherCodeError

T = TypeVar("T")

NO_DRAWING = Drawn()
# Whoever kills a worker from outside should not blame the trial; one that dies twice is guilty.
CHANCES = 2


@dataclass(frozen=True)
class Ended:
    """What came of a task: its row, the seconds it took, and what was drawn."""

    row: Row
    seconds: float
    drawn: Drawn = NO_DRAWING


@dataclass(frozen=True)
class Origin:
    """The code that is to compute rows: its fingerprint, and what that is made of."""

    code: str
    sources: Sources


class Stopped(RuntimeError):  # noqa: N818  # not a mistake of anybody
    """The run was stopped; nothing more is worth doing."""


class _Gone(Exception):  # noqa: N818
    """A worker process that is no more; the message says why."""

    def __init__(self, reason: str, guilty: bool) -> None:
        super().__init__(reason)
        self.guilty = guilty


class _Child:
    """A worker process and the connection to it."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.origin: Origin | None = None  # what its code is known to be
        if multiprocessing.current_process().daemon:
            # A worker of Dask's nanny is one, for no more than that its parent ends it, and such a
            # process may start none; ours end by themselves when it does.
            multiprocessing.current_process().daemon = False
        context = multiprocessing.get_context("forkserver")
        self._connection, far_end = context.Pipe()
        self._process = context.Process(target=serve, args=(far_end, limits), daemon=True)
        self._process.start()
        far_end.close()
        self.receive(None)

    def send(self, asked: Any) -> None:
        try:
            self._connection.send(asked)
        except (BrokenPipeError, ConnectionResetError):
            raise self._gone() from None

    def receive(self, within_s: float | None) -> Any:
        """The next answer; raises _Gone when the process died or took longer."""
        try:
            if not self._connection.poll(within_s):
                raise _Gone(f"did not end within {within_s:g} s and was killed", guilty=True)
            return self._connection.recv()
        except (EOFError, OSError):
            raise self._gone() from None

    def kill(self) -> None:
        self._process.kill()

    def close(self) -> None:
        """End the process; it ends by itself when the connection closes, unless it is at work."""
        self._connection.close()
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _gone(self) -> _Gone:
        self._process.join(5.0)
        code = self._process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"
        return _Gone(
            f"its process died twice ({how}), as by a lack of memory or a crash in a library",
            guilty=False,
        )


class Workers(ThreadPoolExecutor):
    """So many worker processes as an executor; its threads only wait for their processes."""

    def __init__(self, workers: int) -> None:
        self.slots = workers
        self.children: set[_Child] = set()
        self.stopped = False
        super().__init__(workers, "worker", initializer=_join, initargs=(self,))

    def submit(self, function: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        """Call a function in a worker process; perform_all is what asks it itself."""
        if function is perform_all:
            return super().submit(function, *arguments, **named)
        return super().submit(_in_child, function, arguments, named)

    def stop(self) -> None:
        """Kill the processes and drop what waits."""
        self.stopped = True
        for child in list(self.children):
            child.kill()
        self.shutdown(wait=True, cancel_futures=True)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the threads and their processes."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        while self.children:
            self.children.pop().close()


class _Here(threading.local):
    """The worker process of a thread, and the pool the thread belongs to, if it does."""

    child: _Child | None = None
    pool: Workers | None = None


_here = _Here()


def _join(pool: Workers) -> None:
    _here.pool = pool


def perform_all(
    tasks: Sequence[Task], limits: Limits = NO_LIMITS, origin: Origin | None = None
) -> list[Ended]:
    """Perform tasks in this thread's worker process; a trial that ends it becomes an error row.

    origin: the code that is to perform them, if that matters. Raises OtherCodeError.
    """
    ended: list[Ended] = []
    waiting = deque(tasks)
    chances = CHANCES
    while waiting:
        try:
            child = _child(limits) if origin is None else _child_of(origin, limits)
            child.send(list(waiting))
            while waiting:
                row, seconds = child.receive(limits.trial_s)
                drawn = child.receive(None) if waiting[0].leaves_files else NO_DRAWING
                ended.append(Ended(row, seconds, drawn))
                waiting.popleft()
                chances = CHANCES
        except _Gone as gone:
            _drop_child()
            chances -= 1
            if gone.guilty or chances == 0:
                trial = waiting.popleft().trial
                row = Row(trial.id, trial.spec.text, "error", reason=str(gone))
                ended.append(Ended(row, limits.trial_s or 0.0))
                chances = CHANCES
    return ended


def _child_of(origin: Origin, limits: Limits) -> _Child:
    """This thread's worker process, a new one where it has imported older code than that.

    On a cluster both outlive the run; a method of the user's own may change in between.
    """
    for _ in range(2):
        child = _child(limits)
        if child.origin == origin:
            return child
        child.send((loaded_code, (origin.sources,), {}))
        good, found = child.receive(None)
        if good and found == origin.code:
            child.origin = origin
            return child
        _drop_child()
    raise OtherCodeError(
        f"a worker on {platform.node()} has other code than this run"
        f"{'' if good else f' ({found})'}; the rows so far are kept: start the workers anew, with "
        "the same files and libraries, then give the same command again"
    )


def _in_child(function: Callable[..., T], arguments: tuple[Any, ...], named: dict[str, Any]) -> T:
    """Call a function in this thread's worker process; raises what it raises."""
    try:
        child = _child(_here.child.limits if _here.child else NO_LIMITS)
        child.send((function, arguments, named))
        good, result = child.receive(None)
    except _Gone as gone:
        _drop_child()
        raise RuntimeError(f"{getattr(function, '__name__', function)}: {gone}") from None
    if not good:
        raise result
    answer: T = result
    return answer


def _child(limits: Limits) -> _Child:
    """This thread's worker process, a new one where there is none with these limits."""
    if _here.pool is not None and _here.pool.stopped:
        raise Stopped
    if _here.child is not None and _here.child.limits != limits:
        _drop_child()
    if _here.child is None:
        if os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())  # for methods of the user's own, on a cluster too
        _here.child = _Child(limits)
        if _here.pool is not None:
            _here.pool.children.add(_here.child)
            if _here.pool.stopped:  # meanwhile
                _here.child.kill()
    return _here.child


def _drop_child() -> None:
    child, _here.child = _here.child, None
    if child is not None:
        child.kill()
        child.close()
        if _here.pool is not None:
            _here.pool.children.discard(child)
    if _here.pool is not None and _here.pool.stopped:
        raise Stopped
