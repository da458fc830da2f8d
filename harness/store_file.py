"""The SQLite file of a results folder: its tables, its lock, and arrays as it holds them."""

from __future__ import annotations

import fcntl
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FILE_NAME = "trials.sqlite"
LOCK_NAME = "trials.lock"
SCHEMA_VERSION = 6

FloatArray = NDArray[np.float64]

_SCHEMA = """
CREATE TABLE trials (
    id TEXT PRIMARY KEY,
    spec TEXT NOT NULL,  -- JSON; what many trials share stands in `parts`
    status TEXT NOT NULL,
    reason TEXT NOT NULL,
    traceback TEXT NOT NULL,
    T_exact BLOB,  -- arrays: float64, row by row
    T_theoretical BLOB,
    T_estimated BLOB,
    rotation_error_deg REAL,
    translation_error_mm REAL,
    overlap_target REAL,
    overlap_source REAL,
    count_names INTEGER NOT NULL REFERENCES names (number),
    counts BLOB NOT NULL
) STRICT;
-- Apart from the rows: summaries need none of them, and read much less of the file without.
CREATE TABLE matrices (
    id TEXT PRIMARY KEY REFERENCES trials (id),
    bounds BLOB,
    covariance BLOB,
    undetermined BLOB
) STRICT;
-- At which stage the method stopped, for the trials of which it says so.
CREATE TABLE stopped (
    id TEXT PRIMARY KEY REFERENCES trials (id),
    stage TEXT NOT NULL
) STRICT;
CREATE TABLE parts (
    hash TEXT PRIMARY KEY,
    text TEXT NOT NULL
) STRICT;
-- Lists of names, as JSON: of the counts and of the stages that a row has.
CREATE TABLE names (
    number INTEGER PRIMARY KEY,
    text TEXT NOT NULL UNIQUE
) STRICT;
-- Apart from the rows: two runs give the same rows bit for bit, never the same times.
CREATE TABLE timings (
    id TEXT PRIMARY KEY REFERENCES trials (id),
    code TEXT NOT NULL,
    stage_names INTEGER NOT NULL REFERENCES names (number),
    stage_ms BLOB NOT NULL
) STRICT;
-- What the present configuration asks for: rows of earlier ones stay and are never mixed in.
CREATE TABLE run (
    position INTEGER PRIMARY KEY,
    id TEXT NOT NULL,
    pair TEXT NOT NULL,
    method TEXT NOT NULL,
    given TEXT NOT NULL,
    repeat INTEGER NOT NULL,
    point INTEGER
) STRICT;
-- The points of its sweep, if it has one: the values of all swept keys in order, as JSON.
CREATE TABLE points (
    point INTEGER PRIMARY KEY,
    varied TEXT NOT NULL,
    shown TEXT NOT NULL
) STRICT;
CREATE TABLE swept (
    position INTEGER PRIMARY KEY,
    key TEXT NOT NULL
) STRICT;
-- Which trial the figures and clouds of a pair and a method show, and their files.
CREATE TABLE drawings (
    pair TEXT NOT NULL,
    method TEXT NOT NULL,
    id TEXT NOT NULL,
    files TEXT NOT NULL,
    PRIMARY KEY (pair, method)
) STRICT;
"""


class StoreError(RuntimeError):
    """A store that cannot be used; the message says the way out."""


def connect(path: Path) -> sqlite3.Connection:
    """Open a store, made when missing; raises StoreError when it is none of this version."""
    try:
        connection = sqlite3.connect(path, timeout=30.0)
    except sqlite3.OperationalError as error:
        raise StoreError(
            f"{path} cannot be opened ({error}); give a folder that can be written with --out"
        ) from None
    try:
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version == 0 and not connection.execute("SELECT * FROM sqlite_master").fetchall():
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(
                f"BEGIN; {_SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT"
            )
            version = SCHEMA_VERSION
        # What is committed outlives a kill of the process; only a loss of power may cost the end.
        connection.execute("PRAGMA synchronous = NORMAL")
    except sqlite3.DatabaseError as error:
        connection.close()
        raise _store_error(path, error) from None
    if version != SCHEMA_VERSION:
        connection.close()
        raise StoreError(
            f"{path} was written in version {version} of the store, this program writes version "
            f"{SCHEMA_VERSION}; keep it and give another folder with --out, or remove it"
        )
    return connection


@contextmanager
def telling(path: Path) -> Iterator[None]:
    """What SQLite cannot do becomes a StoreError that says the way out."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        raise _store_error(path, error) from None


def _store_error(path: Path, error: sqlite3.DatabaseError) -> StoreError:
    code = getattr(error, "sqlite_errorname", "")
    if code.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
        return StoreError(
            f"{path} cannot be written ({error}); the rows so far are kept: make room, then give "
            "the same command again"
        )
    if code.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN")):
        return StoreError(
            f"{path} cannot be written ({error}); give a folder that can be written with --out"
        )
    if code.startswith(("SQLITE_NOTADB", "SQLITE_CORRUPT")):
        return StoreError(f"{path} is no store of trials ({error}); give another folder with --out")
    return StoreError(f"{path} cannot be used ({error}); give another folder with --out")


class Lock:
    """One run at a time on a results folder; the system lets go of it when the process is gone."""

    def __init__(self, folder: Path) -> None:
        path = folder / LOCK_NAME
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise StoreError(
                f"{path} cannot be written ({error.strerror}); give a folder that can be written "
                "with --out"
            ) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            other = os.read(self._file, 20).decode(errors="replace").strip()
            os.close(self._file)
            by = f"process {other}" if other.isdecimal() else "another run"
            raise StoreError(
                f"{folder} is in use by {by}; wait until it ends, or give another folder with --out"
            ) from None
        os.ftruncate(self._file, 0)
        os.write(self._file, f"{os.getpid()}\n".encode())

    def release(self) -> None:
        """Let the next run begin."""
        os.close(self._file)


def packed(array: Any) -> bytes | None:
    """An array as the store holds it."""
    return None if array is None else np.ascontiguousarray(array, dtype=np.float64).tobytes()


def unpacked(blobs: list[bytes | None], shape: tuple[int, ...]) -> NDArray[np.object_]:
    """(n,) arrays, or None, from a column of the store; a leading -1 of the shape is any length."""
    arrays = np.empty(len(blobs), dtype=object)
    present = [i for i, blob in enumerate(blobs) if blob is not None]
    if shape[0] == -1:
        for i in present:
            arrays[i] = np.frombuffer(blobs[i] or b"").reshape(
                shape if blobs[i] else (0, *shape[1:])
            )
        return arrays
    for i, array in zip(present, stacked(blobs, shape), strict=True):
        arrays[i] = array
    return arrays


def stacked(blobs: list[bytes | None], shape: tuple[int, ...]) -> FloatArray:
    """(m, *shape) the arrays of a column of the store that are there."""
    joined = b"".join(blob for blob in blobs if blob is not None)
    return np.frombuffer(joined).reshape(-1, *shape)
