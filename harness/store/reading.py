"""Reads the rows of a results folder back as one table."""

from __future__ import annotations

import contextlib
import json
import re
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from harness.scoring.poses import PARAMETERS, parameter_errors, parameters_of
from harness.store.file import FILE_NAME, Blobs, StoreError, connect, stacked, telling, unpacked
from registration.scan import FloatArray

NUMBERS = ("rotation_error_deg", "translation_error_mm", "overlap_target", "overlap_source")
TRUTHS, ESTIMATED = ("T_exact", "T_theoretical"), "T_estimated"
MATRICES: dict[str, tuple[int, ...]] = {
    "bounds": (2, 6, 6),
    "covariance": (6, 6),
    "undetermined": (-1, 6),
}
ARRAYS = {ESTIMATED: (4, 4)} | MATRICES
COUNTS, TIMES = "n_", "ms_"
WHOLE_TIME = "ms_registration"  # a column even where no row has it
PART = re.compile(r'\{"part":"([0-9a-f]{16})"\}')
KINDS = ("exact", "theoretical", "estimated", "error")  # of the six parameters, by column
FETCHED = 10_000  # rows at a time

# Columns of the tables, by what becomes of them.
INTEGERS = ("kind", "repeat", "ending", "truth", "count_names", "stage_names")
OBJECTS = ("id", "point")
LISTS = ("counts", "stage_ms")


def load(folder: Path | str, specs: bool = False, arrays: bool = True) -> pd.DataFrame:
    """The rows of a results folder's present configuration, one a trial that has been run.

    Columns: id, pair, method, given, repeat, status, reason, traceback, stage, notes (a line each);
    rotation_error_deg, translation_error_mm; overlap_target, overlap_source (fractions); exact_*,
    theoretical_*, estimated_* and error_* of the six parameters (rotation_x_deg .. rotation_z_deg,
    x_mm .. z_mm); n_* counts; ms_* wall times, ms_registration always. Of a sweep also sweep.point,
    the number of the point; sweep.varied, which key differs from the experiment (one_at_a_time
    only, else ""); and sweep.<key> for every swept key, its value there.

    arrays: also T_exact, T_theoretical, T_estimated, (4, 4) matrices, and bounds, covariance and
    undetermined, or None. specs: also spec, all that determines the trial, as JSON. Raises
    StoreError.
    """
    path = Path(folder) / FILE_NAME
    if not path.exists():
        raise StoreError(f"{path} does not exist; run the experiment first")
    with contextlib.closing(connect(path)) as connection, telling(path):
        rows = _rows(connection, specs, arrays)
        kinds = _table(connection, "SELECT kind, pair, method, given FROM kinds")
        endings = _table(connection, "SELECT * FROM endings")
        truths = _table(connection, "SELECT * FROM truths")
        names = dict(connection.execute("SELECT number, text FROM names"))
        parts = dict(connection.execute("SELECT hash, text FROM parts")) if specs else {}
        points = _table(connection, "SELECT point, varied, shown FROM points ORDER BY point")
        keys = [key for (key,) in connection.execute("SELECT key FROM swept ORDER BY position")]
    kind = _places(rows["kind"], kinds["kind"])
    ending = _places(rows["ending"], endings["number"])
    truth = _places(rows["truth"], truths["number"])
    frame = pd.DataFrame({"id": rows["id"]})
    for name in ("pair", "method", "given"):
        frame[name] = _taken(kinds[name], kind)
    frame["repeat"] = rows["repeat"]
    for name in ("status", "reason", "traceback", "stage", "notes"):
        frame[name] = _taken(endings[name], ending)
    blocks = [frame, _points(rows["point"], points, keys)]
    if specs:
        full = [_full_spec(spec, parts) for spec in rows["spec"]]
        blocks.append(pd.DataFrame({"spec": np.array(full, dtype=object)}))
    blocks.append(pd.DataFrame({name: rows[name] for name in NUMBERS}))
    if arrays:
        truly = {name: unpacked(truths[name], (4, 4))[truth] for name in TRUTHS}
        held = truly | {name: rows[name] for name in ARRAYS}
        blocks.append(pd.DataFrame(held, dtype=object))
    blocks.append(_spread(COUNTS, rows["count_names"], rows["counts"], names))
    times = _spread(TIMES, rows["stage_names"], rows["stage_ms"], names)
    if WHOLE_TIME not in times:  # no trial came as far as the registration
        times[WHOLE_TIME] = np.nan
    blocks.append(times)
    exact, theoretical = (_six_parameters(truths[name])[truth] for name in TRUTHS)
    blocks.append(_parameters(exact, theoretical, rows["parameters"]))
    return pd.concat(blocks, axis=1)


