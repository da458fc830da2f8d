"""One thread for each process: processes are the parallelism here."""

from __future__ import annotations

import os

LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def limit_threads() -> None:
    """Keep BLAS and numba to one thread, here if numpy is not imported yet, and in children.

    Sums then have one order, so that a trial gives the same bits in a worker and in a replay.
    """
    for name in LIMITS:
        os.environ[name] = "1"
