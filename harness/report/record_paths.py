"""Where a results folder keeps what the report shows in 3D; the rest of it brings much more."""

from __future__ import annotations

from pathlib import Path

RECORDS = "pairs"  # the folder of them all


def record_path(folder: Path, identity: str) -> Path:
    """Where the record of a trial lies."""
    return folder / f"trial_{identity}.json.gz"


def still_path(folder: Path, identity: str) -> Path:
    """Where the still picture of a trial lies."""
    return folder / f"trial_{identity}.png"
