"""A cheap run, and processes that do not outlive their test."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from commanded_runs import environment

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