def _rows(connection: sqlite3.Connection, specs: bool, arrays: bool) -> dict[str, NDArray[Any]]:
    """The rows of the run in its order, column by column.

    Lists stand end to end; "parameters" are the six of the estimated pose.
    """
    names = [*INTEGERS, *OBJECTS, *NUMBERS, *LISTS, ESTIMATED]
    names += [*(MATRICES if arrays else ()), *(("spec",) if specs else ())]
    tables = ["ids", "trials", "timings"]
    tables += [*(("matrices",) if arrays else ()), *(("specs",) if specs else ())]
    # In this order each table is read from its begin to its end, as numbers go with positions.
    joined = " ".join(f"CROSS JOIN {table} USING (number)" for table in tables)
    cursor = connection.execute(f"SELECT {', '.join(names)} FROM run {joined} ORDER BY position")
    blocks = [_converted(dict.fromkeys(names, ()), arrays)]
    while fetched := cursor.fetchmany(FETCHED):
        # At once, so that there are never more than these as objects of Python.
        columns = dict(zip(names, zip(*fetched, strict=True), strict=True))
        blocks.append(_converted(columns, arrays))
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _converted(columns: dict[str, tuple[Any, ...]], arrays: bool) -> dict[str, NDArray[Any]]:
    """Some rows as SQLite gives them, as _rows returns them."""
    found: dict[str, NDArray[Any]] = {}
    for name, column in columns.items():
        if name in LISTS:
            found[name] = stacked(column, ())
        elif name in NUMBERS:
            found[name] = np.array(column, dtype=np.float64)  # None becomes NaN
        elif name in INTEGERS:
            found[name] = np.array(column, dtype=np.int64)
        elif name not in ARRAYS:
            found[name] = np.array(column, dtype=object)
        elif arrays:
            found[name] = unpacked(column, ARRAYS[name])
    return found | {"parameters": _six_parameters(columns[ESTIMATED])}


def _six_parameters(blobs: Blobs) -> FloatArray:
    """(n, 6) the six parameters of packed poses; NaN where there is none."""
    values = np.full((len(blobs), 6), np.nan)
    there = np.array([blob is not None for blob in blobs], dtype=np.bool_)
    if there.any():
        matrices = stacked((blob for blob in blobs if blob is not None), (4, 4))
        rotations = Rotation.from_matrix(matrices[:, :3, :3])
        values[there] = parameters_of(rotations, matrices[:, :3, 3])
    return values


def _table(connection: sqlite3.Connection, query: str) -> dict[str, NDArray[np.object_]]:
    """What a query finds, column by column."""
    cursor = connection.execute(query)
    names = [name for name, *_ in cursor.description]
    columns = list(zip(*cursor.fetchall(), strict=True)) or [()] * len(names)
    return {n: np.array(column, dtype=object) for n, column in zip(names, columns, strict=True)}


def _places(numbers: NDArray[np.int64], known: NDArray[np.object_]) -> NDArray[np.intp]:
    """Where each number stands among the known ones."""
    return pd.Index(known.astype(np.int64)).get_indexer(pd.Index(numbers))


def _taken(texts: NDArray[np.object_], places: NDArray[np.intp]) -> pd.Series:
    """A column of texts, of which pandas looks at each different one once, not at every row."""
    return pd.Series(texts, dtype="str").take(places).reset_index(drop=True)


def _points(
    numbers: NDArray[np.object_], points: dict[str, NDArray[np.object_]], keys: list[str]
) -> pd.DataFrame:
    """The columns of a sweep, for rows that belong to these points; none where there is none."""
    if not keys:
        return pd.DataFrame(index=range(len(numbers)))
    order = np.searchsorted(points["point"].astype(np.int64), numbers.astype(np.int64))
    shown = json.loads("[" + ",".join(points["shown"]) + "]")
    columns: dict[str, Any] = {"sweep.point": numbers.astype(np.int64)}
    columns["sweep.varied"] = points["varied"][order]
    for index, key in enumerate(keys):
        values = pd.Series([values[index] for values in shown])
        columns[f"sweep.{key}"] = values.to_numpy()[order]
    return pd.DataFrame(columns)


def _spread(
    prefix: str, listings: NDArray[np.int64], numbers: FloatArray, texts: dict[int, str]
) -> pd.DataFrame:
    """Numbers that rows hold under names of their own, a column for each name.

    listings: (n,) which names each row has. numbers: those of all rows, end to end.
    """
    columns: dict[str, FloatArray] = {}
    # In the order in which they first occur, as the stages of a method follow each other.
    kind_of, kinds = pd.factorize(listings)
    names = [json.loads(texts[int(number)]) for number in kinds]
    lengths = np.array([len(listed) for listed in names], dtype=np.int64)[kind_of]
    begin = np.cumsum(lengths) - lengths
    for kind, listed in enumerate(names):
        which = np.flatnonzero(kind_of == kind)
        for index, name in enumerate(listed):
            column = columns.setdefault(prefix + name, np.full(len(listings), np.nan))
            column[which] = numbers[begin[which] + index]
    whole = prefix == COUNTS
    return pd.DataFrame(
        {
            name: column.astype(np.int64) if whole and np.isfinite(column).all() else column
            for name, column in columns.items()
        },
        index=range(len(listings)),
    )


def _parameters(exact: FloatArray, theoretical: FloatArray, estimated: FloatArray) -> pd.DataFrame:
    """The six parameters (n, 6) of the poses, and estimated less exact; NaN where there is none."""
    values = dict(zip(KINDS, (exact, theoretical, estimated), strict=False))
    values["error"] = parameter_errors(exact, estimated)
    return pd.DataFrame(
        {
            f"{kind}_{name}": values[kind][:, i]
            for kind in KINDS
            for i, name in enumerate(PARAMETERS)
        }
    )


def _full_spec(spec: str, parts: dict[str, str]) -> str:
    """The canonical JSON of a spec, its parts back in their places."""
    return PART.sub(lambda found: parts[found[1]], spec)
