"""Real runs of the command in processes of their own, which tests may kill."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


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
