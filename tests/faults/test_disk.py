"""A folder that cannot be written, a disk that fills, a store that is none: told, nothing lost."""

from __future__ import annotations

import ctypes
import os
import resource
import sqlite3
from pathlib import Path
from typing import Any

from commanded_runs import count_of, rows_of, run

# Of Linux: prctl, capabilities.
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1


def lines_of(done: Any) -> str:
    """The one line on standard error of a refused request."""
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("run-experiment: ")
    text: str = done.stderr
    return text


def as_anybody() -> None:
    """Root may write anywhere; without this capability it is refused like everybody else."""
    if os.geteuid() == 0:
        ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE)


def test_a_folder_for_reading_only_is_refused(cheap: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir(mode=0o555)
    told = lines_of(run(cheap, out, preexec_fn=as_anybody))
    assert "cannot be written (Permission denied)" in told
    assert "--out" in told
    assert list(out.iterdir()) == []
    below = run(cheap, out / "below", preexec_fn=as_anybody)
    assert "cannot be a results folder: Permission denied" in lines_of(below)


def test_a_disk_that_fills_is_told_and_the_run_goes_on_when_there_is_room(
    cheap: Path, tmp_path: Path
) -> None:
    """A limit on the size of files stands for the disk: writing fails in the middle of the run."""
    out = tmp_path / "out"
    options = ["--set", "repeats=150", "--workers", "2", "--set", "methods.0.params.s=0"]

    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (250_000, 250_000))

    told = lines_of(run(cheap, out, *options, preexec_fn=small_files))
    assert "cannot be written" in told
    assert "make room" in told
    kept = rows_of(out)
    with sqlite3.connect(out / "trials.sqlite") as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    assert 0 < len(kept) < 150
    again = run(cheap, out, *options)
    assert again.returncode == 0, again.stderr
    assert f"{len(kept)} reused" in again.stdout
    assert set(kept) < set(rows_of(out))
    assert count_of(out) == 150


def test_a_store_that_is_none_of_ours_is_refused_and_left_as_it_is(
    cheap: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert run(cheap, out, "--set", "repeats=3").returncode == 0
    store = out / "trials.sqlite"
    with sqlite3.connect(store) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
    good = store.read_bytes()
    with sqlite3.connect(store) as connection:
        connection.execute("PRAGMA user_version = 3")
    older = store.read_bytes()
    torn = good[:4096] + b"\xff" * (len(good) - 4096)
    for content, words in (
        (older, "version 3 of the store"),
        (b"no database at all, but longer than a header has to be " * 40, "is no store of trials"),
        (torn, "is no store of trials"),
    ):
        store.write_bytes(content)
        told = lines_of(run(cheap, out))
        assert words in told
        assert "--out" in told
        assert store.read_bytes() == content
