"""Arrays as small text for a page: whole numbers of a stated step, compressed."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

MISSING = -32768  # stands for NaN
LARGEST = 32767


def packed(values: ArrayLike, step: float) -> dict[str, Any]:
    """An array as 16 bit whole numbers in base64, with their step; NaN stays NaN.

    step: the resolution asked for, coarser where 16 bits do not reach. report.js reads it back.
    """
    array = np.asarray(values, dtype=np.float64)
    finite = np.isfinite(array)
    largest = float(np.abs(array[finite]).max()) if finite.any() else 0.0
    step = max(step, largest / LARGEST)
    whole = np.full(array.shape, MISSING, dtype="<i2")
    whole[finite] = np.rint(array[finite] / step)
    return {
        "step": step,
        "shape": list(array.shape),
        "int16": base64.b64encode(whole.tobytes()).decode("ascii"),
    }


def compressed(value: Any) -> bytes:
    """A JSON value as gzip, the same bytes every time."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return gzip.compress(text.encode("utf-8"), compresslevel=6, mtime=0)


def write_by_content(value: Any, folder: Path, kind: str) -> str:
    """Write a JSON value under a name that its content decides; returns the name.

    Pairs and methods that share a scan then share its file.
    """
    data = compressed(value)
    name = f"{kind}_{hashlib.sha256(data).hexdigest()[:16]}.json.gz"
    if not (folder / name).exists():
        write_whole(folder / name, data)
    return name


def write_whole(path: Path, data: bytes) -> None:
    """Write a file in one step, as two workers may write the same one."""
    draft = path.with_name(f"{path.name}.{os.getpid()}.part")
    draft.write_bytes(data)
    draft.replace(path)
