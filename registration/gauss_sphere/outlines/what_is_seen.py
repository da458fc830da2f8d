"""What a view sees at places: a face, free space, or nothing that it can tell."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.view import DEPTH, PATCH, Seen, beams_at
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

ON, FREE, UNKNOWN = range(3)
LIKE = 0.96  # cosine between normals of one face


@compiled
def what_is_at(
    seen: Seen, points: FloatArray, normal: FloatArray, n: int, on_mm: float, behind: float
) -> IntArray:
    """What a view sees at the first n points: a face of that normal, free space, or neither.

    points: (6, n or more) x, y and z, and room for what beams_at leaves; normal: (n or more, 3).
    """
    beam, word = np.empty(n, np.int64), np.full(n, UNKNOWN)
    beams_at(seen, points, beam)
    for j in range(n):
        if beam[j] < 0:
            continue
        i = int(seen.image[beam[j], PATCH])
        if i >= 0:
            n0, n1, n2 = seen.normal[i, 0], seen.normal[i, 1], seen.normal[i, 2]
            like = n0 * normal[j, 0] + n1 * normal[j, 1] + n2 * normal[j, 2] > LIKE
            away = n0 * points[0, j] + n1 * points[1, j] + n2 * points[2, j] - seen.offset_mm[i]
            if like and abs(away) < on_mm:
                word[j] = ON
        if word[j] == UNKNOWN and seen.image[beam[j], DEPTH] > points[3, j] + behind:
            word[j] = FREE
    return word
