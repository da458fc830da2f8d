"""Where results lie, and whether they can be written there."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.config.errors import ConfigError
from harness.store import StoreError

RESULTS = Path("results")
# Of a file system that is full, over quota, for reading only, or not ours.
DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EFBIG)


def results_folder(folder: Path | None, name: str) -> Path:
    """The folder that was asked for, or else the one of this name among all results."""
    return folder or RESULTS / name


def check_folder(folder: Path) -> None:
    """Raise ConfigError where a results folder could not be made, before any time is spent."""
    problem = _problem_of(folder)
    if problem:
        message = f"{folder} cannot be a results folder: {problem}; give another"
        raise ConfigError("--out", (), message)


def _problem_of(folder: Path) -> str:
    try:
        folder.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass  # it is yet to be made
    except OSError as error:  # as of a name that is too long
        return error.strerror or "it cannot be made"
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not there.exists():
        return f"{there} is a link that leads nowhere"
    if not there.is_dir():
        return f"{there} is a file"
    return "" if os.access(there, os.W_OK | os.X_OK) else f"{there} cannot be written to"


@contextmanager
def telling_disk(folder: Path) -> Iterator[None]:
    """A disk that is full or may not be written to becomes one line, with the way out."""
    try:
        yield
    except OSError as error:
        if error.errno not in DISK_ERRORS:
            raise
        raise StoreError(
            f"{error.filename or folder} cannot be written ({error.strerror}); what was written so "
            "far is kept: make room, or give another folder with --out"
        ) from None
