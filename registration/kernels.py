"""The one place that says how hot loops are compiled."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a loop over plain arrays with numba, cached on disk where that can be written.

    Without fastmath: the same input must give the same bits on every run. Division by zero gives
    infinity or NaN, as in numpy: a check would keep loops from running on vectors.
    """
    try:
        loop: F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # numba's only word for a read-only checkout of a user without a home
        loop = numba.njit(nogil=True, error_model="numpy")(function)
    return loop


def inlined(function: F) -> F:
    """Compile what compiled loops call in their innermost round, into each of them.

    A call that hands over a dozen arrays costs as much as small algebra itself.
    """
    part: F = numba.njit(inline="always")(function)
    return part


def forget_stale(package: Path) -> bool:
    """Delete all cached kernels of a package when any of its sources has changed since.

    numba looks at a kernel's own file only, so one that calls into a changed file would go on with
    the code it was compiled with. Returns whether the sources had changed.
    """
    states = sorted((str(path), path.stat().st_mtime_ns) for path in package.rglob("*.py"))
    state = hashlib.sha256(repr((numba.__version__, states)).encode()).hexdigest()
    stamp = package / "__pycache__" / "kernels.stamp"
    with suppress(OSError):  # a read-only checkout: nothing is cached in it
        if stamp.exists() and stamp.read_text(encoding="ascii") == state:
            return False
        for pattern in ("*.nbi", "*.nbc"):
            for path in package.rglob(pattern):
                path.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(state, encoding="ascii")
    return True


forget_stale(Path(__file__).parent)
