"""How the files of figures begin that are drawn from all rows of a run, and how old ones go."""

from __future__ import annotations

from pathlib import Path

RANDOM = "random_"
STUDY = "study_"


def forget_figures(folder: Path) -> None:
    """Remove those of an earlier run, which may have asked for something else."""
    for prefix in (RANDOM, STUDY):
        for old in folder.glob(f"{prefix}*.png"):
            # A pair may be called so too: its figures have the method, the place and the kind.
            if "_" not in old.stem.removeprefix(prefix):
                old.unlink()
