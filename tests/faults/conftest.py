"""Real runs of the command in processes of their own, which tests may kill."""

from __future__ import annotations

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

CHEAP = """\
title: Three plates, seen twice
scene: {name: separated_planes}
sensor: {name: jupiter, params: {pixels: 256}}
scan: {profiles: 4, step_mm: 50.0}
views:
  left: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: -8, pitch_deg: 10}
  right: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: 8, pitch_deg: 10}
pairs:
  plates: {source: left, target: right}
methods:
  - {name: "slow_methods:slow", label: slow, figures: false, params: {s: 0.05}}
repeats: 60
"""


@pytest.fixture
def cheap(tmp_path: Path) -> Path:
    """A config whose trials take 50 ms, hardly any of it work."""
    file = tmp_path / "cheap.yaml"
    file.write_text(CHEAP, encoding="utf-8")
    return file


def command(config: Path, out: Path, *options: str) -> list[str]:
    """run-experiment, with the methods of this folder at hand."""
    return [sys.executable, "-m", "experiments.cli", str(config), "--out", str(out), *options]


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), str(ROOT)])}


def run(config: Path, out: Path, *options: str, **how: Any) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return subprocess.run(
        command(config, out, *options),
        capture_output=True, text=True, timeout=240, env=environment(), cwd=config.parent, **how,
    )  # fmt: skip


@pytest.fixture
def started() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start a process; whatever of it is left in the end is killed."""
    processes: list[subprocess.Popen[str]] = []

    def start(arguments: list[str], **how: Any) -> subprocess.Popen[str]:
        # A shell without job control starts what it puts in the background with SIGINT ignored.
        process = subprocess.Popen(
            arguments, start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment(), **how,
        )  # fmt: skip
        processes.append(process)
        return process

    yield start
    for process in processes:
        # By session: what a shell left in the background is no child of anything once it is gone.
        for other in psutil.pids():
            with contextlib.suppress(ProcessLookupError):
                if os.getsid(other) == process.pid:
                    os.kill(other, signal.SIGKILL)
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def rows_of(out: Path) -> list[tuple[object, ...]]:
    """The rows as SQLite holds them, without their times."""
    with contextlib.closing(
        sqlite3.connect(f"file:{out}/trials.sqlite?mode=ro", uri=True)
    ) as connection:
        query = "SELECT * FROM whole_rows ORDER BY id"
        return connection.execute(query).fetchall()


def count_of(out: Path) -> int:
    try:
        return len(rows_of(out))
    except sqlite3.OperationalError:  # no file or no table yet
        return 0


def wait_until(true: Callable[[], object], within_s: float = 60.0) -> None:
    deadline = time.monotonic() + within_s
    while not true():
        assert time.monotonic() < deadline, "it never came to that"
        time.sleep(0.02)


def workers_of(driver: int) -> list[psutil.Process]:
    """The worker processes of a run: they hang on its fork server."""
    found = []
    with contextlib.suppress(psutil.NoSuchProcess):
        for server in psutil.Process(driver).children():
            with contextlib.suppress(psutil.NoSuchProcess):
                if "forkserver" in " ".join(server.cmdline()):
                    found += server.children()
    return found
