"""Where outlines of faces of two views lie on each other, and what that tells of a pose."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.outlines.ends import Outlines
from registration.kernels import compiled
from registration.scan import FloatArray

LIKE, SAME_WAY = 0.98, 0.95  # cosines between normals, and between outward directions


@compiled
def information_of(
    of_target: Outlines,
    of_source: Outlines,
    gate_mm: float,
    on_mm: float,
    line_mm: float,
    information: FloatArray,
    gradient: FloatArray,
) -> None:
    """Information (6, 6) and gradient of the distances across outlines; a line errs as one."""
    a, b = of_target, of_source
    information[:] = 0.0
    gradient[:] = 0.0
    lines = 0
    for i in range(a.line.size):
        lines = max(lines, a.line[i] + 1)
    met, points = np.full(b.line.size, -1), np.zeros(lines)
    for k in range(b.line.size):
        nearest2 = 2.0 * gate_mm * gate_mm
        for i in range(a.line.size):
            away2, same_way, like, over, ahead = 0.0, 0.0, 0.0, 0.0, 0.0
            for u in range(3):
                away2 += (a.point_mm[i, u] - b.point_mm[k, u]) ** 2
            if away2 > nearest2:
                continue
            for u in range(3):
                d = a.point_mm[i, u] - b.point_mm[k, u]
                same_way += a.outward[i, u] * b.outward[k, u]
                like += a.normal[i, u] * b.normal[k, u]
                over += a.normal[i, u] * d
                ahead += a.outward[i, u] * d
            if same_way < SAME_WAY or like < LIKE:
                continue
            if abs(over) < on_mm and abs(ahead) < gate_mm:
                nearest2 = away2
                met[k] = i
        if met[k] >= 0:
            points[a.line[met[k]]] += 1.0
    row = np.empty(6)
    for k in range(b.line.size):
        i = met[k]
        if i < 0:
            continue
        ahead = 0.0
        for u in range(3):
            ahead += a.outward[i, u] * (b.point_mm[k, u] - a.point_mm[i, u])
            row[3 + u] = a.outward[i, u]
        q = b.point_mm[k]
        row[0] = q[1] * row[5] - q[2] * row[4]
        row[1] = q[2] * row[3] - q[0] * row[5]
        row[2] = q[0] * row[4] - q[1] * row[3]
        alone = a.variance_mm2[i] + b.variance_mm2[k]
        w = 1.0 / (points[a.line[i]] * line_mm * line_mm + alone)
        for u in range(6):
            gradient[u] += w * row[u] * ahead
            for v in range(6):
                information[u, v] += w * row[u] * row[v]
