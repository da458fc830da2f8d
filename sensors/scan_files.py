"""Scans from files: what a profile scanner wrote, or arrays of one's own."""

from __future__ import annotations

import lzma
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from registration.scan import FloatArray, Scan, ScanError
from sensors import grid_files, threedx
from sensors.grid_files import GridFileError
from sensors.paths import ALONG_X
from sensors.threedx_layout import ThreeDxError

ARRAYS = ("points_mm", "step_mm", "intensity", "apex_mm", "travel")


class ScanFileError(ValueError):
    """A file that holds no scan; the message names it and what is wrong."""


def read_scan(path: Path, step_mm: float | None, travel: FloatArray | None = None) -> Scan:
    """Read a .3dx file, an organised .ply or .csv file, or an .npz file with points_mm.

    points_mm: (profiles, pixels, 3), NaN = no return. sensors.grid_files says how .ply and .csv
    files tell the profile and pixel of a point.
    step_mm, travel: of the motion between profiles, as of Scan. Only an .npz file may hold them, by
    these names, beside `intensity` and `apex_mm`, and they are taken from there when None is
    given. Without any travel the sensor moved along its own X.
    Raises ScanFileError.
    """
    if path.is_dir():
        raise ScanFileError(f"{path}: is a folder; known are files {', '.join(READERS)}")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        raise ScanFileError(f"{path}: {path.suffix or 'no ending'} is not read; known are {known}")
    try:
        return reader(path, step_mm, travel)
    except OSError as error:
        raise ScanFileError(f"{path}: {error.strerror or 'cannot be read'}") from None
    except (ThreeDxError, GridFileError) as error:
        raise ScanFileError(str(error)) from None
    except ScanError as error:
        raise ScanFileError(f"{path}: {error}") from None


def _read_threedx(path: Path, step_mm: float | None, travel: FloatArray | None) -> Scan:
    raw = threedx.read(path)
    return threedx.to_scan(raw, _given(path, step_mm), ALONG_X if travel is None else travel)


def _read_npz(path: Path, step_mm: float | None, travel: FloatArray | None) -> Scan:
    arrays = _load_npz(path)
    unknown = [name for name in arrays if name not in ARRAYS]
    if unknown:
        raise ScanFileError(f"{path}: unknown array {unknown[0]!r}; known are {', '.join(ARRAYS)}")
    if "points_mm" not in arrays:
        raise ScanFileError(f"{path}: holds no points_mm (profiles, pixels, 3)")
    if step_mm is None:
        if "step_mm" not in arrays:
            raise ScanFileError(f"{path}: holds no step_mm between profiles; give it, as --step")
        if arrays["step_mm"].shape != () or arrays["step_mm"].dtype.kind not in "iuf":
            raise ScanFileError(f"{path}: step_mm should be one number")
        step_mm = float(arrays["step_mm"])
    return Scan.from_points(
        arrays["points_mm"],
        step_mm,
        arrays.get("intensity"),
        arrays.get("apex_mm"),
        arrays.get("travel", ALONG_X) if travel is None else travel,
    )


def _read_csv(path: Path, step_mm: float | None, travel: FloatArray | None) -> Scan:
    points_mm, intensity = grid_files.read_csv(path)
    along = ALONG_X if travel is None else travel
    return Scan.from_points(points_mm, _given(path, step_mm), intensity, travel=along)


def _read_ply(path: Path, step_mm: float | None, travel: FloatArray | None) -> Scan:
    along = ALONG_X if travel is None else travel
    return Scan.from_points(grid_files.read_ply(path), _given(path, step_mm), travel=along)


def _given(path: Path, step_mm: float | None) -> float:
    if step_mm is None:
        raise ScanFileError(
            f"{path}: the file does not hold the step between profiles; give it, as --step"
        )
    return step_mm


def _load_npz(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except _UNREADABLE:
        # Whatever is wrong inside, NumPy's words for it would not help.
        raise ScanFileError(f"{path}: is no .npz file of plain arrays") from None


# What NumPy and zipfile raise of files that are damaged, encrypted or packed in another way, or
# whose arrays are said to be larger than the memory.
_UNREADABLE = (
    ValueError, EOFError, KeyError, AttributeError, TypeError, MemoryError, OverflowError,
    NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error, lzma.LZMAError,
)  # fmt: skip

READERS: dict[str, Callable[[Path, float | None, FloatArray | None], Scan]] = {
    ".3dx": _read_threedx,
    ".npz": _read_npz,
    ".ply": _read_ply,
    ".csv": _read_csv,
}
