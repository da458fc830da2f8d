"""The SQLite file of a results folder: its tables, its lock, and arrays as it holds them."""

from __future__ import annotations

import fcntl
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.scan import FloatArray

FILE_NAME = "trials.sqlite"
LOCK_NAME = "trials.lock"
SCHEMA_VERSION = 8

Blobs = Sequence[bytes | None] | NDArray[np.object_]

_SCHEMA = """
-- Every trial that the file knows, by a number of its own: numbers are joined faster than ids.
CREATE TABLE ids (
    number INTEGER PRIMARY KEY,
    id TEXT NOT NULL UNIQUE
) STRICT;
-- What summaries need; all else lies in tables apart, so that they read a fraction of the file.
CREATE TABLE trials (
    number INTEGER PRIMARY KEY REFERENCES ids (number),
    ending INTEGER NOT NULL REFERENCES endings (number),
    rotation_error_deg REAL,
    translation_error_mm REAL,
    overlap_target REAL,
    overlap_source REAL,
    count_names INTEGER NOT NULL REFERENCES names (number),
    counts BLOB NOT NULL,  -- arrays: float64, row by row
    truth INTEGER NOT NULL REFERENCES truths (number),
    T_estimated BLOB
) STRICT;
-- How trials end: many do alike. Numbers here and below are hashes, the same in every run.
CREATE TABLE endings (
    number INTEGER PRIMARY KEY,
    status TEXT NOT NULL,
    stage TEXT NOT NULL,  -- where the method stopped, as it says
    reason TEXT NOT NULL,
    traceback TEXT NOT NULL,
    notes TEXT NOT NULL  -- what the method says of its answer, a line each
) STRICT;
-- What trials of one pair share, whatever the noise and the method.
CREATE TABLE truths (
    number INTEGER PRIMARY KEY,
    T_exact BLOB,
    T_theoretical BLOB
) STRICT;
CREATE TABLE matrices (
    number INTEGER PRIMARY KEY REFERENCES trials (number),
    bounds BLOB,
    covariance BLOB,
    undetermined BLOB
) STRICT;
CREATE TABLE specs (
    number INTEGER PRIMARY KEY REFERENCES trials (number),
    spec TEXT NOT NULL  -- JSON; what many trials share stands in `parts`
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
    number INTEGER PRIMARY KEY REFERENCES trials (number),
    code TEXT NOT NULL,
    stage_names INTEGER NOT NULL REFERENCES names (number),
    stage_ms BLOB NOT NULL
) STRICT;
-- The rows without their times, for whoever reads the file with other tools.
CREATE VIEW whole_rows AS
    SELECT id, status, stage, reason, traceback, notes, rotation_error_deg,
        translation_error_mm, overlap_target, overlap_source, count_names, counts, T_exact,
        T_theoretical, T_estimated, bounds, covariance, undetermined, spec
    FROM trials JOIN ids USING (number) JOIN matrices USING (number) JOIN specs USING (number)
        JOIN endings ON endings.number = ending JOIN truths ON truths.number = truth;
-- What the present configuration asks for: rows of earlier ones stay and are never mixed in.
CREATE TABLE run (
    position INTEGER PRIMARY KEY,
    number INTEGER NOT NULL REFERENCES ids (number),
    kind INTEGER NOT NULL REFERENCES kinds (kind),
    repeat INTEGER NOT NULL,
    point INTEGER
) STRICT;
-- The pairs and methods of its trials, which are many to each.
CREATE TABLE kinds (
    kind INTEGER PRIMARY KEY,
    pair TEXT NOT NULL,
    method TEXT NOT NULL,
    given TEXT NOT NULL,
    UNIQUE (pair, method, given)
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


def unpacked(blobs: Blobs, shape: tuple[int, ...]) -> NDArray[np.object_]:
    """(n,) arrays, or None, from a column of the store; a leading -1 of the shape is any length."""
    arrays = np.empty(len(blobs), dtype=object)
    for i, blob in enumerate(blobs):
        if blob is not None:
            arrays[i] = np.frombuffer(blob).reshape(shape if blob else (0, *shape[1:]))
    return arrays


def stacked(blobs: Iterable[bytes], shape: tuple[int, ...]) -> FloatArray:
    """(m, *shape) the arrays of a column of the store."""
    return np.frombuffer(b"".join(blobs)).reshape(-1, *shape)
