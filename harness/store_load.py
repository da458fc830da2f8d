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
from scipy.spatial.transform import RigidTransform

from harness.scoring import PARAMETERS, parameter_errors, six_parameters
from harness.store_file import FILE_NAME, StoreError, connect, stacked, telling, unpacked

FloatArray = NDArray[np.float64]

NUMBERS = ("rotation_error_deg", "translation_error_mm", "overlap_target", "overlap_source")
POSES: dict[str, tuple[int, ...]] = {
    "T_exact": (4, 4),
    "T_theoretical": (4, 4),
    "T_estimated": (4, 4),
}
ARRAYS: dict[str, tuple[int, ...]] = {
    "bounds": (2, 6, 6),
    "covariance": (6, 6),
    "undetermined": (-1, 6),
}
COUNTS, TIMES = "n_", "ms_"
PART = re.compile(r'\{"part":"([0-9a-f]{16})"\}')
KINDS = ("exact", "theoretical", "estimated", "error")  # of the six parameters, by column
FETCHED = 20_000  # rows at a time


def load(folder: Path | str, specs: bool = False, arrays: bool = True) -> pd.DataFrame:
    """The rows of a results folder's present configuration, one a trial that has been run.

    Columns: id, pair, method, given, repeat, status, reason, traceback, stage; rotation_error_deg,
    translation_error_mm; overlap_target, overlap_source (fractions); exact_*, theoretical_*,
    estimated_* and error_* of the six parameters (rotation_x_deg .. rotation_z_deg, x_mm .. z_mm);
    n_* counts; ms_* wall times. Of a sweep also sweep.point, the number of the point;
    sweep.varied, which key differs from the experiment (one_at_a_time only, else ""); and
    sweep.<key> for every swept key, its value there.

    arrays: also T_exact, T_theoretical, T_estimated, (4, 4) matrices, and bounds, covariance and
    undetermined, or None. specs: also spec, all that determines the trial, as JSON. Raises
    StoreError.
    """
    path = Path(folder) / FILE_NAME
    if not path.exists():
        raise StoreError(f"{path} does not exist; run the experiment first")
    with contextlib.closing(connect(path)) as connection, telling(path):
        run = _columns(connection, "SELECT id, pair, method, given, repeat, point FROM run "
                       "ORDER BY position")  # fmt: skip
        wanted = ["id", "status", "reason", *NUMBERS, "count_names", "counts", *POSES]
        wanted += ["spec"] if specs else []
        rows = _columns(connection, f"SELECT {', '.join(wanted)} FROM trials")
        query = f"SELECT id, {', '.join(ARRAYS)} FROM matrices"
        matrices = _columns(connection, query) if arrays else {}
        stopped = dict(connection.execute("SELECT id, stage FROM stopped"))
        failed = dict(connection.execute("SELECT id, traceback FROM trials WHERE traceback != ''"))
        times = _columns(connection, "SELECT id, stage_names, stage_ms FROM timings")
        names = dict(connection.execute("SELECT number, text FROM names"))
        parts = dict(connection.execute("SELECT hash, text FROM parts")) if specs else {}
        points = _columns(connection, "SELECT point, varied, shown FROM points ORDER BY point")
        keys = [key for (key,) in connection.execute("SELECT key FROM swept ORDER BY position")]
    place = pd.Index(rows["id"]).get_indexer(pd.Index(run["id"]))
    run = {name: column[place >= 0] for name, column in run.items()}
    rows = {name: column[place[place >= 0]] for name, column in rows.items()}
    of_time = pd.Index(times["id"]).get_indexer(pd.Index(run["id"]))
    poses = {name: rows[name] for name in POSES}
    texts = {name: _texts(run[name]) for name in ("pair", "method", "given")}
    frame = pd.DataFrame({"id": run["id"]} | texts)
    frame["repeat"] = run["repeat"].astype(np.int64)
    for name in ("status", "reason"):
        frame[name] = _texts(rows[name])
    frame["traceback"] = frame["id"].map(failed).fillna("") if failed else ""
    frame["stage"] = frame["id"].map(stopped).fillna("") if stopped else ""
    blocks = [frame, _points(run["point"], points, keys)]
    if specs:
        full = [_full_spec(spec, parts) for spec in rows["spec"]]
        blocks.append(pd.DataFrame({"spec": np.array(full, dtype=object)}))
    blocks.append(pd.DataFrame({name: rows[name].astype(np.float64) for name in NUMBERS}))
    if arrays:
        of_matrix = pd.Index(matrices["id"]).get_indexer(pd.Index(run["id"]))
        held = poses | {name: matrices[name][of_matrix] for name in ARRAYS}
        shapes = POSES | ARRAYS
        columns = {name: unpacked(list(held[name]), shape) for name, shape in shapes.items()}
        blocks.append(pd.DataFrame(columns, dtype=object))
    blocks.append(_spread(COUNTS, rows["count_names"], rows["counts"], names))
    times = {name: column[of_time] for name, column in times.items()}
    blocks.append(_spread(TIMES, times["stage_names"], times["stage_ms"], names))
    blocks.append(_parameters(poses))
    return pd.concat(blocks, axis=1)


