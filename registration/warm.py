"""Compile every kernel once, so that no later run waits for it: `python -m registration.warm`."""

from __future__ import annotations

import numpy as np

from registration.methods import METHODS, PROFILE_METHODS, register
from registration.peers import PEERS
from registration.scan import Scan


def corner_scan(profiles: int = 24, pixels: int = 64) -> Scan:
    """Two roofs, one behind the other, as a small scan on which every stage has something to do."""
    x, y = np.meshgrid(np.arange(profiles) * 5.0, np.linspace(-120.0, 120.0, pixels), indexing="ij")
    beside = np.abs(y - 10.0)
    z = 600.0 + np.where(x > 60.0, 0.9 * beside + 0.4 * (x - 60.0), 0.3 * beside)
    return Scan.from_points(np.stack([x, y, z], axis=2), step_mm=5.0)


if __name__ == "__main__":
    for name in METHODS.keys() - PEERS.keys():
        register(corner_scan(), corner_scan(), method=name)
    for name in PROFILE_METHODS:
        register(corner_scan(profiles=1), corner_scan(profiles=1), method=name)
