"""The angles that turn one normal into another, corrected (4-18 to 4-22)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


def two_rotations(normal: ArrayLike, source_normal: ArrayLike) -> Rotation:
    """Rotations Ry(phi) Rx(psi) that turn one normal into another: 0, 1 or 2 of them.

    normal: (3,) unit (x, y, z); source_normal: (3,) unit (a, b, c); normal = R source_normal.
    (4-18) to (4-22), corrected: psi = atan2(b, c) - atan2(y, w), w = +-sqrt(b^2 + c^2 - y^2), and
    phi = atan2(x, z) - atan2(a, w), w = +-sqrt(x^2 + z^2 - a^2), keeping the signs that satisfy
    (C-4) to (C-6). None when no turn about X and then Y leads there, and none when the turn about
    one of these axes stays open (a normal parallel to it).
    """
    x, y, z = np.asarray(normal, dtype=np.float64)
    a, b, c = np.asarray(source_normal, dtype=np.float64)
    # w^2 is the same in both: b^2 + c^2 - y^2 = x^2 + z^2 - a^2 for unit vectors.
    w_squared = 0.5 * ((b * b + c * c - y * y) + (x * x + z * z - a * a))
    level_source, level = b * b + c * c, x * x + z * z
    if w_squared < -1e-12 or level_source < 1e-12 or level < 1e-12:
        return Rotation.from_euler("YX", np.zeros((0, 2)))
    w = np.sqrt(max(w_squared, 0.0))
    # (C-4) and (C-6) say that w is the depth after the first turn, so its sign is common.
    signs = (w,) if w == 0.0 else (-w, w)
    angles = [
        (np.arctan2(x, z) - np.arctan2(a, v), np.arctan2(b, c) - np.arctan2(y, v)) for v in signs
    ]
    return Rotation.from_euler("YX", np.array(angles))
