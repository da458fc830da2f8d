"""Where results lie."""

from __future__ import annotations

from pathlib import Path

RESULTS = Path("results")


def results_folder(folder: Path | None, name: str) -> Path:
    """The folder that was asked for, or else the one of this name among all results."""
    return folder or RESULTS / name