def _columns(connection: sqlite3.Connection, query: str) -> dict[str, NDArray[np.object_]]:
    """What a query finds, column by column."""
    cursor = connection.execute(query)
    names = [name for name, *_ in cursor.description]
    blocks = [np.empty((0, len(names)), dtype=object)]
    while fetched := cursor.fetchmany(FETCHED):
        blocks.append(np.array(fetched, dtype=object))
    return {name: np.concatenate([b[:, i] for b in blocks]) for i, name in enumerate(names)}


def _texts(column: NDArray[np.object_]) -> pd.Series:
    """A column of few different texts; pandas looks at each of them once, not at every row."""
    numbers, different = pd.factorize(column)
    return pd.Series(different).take(numbers).reset_index(drop=True)


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
    prefix: str,
    listings: NDArray[np.object_],
    blobs: NDArray[np.object_],
    texts: dict[int, str],
) -> pd.DataFrame:
    """Numbers that rows hold under names of their own, a column for each name."""
    columns: dict[str, FloatArray] = {}
    # In the order in which they first occur, as the stages of a method follow each other.
    kind_of, kinds = pd.factorize(listings)
    for kind, number in enumerate(kinds):
        which = np.flatnonzero(kind_of == kind)
        listed = json.loads(texts[number])
        numbers = np.frombuffer(b"".join(blobs[which])).reshape(len(which), len(listed))
        for index, name in enumerate(listed):
            column = columns.setdefault(prefix + name, np.full(len(listings), np.nan))
            column[which] = numbers[:, index]
    whole = prefix == COUNTS
    return pd.DataFrame(
        {
            name: column.astype(np.int64) if whole and np.isfinite(column).all() else column
            for name, column in columns.items()
        },
        index=range(len(listings)),
    )


def _parameters(poses: dict[str, NDArray[np.object_]]) -> pd.DataFrame:
    """The six parameters of the poses, and estimated less exact; NaN where there is no pose."""
    names = [
        f"{name}_{unit}" for name, unit in zip(PARAMETERS, ["deg"] * 3 + ["mm"] * 3, strict=True)
    ]
    values = {}
    for kind in KINDS[:3]:
        # Trials of one pair share their exact pose: each different one is converted once.
        numbers, different = pd.factorize(poses[f"T_{kind}"])  # no pose: -1, the last
        values[kind] = np.full((len(different) + 1, 6), np.nan)
        if len(different):
            matrices = stacked(list(different), (4, 4))
            values[kind][:-1] = six_parameters(RigidTransform.from_matrix(matrices))
        values[kind] = values[kind][numbers]
    values["error"] = parameter_errors(values["exact"], values["estimated"])
    return pd.DataFrame(
        {f"{kind}_{name}": values[kind][:, i] for kind in KINDS for i, name in enumerate(names)}
    )


def _full_spec(spec: str, parts: dict[str, str]) -> str:
    """The canonical JSON of a spec, its parts back in their places."""
    return PART.sub(lambda found: parts[found[1]], spec)
