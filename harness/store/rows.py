"""The rows of an experiment: one a trial, kept as trials end, and the truth for all tables."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from harness.store.file import FILE_NAME, Lock, StoreError, connect, packed, telling
from harness.store.row import Row
from harness.trials.specs import Trial

if TYPE_CHECKING:  # it takes 0.4 s to import, which the first trial need not wait for
    import pandas as pd

KNOWN_PARTS = 4096


def load(folder: Path | str, specs: bool = False, arrays: bool = True) -> pd.DataFrame:
    """The rows of a results folder: see harness.store.reading.load."""
    from harness.store.reading import load as read  # it brings pandas

    return read(folder, specs, arrays)


class RunState(NamedTuple):
    """What the store has of the present configuration, and what it has not.

    missing: positions of trials without a good row, the first of those that are the same.
    reused: trials that have one. held: those that have any row, whatever computed it.
    different: trials apart from those that are the same. outdated: of these, how many have a row
    that other code computed.
    """

    missing: np.ndarray[Any, np.dtype[np.int64]]
    reused: int
    held: int
    different: int
    outdated: int


class Store:
    """The SQLite file of a results folder, made when missing; used as a context manager.

    One process at a time has it. Raises StoreError when another one does, when the file is no store
    of this version, and when it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(
                f"{folder} cannot be a results folder: {error.strerror}; give another with --out"
            ) from None
        self.path = folder / FILE_NAME
        self._lock = Lock(folder)
        try:
            self._connection = connect(self.path)
        except StoreError:
            self._lock.release()
            raise
        self._parts: dict[str, None] = {}  # some that are in the file
        self._kinds: dict[tuple[str, str, str], int] = {}  # some that are in the file
        self._known: dict[tuple[str, tuple[str | bytes | None, ...]], int] = {}  # the same

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._connection.close()
        self._lock.release()

    def begin(self, trials: Iterable[Trial]) -> None:
        """Note which trials the present configuration asks for, in their order, point by point."""
        with telling(self.path), self._connection as connection:
            for table in ("run", "kinds", "points", "swept"):
                connection.execute(f"DELETE FROM {table}")
            self._kinds.clear()
            connection.executemany("INSERT INTO run VALUES (?, ?, ?, ?, ?)", self._asked(trials))

    def _asked(self, trials: Iterable[Trial]) -> Iterator[tuple[int | None, ...]]:
        connection, point = self._connection, None
        for position, trial in enumerate(trials):
            if trial.point is not None and trial.point is not point:
                if point is None:
                    keys = enumerate(trial.point.shown)
                    connection.executemany("INSERT INTO swept VALUES (?, ?)", keys)
                point = trial.point
                shown = json.dumps(list(point.shown.values()))
                values = (point.number, point.varied, shown)
                connection.execute("INSERT OR IGNORE INTO points VALUES (?, ?, ?)", values)
            number, kind = self._number(trial.id), self._kind(trial)
            of_point = None if point is None else point.number
            yield position, number, kind, trial.spec.repeat, of_point

    def has_some(self, trials: Iterable[Trial]) -> bool:
        """Whether there is a row of any of these trials; notes nothing."""
        query = "SELECT 1 FROM ids JOIN trials USING (number) WHERE id = ?"
        with telling(self.path):
            rows = (self._connection.execute(query, (trial.id,)).fetchone() for trial in trials)
            return any(row is not None for row in rows)

    def state(self, code: str) -> RunState:
        """How far the present configuration is computed by this code."""
        good = "code = ? AND status != 'error'"
        query = (
            "SELECT {} FROM run LEFT JOIN timings USING (number) LEFT JOIN trials USING (number) "
            "LEFT JOIN endings ON endings.number = ending"
        )
        counts = f"count(*) FILTER (WHERE {good}), count(code), count(DISTINCT run.number), "
        counts += "count(DISTINCT run.number) FILTER (WHERE code != ?)"
        missing = f"min(position) AS first, {good} AS done"
        with telling(self.path):
            reused, held, different, outdated = self._connection.execute(
                query.format(counts), (code, code)
            ).fetchone()
            found = self._connection.execute(
                f"SELECT first FROM ({query.format(missing)} GROUP BY run.number) "
                "WHERE done IS NOT 1 ORDER BY first",
                (code,),
            )
            positions = np.fromiter((first for (first,) in found), dtype=np.int64)
        return RunState(positions, reused, held, different, outdated)

    def finished(self, code: str) -> set[str]:
        """Ids of the rows that this code computed and that are no errors."""
        query = (
            "SELECT id FROM timings JOIN trials USING (number) JOIN ids USING (number) "
            "JOIN endings ON endings.number = ending WHERE code = ? AND status != 'error'"
        )
        with telling(self.path):
            return {identity for (identity,) in self._connection.execute(query, (code,))}

    def is_drawn(self, trial: Trial) -> bool:
        """Whether the figures on disk are those of this trial."""
        query = "SELECT files FROM drawings WHERE pair = ? AND method = ? AND id = ?"
        found = self._connection.execute(query, (trial.pair, trial.label, trial.id)).fetchone()
        folder = self.path.parent
        return found is not None and all((folder / name).exists() for name in json.loads(found[0]))

    def note_drawing(self, trial: Trial, files: Iterable[Path]) -> None:
        """Remember what was drawn of a trial."""
        names = json.dumps([file.relative_to(self.path.parent).as_posix() for file in files])
        with telling(self.path), self._connection as connection:
            connection.execute(
                "INSERT OR REPLACE INTO drawings VALUES (?, ?, ?, ?)",
                (trial.pair, trial.label, trial.id, names),
            )

    def forget_drawings(self, trials: Iterable[Trial]) -> None:
        """Remove the files of pairs and methods that the configuration no longer has."""
        query = "SELECT pair, method, files FROM drawings"
        rows = self._connection.execute(query).fetchall()
        if not rows:
            return
        present = {(trial.pair, trial.label) for trial in trials}
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
        self.add_all([row], code)

    def add_all(self, rows: Iterable[Row], code: str) -> None:
        """Write some rows and commit them together; rows of the same ids are replaced."""
        with telling(self.path), self._connection:
            for row in rows:
                self._insert(row, code)

    def _insert(self, row: Row, code: str) -> None:
        number, notes = self._number(row.id), "\n".join(row.notes)
        self._replace(
            "trials", number,
            self._shared("endings", row.status, row.stage, row.reason, row.traceback, notes),
            row.rotation_error_deg, row.translation_error_mm,
            row.overlap_target, row.overlap_source,
            self._listed(row.counts), packed(list(row.counts.values())),
            self._shared("truths", _packed_pose(row.T_exact), _packed_pose(row.T_theoretical)),
            _packed_pose(row.T_estimated),
        )  # fmt: skip
        matrices = (row.bounds, row.covariance, row.undetermined)
        self._replace("matrices", number, *map(packed, matrices))
        self._replace("specs", number, self._shortened(row.spec))
        times = packed(list(row.stage_ms.values()))
        self._replace("timings", number, code, self._listed(row.stage_ms), times)

    def _replace(self, table: str, *values: Any) -> None:
        marks = ", ".join("?" * len(values))
        self._connection.execute(f"INSERT OR REPLACE INTO {table} VALUES ({marks})", values)

    def _number(self, identity: str) -> int:
        """The number of a trial in this file, a new one where it is not known yet."""
        made = self._connection.execute("INSERT OR IGNORE INTO ids (id) VALUES (?)", (identity,))
        if made.rowcount:
            return made.lastrowid or 0
        query = "SELECT number FROM ids WHERE id = ?"
        (number,) = self._connection.execute(query, (identity,)).fetchone()
        return int(number)

    def _kind(self, trial: Trial) -> int:
        """The number of a pair, a method and what that is given."""
        names = trial.pair, trial.label, trial.spec.given
        if names not in self._kinds:
            insert = "INSERT OR IGNORE INTO kinds (pair, method, given) VALUES (?, ?, ?)"
            self._connection.execute(insert, names)
            query = "SELECT kind FROM kinds WHERE pair = ? AND method = ? AND given = ?"
            (self._kinds[names],) = self._connection.execute(query, names).fetchone()
            if len(self._kinds) > KNOWN_PARTS:
                self._kinds.pop(next(iter(self._kinds)))
        return self._kinds[names]

    def _listed(self, names: Iterable[str]) -> int:
        """The number of a list of names; rows of one method share theirs."""
        return self._shared("names", json.dumps(list(names)))

    def _shared(self, table: str, *values: str | bytes | None) -> int:
        """The number of what many rows have in common, kept once: a hash, the same in every run."""
        key = table, values
        if key not in self._known:
            digest = hashlib.sha256(repr(values).encode()).digest()
            self._known[key] = int.from_bytes(digest[:8], signed=True)
            marks = ", ".join("?" * len(values))
            insert = f"INSERT OR IGNORE INTO {table} VALUES (?, {marks})"
            self._connection.execute(insert, (self._known[key], *values))
            if len(self._known) > KNOWN_PARTS:
                self._known.pop(next(iter(self._known)))
        return self._known[key]

    def _shortened(self, spec: str) -> str:
        """A spec with the hashes of its larger parts in their place; the parts are kept once."""
        short = {}
        for name, value in json.loads(spec).items():
            if isinstance(value, dict):
                text = json.dumps(value, sort_keys=True, separators=(",", ":"))
                digest = hashlib.sha256(text.encode()).hexdigest()[:16]
                if digest not in self._parts:
                    insert = "INSERT OR IGNORE INTO parts VALUES (?, ?)"
                    self._connection.execute(insert, (digest, text))
                    self._parts[digest] = None
                    if len(self._parts) > KNOWN_PARTS:
                        self._parts.pop(next(iter(self._parts)))
                short[name] = {"part": digest}
            else:
                short[name] = value
        return json.dumps(short, sort_keys=True, separators=(",", ":"))


def _packed_pose(pose: RigidTransform | None) -> bytes | None:
    return None if pose is None else packed(pose.as_matrix())
