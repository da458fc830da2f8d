"""Linear algebra of a few by a few that compiled loops call."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray


@compiled
def solve_symmetric3(g: FloatArray, out: FloatArray) -> None:
    """Solve the symmetric 3 x 3 system of which g holds the upper triangle and right-hand side."""
    ridge = 1e-12
    l00 = np.sqrt(g[0, 0] * (1.0 + ridge) + 1e-300)
    l10, l20 = g[0, 1] / l00, g[0, 2] / l00
    l11 = np.sqrt(max(g[1, 1] * (1.0 + ridge) - l10 * l10, 1e-300))
    l21 = (g[1, 2] - l20 * l10) / l11
    l22 = np.sqrt(max(g[2, 2] * (1.0 + ridge) - l20 * l20 - l21 * l21, 1e-300))
    y0 = g[0, 3] / l00
    y1 = (g[1, 3] - l10 * y0) / l11
    y2 = (g[2, 3] - l20 * y0 - l21 * y1) / l22
    out[2] = y2 / l22
    out[1] = (y1 - l21 * out[2]) / l11
    out[0] = (y0 - l10 * out[1] - l20 * out[2]) / l00


@compiled
def invert_symmetric3(a: FloatArray, out: FloatArray) -> None:
    """The inverse of a symmetric 3 x 3 matrix, into out."""
    # All of a is read before out is written: they may be the same.
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
    c01 = a[1, 2] * a[0, 2] - a[0, 1] * a[2, 2]
    c02 = a[0, 1] * a[1, 2] - a[1, 1] * a[0, 2]
    c11 = a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2]
    c12 = a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]
    c22 = a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]
    det = a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02
    out[0, 0], out[1, 1], out[2, 2] = c00 / det, c11 / det, c22 / det
    out[0, 1], out[0, 2], out[1, 2] = c01 / det, c02 / det, c12 / det
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


@compiled
def is_positive_definite(a: FloatArray) -> bool:
    """Whether a symmetric matrix (n, n), of which the lower half is read, is positive definite."""
    n = a.shape[0]
    lower = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i > j:
                lower[i, j] = total / lower[j, j]
            elif total > 0.0:
                lower[i, i] = np.sqrt(total)
            else:
                return False
    return True


@compiled
def solve_damped6(
    a: FloatArray, b: FloatArray, damping: float, lower: FloatArray, x: FloatArray
) -> None:
    """Solve (A + damping diag(A)) x = -b for a positive semidefinite (6, 6) A, by Cholesky.

    lower: (6, 6) to work in.  Directions that A leaves open stay where they are.
    """
    least = 1e-12 * max(a[0, 0], 1.0)
    for i in range(6):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                total += damping * a[i, i] + least + (1e-9 if i >= 3 else 0.0)
                lower[i, i] = np.sqrt(max(total, 1e-300))
            else:
                lower[i, j] = total / lower[j, j]
    for i in range(6):
        total = -b[i]
        for k in range(i):
            total -= lower[i, k] * x[k]
        x[i] = total / lower[i, i]
    for i in range(5, -1, -1):
        total = x[i]
        for k in range(i + 1, 6):
            total -= lower[k, i] * x[k]
        x[i] = total / lower[i, i]


@compiled
def apply_step(
    step: FloatArray, r: FloatArray, t: FloatArray, out_r: FloatArray, out_t: FloatArray
) -> None:
    """The pose after a perturbation (rotation vector, translation) on its left."""
    angle = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    if angle < 1e-12:
        k, s, c = np.zeros(3), 0.0, 1.0
    else:
        k, s, c = step[:3] / angle, np.sin(angle), np.cos(angle)
    turn = np.empty((3, 3))
    for u in range(3):
        for v in range(3):
            turn[u, v] = (1.0 - c) * k[u] * k[v] + (c if u == v else 0.0)
    turn[0, 1] -= s * k[2]
    turn[1, 0] += s * k[2]
    turn[0, 2] += s * k[1]
    turn[2, 0] -= s * k[1]
    turn[1, 2] -= s * k[0]
    turn[2, 1] += s * k[0]
    if angle < 1e-12:
        turn[0, 1] -= step[2]
        turn[1, 0] += step[2]
        turn[0, 2] += step[1]
        turn[2, 0] -= step[1]
        turn[1, 2] -= step[0]
        turn[2, 1] += step[0]
    for u in range(3):
        out_t[u] = step[3 + u]
        for v in range(3):
            out_t[u] += turn[u, v] * t[v]
            total = 0.0
            for w in range(3):
                total += turn[u, w] * r[w, v]
            out_r[u, v] = total
