"""Drivers that begin at once: each is a fork of this process, which has imported everything.

Each line of standard input, `CONFIG OUT OVERRIDE`, starts one; its process id is the answer. It
runs like the command does, with threads in the place of worker processes.
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from harness.config.limits import Limits
from harness.execution import perform
from harness.session import execute, open_session, plan
from harness.store import Store
from harness.workers.supervise import Ended, Origin


class Threads(ThreadPoolExecutor):
    """Performs trials in this process."""

    slots = 4

    def submit(self, _, tasks, limits: Limits, origin: Origin) -> Future:
        return super().submit(self._perform, tasks)

    def _perform(self, tasks) -> list[Ended]:
        ended = []
        for task in tasks:
            start = time.perf_counter()
            row = perform(task.trial).row
            ended.append(Ended(row, time.perf_counter() - start))
        return ended


def drive(config: Path, out: Path, override: str) -> None:
    session = open_session(config, out, [override])
    with Store(out) as store:
        for _ in execute(session, store, plan(session, store), lambda: Threads(Threads.slots)):
            pass


def main() -> None:
    print("ready", flush=True)
    for line in sys.stdin:
        config, out, override = line.split()
        child = os.fork()
        if child == 0:
            drive(Path(config), Path(out), override)
            os._exit(0)
        print(child, flush=True)
        os.waitpid(child, 0)
        print("gone", flush=True)


if __name__ == "__main__":
    main()
