"""The rows of an experiment: one a trial, committed as each ends, and the truth for all tables."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from harness.scoring import PARAMETERS, parameter_errors, six_parameters
from harness.trials import Trial

FILE_NAME = "trials.sqlite"
SCHEMA_VERSION = 3
ARRAYS = ("T_exact", "T_theoretical", "T_estimated", "bounds", "covariance", "undetermined")
KINDS = ("exact", "theoretical", "estimated", "error")  # of the six parameters, by column

RowStatus = Literal["ok", "ambiguous", "underdetermined", "failed", "no_overlap", "error"]

_SCHEMA = """
CREATE TABLE trials (
    id TEXT PRIMARY KEY,
    spec TEXT NOT NULL,
    status TEXT NOT NULL,
    reason TEXT NOT NULL,
    traceback TEXT NOT NULL,
    T_exact TEXT,
    T_theoretical TEXT,
    T_estimated TEXT,
    rotation_error_deg REAL,
    translation_error_mm REAL,
    overlap_target REAL,
    overlap_source REAL,
    bounds TEXT,
    covariance TEXT,
    undetermined TEXT,
    counts TEXT NOT NULL
) STRICT;
-- Apart from the rows: two runs give the same rows bit for bit, never the same times.
CREATE TABLE timings (
    id TEXT PRIMARY KEY REFERENCES trials (id),
    code TEXT NOT NULL,
    stage_ms TEXT NOT NULL
) STRICT;
-- What the present configuration asks for: rows of earlier ones stay and are never mixed in.
CREATE TABLE run (
    position INTEGER PRIMARY KEY,
    id TEXT NOT NULL,
    pair TEXT NOT NULL,
    method TEXT NOT NULL,
    given TEXT NOT NULL,
    repeat INTEGER NOT NULL
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


@dataclass(frozen=True)
class Row:
    """The outcome of one trial.

    spec: its canonical JSON. T_exact, T_theoretical, T_estimated: T_target_source or None; the
        theoretical one is what the arm's encoders say.
    overlap_target, overlap_source: exact share of either view's points that the other sees.
    bounds: Cramer-Rao bounds (2, 6, 6) of the pose, see harness.common_points.
    counts: points, segments, patches and so on, by name.
    stage_ms: wall times; all else is the same in every run.
    """

    id: str
    spec: str
    status: RowStatus
    reason: str = ""
    traceback: str = ""
    T_exact: RigidTransform | None = None
    T_theoretical: RigidTransform | None = None
    T_estimated: RigidTransform | None = None
    rotation_error_deg: float | None = None
    translation_error_mm: float | None = None
    overlap_target: float | None = None
    overlap_source: float | None = None
    bounds: np.ndarray[Any, np.dtype[np.float64]] | None = None
    covariance: np.ndarray[Any, np.dtype[np.float64]] | None = None
    undetermined: np.ndarray[Any, np.dtype[np.float64]] | None = None
    counts: dict[str, int] = field(default_factory=dict)
    stage_ms: dict[str, float] = field(default_factory=dict)


class Store:
    """The SQLite file of a results folder, made when missing; used as a context manager.

    Raises StoreError when the file is no store of this version.
    """

    def __init__(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(
                f"{folder} cannot be a results folder: {error.strerror}; give another with --out"
            ) from None
        self.path = folder / FILE_NAME
        self._connection = _connect(self.path)

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._connection.close()

    def begin(self, trials: Sequence[Trial]) -> None:
        """Note which trials the present configuration asks for, in their order."""
        rows = [
            (position, t.id, t.pair, t.label, t.spec.given, t.spec.repeat)
            for position, t in enumerate(trials)
        ]
        with self._connection as connection:
            connection.execute("DELETE FROM run")
            connection.executemany("INSERT INTO run VALUES (?, ?, ?, ?, ?, ?)", rows)

    def finished(self, code: str) -> set[str]:
        """Ids of the rows that this code computed and that are no errors."""
        query = "SELECT id FROM trials JOIN timings USING (id) WHERE code = ? AND status != 'error'"
        return {identity for (identity,) in self._connection.execute(query, (code,))}

    def outdated(self, ids: Iterable[str], code: str) -> int:
        """How many of the trials have a row that other code computed."""
        query = "SELECT id FROM timings WHERE code != ?"
        others = {identity for (identity,) in self._connection.execute(query, (code,))}
        return len(others.intersection(ids))

    def is_drawn(self, trial: Trial) -> bool:
        """Whether the figures on disk are those of this trial."""
        query = "SELECT files FROM drawings WHERE pair = ? AND method = ? AND id = ?"
        found = self._connection.execute(query, (trial.pair, trial.label, trial.id)).fetchone()
        folder = self.path.parent
        return found is not None and all((folder / name).exists() for name in json.loads(found[0]))

    def note_drawing(self, trial: Trial, files: Iterable[Path]) -> None:
        """Remember what was drawn of a trial."""
        names = json.dumps([file.relative_to(self.path.parent).as_posix() for file in files])
        with self._connection as connection:
            connection.execute(
                "INSERT OR REPLACE INTO drawings VALUES (?, ?, ?, ?)",
                (trial.pair, trial.label, trial.id, names),
            )

    def forget_drawings(self, trials: Sequence[Trial]) -> None:
        """Remove the files of pairs and methods that the configuration no longer has."""
        present = {(trial.pair, trial.label) for trial in trials}
        query = "SELECT pair, method, files FROM drawings"
        rows = self._connection.execute(query).fetchall()
        shared = {n for p, m, files in rows if (p, m) in present for n in json.loads(files)}
        for pair, method, files in rows:
            if (pair, method) in present:
                continue
            for name in set(json.loads(files)) - shared:
                (self.path.parent / name).unlink(missing_ok=True)
            with self._connection as connection:
                connection.execute(
                    "DELETE FROM drawings WHERE pair = ? AND method = ?", (pair, method)
                )

    def add(self, row: Row, code: str) -> None:
        """Write one row and commit it; a row of the same id is replaced."""
        values = (
            row.id, row.spec, row.status, row.reason, row.traceback,
            _matrix_json(row.T_exact), _matrix_json(row.T_theoretical),
            _matrix_json(row.T_estimated),
            row.rotation_error_deg, row.translation_error_mm,
            row.overlap_target, row.overlap_source, _array_json(row.bounds),
            _array_json(row.covariance), _array_json(row.undetermined),
            json.dumps(row.counts),
        )  # fmt: skip
        marks = ", ".join("?" * len(values))
        with self._connection as connection:
            connection.execute(f"INSERT OR REPLACE INTO trials VALUES ({marks})", values)
            connection.execute(
                "INSERT OR REPLACE INTO timings VALUES (?, ?, ?)",
                (row.id, code, json.dumps(row.stage_ms)),
            )


def load(folder: Path) -> pd.DataFrame:
    """The rows of a results folder's present configuration, one a trial that has been run.

    Columns: id, pair, method, given, repeat, status, reason, traceback, spec; rotation_error_deg,
    translation_error_mm; overlap_target, overlap_source (fractions); exact_*, theoretical_*,
    estimated_* and error_* of the six parameters (rotation_x_deg .. rotation_z_deg, x_mm .. z_mm);
    n_* counts; ms_* wall times. T_exact, T_theoretical, T_estimated hold (4, 4) matrices,
    bounds, covariance and undetermined arrays, or None. Raises StoreError.
    """
    path = folder / FILE_NAME
    if not path.exists():
        raise StoreError(f"{path} does not exist; run the experiment first")
    connection = _connect(path)
    try:
        cursor = connection.execute(
            "SELECT run.pair, run.method, run.given, run.repeat, trials.*, timings.stage_ms "
            "FROM run JOIN trials USING (id) JOIN timings USING (id) ORDER BY position"
        )
        names = [name for name, *_ in cursor.description]
        records = [dict(zip(names, record, strict=True)) for record in cursor]
    finally:
        connection.close()
    for record in records:
        for name in ARRAYS:
            record[name] = _array(record[name])
        for name, prefix in (("counts", "n_"), ("stage_ms", "ms_")):
            values = json.loads(record.pop(name))
            record |= {prefix + key: value for key, value in values.items()}
    frame = pd.DataFrame(records, columns=None if records else names)
    for name in ("rotation_error_deg", "translation_error_mm", "overlap_target", "overlap_source"):
        frame[name] = frame[name].astype(np.float64)
    return frame.join(_parameters(frame))


def _parameters(frame: pd.DataFrame) -> pd.DataFrame:
    """The six parameters of the poses, and estimated less exact; NaN where there is no pose."""
    names = [
        f"{name}_{unit}" for name, unit in zip(PARAMETERS, ["deg"] * 3 + ["mm"] * 3, strict=True)
    ]
    values = {kind: np.full((len(frame), 6), np.nan) for kind in KINDS}
    for kind in KINDS[:3]:
        for row, matrix in zip(values[kind], frame[f"T_{kind}"], strict=True):
            if matrix is not None:
                row[:] = six_parameters(RigidTransform.from_matrix(matrix))
    for i in range(len(frame)):
        values["error"][i] = parameter_errors(values["exact"][i], values["estimated"][i])
    columns = {
        f"{kind}_{name}": values[kind][:, i] for kind in KINDS for i, name in enumerate(names)
    }
    return pd.DataFrame(columns, index=frame.index)


def _connect(path: Path) -> sqlite3.Connection:
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
    except sqlite3.DatabaseError as error:
        connection.close()
        raise StoreError(
            f"{path} is no store of trials ({error}); give another folder with --out"
        ) from None
    if version != SCHEMA_VERSION:
        connection.close()
        raise StoreError(
            f"{path} was written in version {version} of the store, this program writes version "
            f"{SCHEMA_VERSION}; keep it and give another folder with --out, or remove it"
        )
    return connection


def _matrix_json(pose: RigidTransform | None) -> str | None:
    return None if pose is None else _array_json(pose.as_matrix())


def _array_json(array: np.ndarray[Any, np.dtype[np.float64]] | None) -> str | None:
    return None if array is None else json.dumps(np.asarray(array).tolist())


def _array(text: str | None) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    return None if text is None else np.array(json.loads(text), dtype=np.float64)
