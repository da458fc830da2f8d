"""Scans from organised .csv and .ply files, whose points say which profile and pixel they are."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import trimesh

from registration.scan import FloatArray, IntArray

INDICES = ("profile", "pixel")
COORDINATES = ("x_mm", "y_mm", "z_mm")
MOST_PROFILES = 10_000
MOST_PIXELS = 10_000
# A grid of more than FEW_BEAMS, with fewer points than one in EMPTIEST, is no scan.
EMPTIEST, FEW_BEAMS = 100, 1_000_000


class GridFileError(ValueError):
    """A file that holds no organised points; the message names it, where, and what would do."""


def read_csv(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Points (profiles, pixels, 3) in mm, NaN where no row is, and intensity or None.

    The first line names the columns: profile, pixel, x_mm, y_mm, z_mm and maybe intensity; profile
    and pixel count from 0. Raises GridFileError with the line, OSError.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # of more values than names
            table = pd.read_csv(
                path, dtype=str, keep_default_na=False, skipinitialspace=True, index_col=False,
                skip_blank_lines=False,  # they count where a message names a line
            )  # fmt: skip
    except pd.errors.ParserWarning:
        raise GridFileError(
            f"{path}: line 2: has more values than line 1 names columns; expected as many (a "
            "column of row names needs a name, too)"
        ) from None
    except (ValueError, UnicodeDecodeError) as error:  # pandas raises its errors as ValueErrors
        problem = str(error).splitlines()[0].removeprefix("Error tokenizing data. ")
        raise GridFileError(f"{path}: is no table of comma-separated values: {problem}") from None
    wanted = [*INDICES, *COORDINATES]
    for name in wanted:
        if name not in table.columns:
            raise GridFileError(
                f"{path}: line 1: has no column {name!r}; expected {', '.join(wanted)} and maybe "
                "intensity"
            )
    known = [*wanted, *(["intensity"] if "intensity" in table.columns else [])]
    table = table[(table.fillna("") != "").any(axis=1)]
    lines = table.index + 2  # the first one names the columns
    values = table[known].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        text = table[known].iat[row, column]
        problem = f"{known[column]} is {text!r}, no finite number"
        raise GridFileError(f"{path}: line {lines[row]}: {problem}")
    where = [f"line {line}" for line in lines] if len(values) < 1e6 else None
    points = _gridded(path, values[:, :2], values[:, 2:5], where)
    if len(known) == len(wanted):
        return points, None
    brightness = np.full(points.shape[:2], np.nan)
    index = values[:, :2].astype(np.int64)
    brightness[index[:, 0], index[:, 1]] = values[:, 5]
    return points, brightness


def read_ply(path: Path) -> FloatArray:
    """Points (profiles, pixels, 3) in mm of a .ply file, NaN where there is none.

    Organised either by whole-number properties `profile` and `pixel` of the vertices, counted from
    0, or by header lines `obj_info num_rows N` (profiles) and `obj_info num_cols N` (pixels), with
    a vertex for every beam, NaN where it did not return. Raises GridFileError, OSError.
    """
    rows, columns = _grid_of_header(path)
    try:
        loaded = trimesh.load(str(path), file_type="ply", process=False)
        vertices = loaded.metadata["_ply_raw"]["vertex"]["data"]
        names = list(vertices) if isinstance(vertices, dict) else vertices.dtype.names
        xyz = _columns(vertices, "xyz")
        index = _columns(vertices, INDICES) if all(name in names for name in INDICES) else None
    except Exception as error:  # whatever is wrong inside, the library's words would not help
        raise GridFileError(
            f"{path}: is no .ply file with vertices of properties x, y, z"
        ) from error
    if index is not None:
        return _gridded(path, index, xyz, None)
    if rows is None or columns is None:
        raise GridFileError(
            f"{path}: its {len(xyz)} points are not organised: vertices need the properties "
            "profile and pixel, or the header `obj_info num_rows` (profiles) and "
            "`obj_info num_cols` (pixels)"
        )
    if rows * columns != len(xyz):
        raise GridFileError(
            f"{path}: {rows} rows of {columns} columns are {rows * columns} points; it has "
            f"{len(xyz)}"
        )
    return xyz.reshape(rows, columns, 3)


def _columns(vertices: Any, names: Sequence[str]) -> FloatArray:
    return np.stack([np.asarray(vertices[name], np.float64).ravel() for name in names], axis=1)


def _grid_of_header(path: Path) -> tuple[int | None, int | None]:
    """Rows and columns as the header says, None where it does not."""
    with path.open("rb") as stream:
        if stream.readline().strip() != b"ply":
            raise GridFileError(f"{path}: is no .ply file: its first line is not `ply`")
        found: dict[str, int] = {}
        for number in range(2, 1000):
            line = stream.readline().decode("ascii", errors="replace").strip()
            if line == "end_header":
                return found.get("num_rows"), found.get("num_cols")
            match = re.fullmatch(r"(?:obj_info|comment)\s+(num_rows|num_cols)\s+(\S+)", line)
            if match is None:
                continue
            if not match[2].isdecimal() or int(match[2]) == 0:
                raise GridFileError(f"{path}: line {number}: {match[1]} is {match[2]!r}")
            found[match[1]] = int(match[2])
    raise GridFileError(f"{path}: its header has no end_header")


def _gridded(path: Path, index: FloatArray, xyz: FloatArray, where: list[str] | None) -> FloatArray:
    """Points (n, 3) at their profile and pixel (n, 2). where: what to call each, its line."""

    def place(row: int) -> str:
        return where[row] if where is not None else f"point {row + 1}"

    if len(index) == 0:
        raise GridFileError(f"{path}: holds no point")
    for column, (name, most) in enumerate(zip(INDICES, (MOST_PROFILES, MOST_PIXELS), strict=True)):
        values = index[:, column]
        wrong = np.flatnonzero((values != np.floor(values)) | (values < 0) | (values >= most))
        if len(wrong):
            problem = (
                f"{name} is {values[wrong[0]]:g}; expected a whole number from 0 to {most - 1}"
            )
            raise GridFileError(f"{path}: {place(int(wrong[0]))}: {problem}")
    cell: IntArray = index.astype(np.int64)
    shape = cell.max(axis=0) + 1
    if shape.prod() > max(FEW_BEAMS, EMPTIEST * len(cell)):
        raise GridFileError(
            f"{path}: {len(cell)} points on {shape[0]} profiles of {shape[1]} pixels; expected a "
            f"point on one beam in {EMPTIEST} at least, and indices that count from 0"
        )
    flat = cell[:, 0] * shape[1] + cell[:, 1]
    order = np.argsort(flat, kind="stable")
    again = np.flatnonzero(np.diff(flat[order]) == 0)
    if len(again):
        row = int(order[again[0] + 1])
        profile, pixel = cell[row]
        raise GridFileError(
            f"{path}: {place(row)}: profile {profile}, pixel {pixel} was there before"
        )
    points = np.full((*shape, 3), np.nan)
    points[cell[:, 0], cell[:, 1]] = xyz
    return points
