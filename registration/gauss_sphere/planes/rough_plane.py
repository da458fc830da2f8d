"""A rough plane of some beams, by least squares of their inverse depths."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.fan.calibrated import DEPTH, SIGMA, SLOPE, Known, X, take_bias
from registration.gauss_sphere.small_matrices import solve_symmetric3
from registration.kernels import compiled
from registration.scan import FloatArray

SAMPLE = 128  # beams of a plane that are enough to start from


@compiled
def first_plane(beams: FloatArray, lean: FloatArray, plane: FloatArray) -> None:
    """Least squares of q = A + B s + C (x - x0) q, q the inverse depth, x0 the mean x.

    That is in the coordinates of the profiles; the plane is then sheared into the scan's frame.

    plane: (4,) out, unit normal towards the sensor and offset, y and z from the apex.
    """
    x0 = beams[X].mean()
    g, solution = np.zeros((3, 4)), np.zeros(3)
    for j in range(beams.shape[1]):
        s, d = beams[SLOPE, j], beams[DEPTH, j]
        q = 1.0 / d
        v = (beams[X, j] - x0) * q
        w = (d * d / beams[SIGMA, j]) ** 2
        g[0, 0] += w
        g[0, 1] += w * s
        g[0, 2] += w * v
        g[1, 1] += w * s * s
        g[1, 2] += w * s * v
        g[2, 2] += w * v * v
        g[0, 3] += w * q
        g[1, 3] += w * s * q
        g[2, 3] += w * v * q
    solve_symmetric3(g, solution)
    # 1 = A (z - lean_z x) + B (y - lean_y x) + C (x - x0)
    across = solution[2] - lean[0] * solution[1] - lean[1] * solution[0]
    size = np.sqrt(solution[0] ** 2 + solution[1] ** 2 + across**2)
    plane[0], plane[1], plane[2] = -across / size, -solution[1] / size, -solution[0] / size
    plane[3] = -(1.0 + solution[2] * x0) / size


@compiled
def settled_plane(
    beams: FloatArray,
    lean: FloatArray,
    apex_z_mm: float,
    known: Known,
    turns: int,
    plane: FloatArray,
) -> None:
    """The plane of some beams that agrees with its own bias.

    The bias tilts a plane, by whose tilt it is known: in turns they settle.
    """
    first_plane(beams, lean, plane)
    for _ in range(turns):
        take_bias(beams, plane, apex_z_mm, known)
        first_plane(beams, lean, plane)
