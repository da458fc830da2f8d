"""The one place that says how hot loops are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a loop over plain arrays with numba, cached on disk where that can be written.

    Without fastmath: the same input must give the same bits on every run.
    """
    try:
        loop: F = numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:  # numba's only word for a read-only checkout of a user without a home
        loop = numba.njit(nogil=True)(function)
    return loop
