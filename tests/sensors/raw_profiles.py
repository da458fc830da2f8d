"""Raw profiles of .3dx files, made up, read and compared."""

from __future__ import annotations

import io

import numpy as np

from sensors import threedx
from sensors.threedx import RawProfiles


def decode(data: bytes) -> RawProfiles:
    return threedx.decode(io.BytesIO(data))


def random_raw(seed: int, profiles: int = 4, pixels: int = 256, narrow: bool = False):
    rng = np.random.default_rng(seed)
    y = rng.integers(-3000, 3000, (profiles, pixels)).astype(np.int16)
    z = rng.integers(2000, 12000, (profiles, pixels)).astype(np.int16)
    y[rng.random(y.shape) < 0.1] = threedx.NO_MEASUREMENT
    z[y == threedx.NO_MEASUREMENT] = threedx.NO_MEASUREMENT
    return RawProfiles(
        y,
        z,
        rng.integers(0, 256, y.shape).astype(np.uint8),
        rng.integers(0, 2, profiles).astype(np.uint8),
        version=3,
        cpu_version=(1, 2, 3, 4, 5),
        winuser_version=(6, 7, 8, 9),
        unit=10,
        content=7,
        narrow=narrow,
    )


def assert_equal(a: RawProfiles, b: RawProfiles) -> None:
    for name in ("y_tenth_mm", "z_tenth_mm", "intensity", "direction"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert getattr(a, name).dtype == getattr(b, name).dtype
    for name in ("version", "cpu_version", "winuser_version", "unit", "content", "narrow"):
        assert getattr(a, name) == getattr(b, name)
