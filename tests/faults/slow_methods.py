"""Methods that take time, memory or everything, for the tests of what a run survives."""

from __future__ import annotations

import os
import time

import numpy as np
from scipy.spatial.transform import RigidTransform

from registration import RegistrationResult, Scan

MANY_MB = 600


def slow(target: Scan, source: Scan, params: dict[str, float]) -> RegistrationResult:
    """An answer that depends on every bit of the scans, after a while."""
    time.sleep(params.get("s", 0.0))
    shift = [np.nanmean(view.points_mm, axis=(0, 1)) for view in (target, source)]
    return RegistrationResult(RigidTransform.from_translation(shift[0] - shift[1]), "ok")


def endless(target: Scan, source: Scan, params: dict[str, float]) -> RegistrationResult:
    while True:
        pass


def greedy(target: Scan, source: Scan, params: dict[str, float]) -> RegistrationResult:
    """Take more memory than the limit of the tests allows, and use it."""
    return slow(target, source, {"s": float(np.ones(MANY_MB * 2**17).sum() * 0.0)})


def suicide(target: Scan, source: Scan, params: dict[str, float]) -> RegistrationResult:
    os.kill(os.getpid(), 9)
    return RegistrationResult(None, "failed", "never said")


def crash(target: Scan, source: Scan, params: dict[str, float]) -> RegistrationResult:
    raise ZeroDivisionError("a bug")
