"""The modified Gauss sphere and its compaction (sections 4.3.1 and 5.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray
from registration.thesis.params import SphereParams
from registration.thesis.patches import Patches


@dataclass(frozen=True)
class GaussSphere:
    """The distinct normals of one view.

    direction: (k, 3) unit, heaviest first; weight: (k,) their areas in mm^2, largest first.
    member: (m,) the normal that each patch went into.
    """

    direction: FloatArray
    weight: FloatArray
    member: IntArray

    def __len__(self) -> int:
        return len(self.weight)


def compact_sphere(patches: Patches, params: SphereParams) -> GaussSphere:
    """Unite normals whose tips are closer than CloseNormal, the closest pair first.

    A united normal points along the sum of its parts, area as length, and weighs their total; the
    thesis says the latter only. Position plays no part. Section 5.5.
    """
    vectors = patches.normal * patches.area_mm2[:, None]
    member = _unite(vectors.copy(), params.close_normal)
    names, member = np.unique(member, return_inverse=True)
    weight = np.zeros(len(names))
    np.add.at(weight, member, patches.area_mm2)
    direction = np.zeros((len(names), 3))
    np.add.at(direction, member, vectors)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    order = np.argsort(-weight, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return GaussSphere(direction[order], weight[order], rank[member].astype(np.int64))


@compiled
def _unite(vectors: FloatArray, close: float) -> IntArray:
    """(m,) index of the patch that stands for each patch's group; vectors are overwritten."""
    m = len(vectors)
    member = np.arange(m)
    alive = np.ones(m, dtype=np.bool_)
    unit = np.empty((m, 3))
    nearest = np.full(m, -1, dtype=np.int64)
    chord = np.full(m, np.inf)
    for i in range(m):
        unit[i] = vectors[i] / np.sqrt((vectors[i] ** 2).sum())
    stale = np.ones(m, dtype=np.bool_)
    while True:
        best = -1
        for i in range(m):
            if not alive[i]:
                continue
            if stale[i] or not alive[nearest[i]]:
                chord[i] = np.inf
                nearest[i] = i
                for j in range(m):
                    if j != i and alive[j]:
                        d = np.sqrt(((unit[i] - unit[j]) ** 2).sum())
                        if d < chord[i]:
                            chord[i] = d
                            nearest[i] = j
                stale[i] = False
            if best < 0 or chord[i] < chord[best]:
                best = i
        if best < 0 or not chord[best] < close:
            return member
        gone = nearest[best]
        vectors[best] += vectors[gone]
        alive[gone] = False
        member[member == gone] = best
        unit[best] = vectors[best] / np.sqrt((vectors[best] ** 2).sum())
        for i in range(m):
            if not alive[i] or i == best:
                continue
            d = np.sqrt(((unit[i] - unit[best]) ** 2).sum())
            if d < chord[i]:
                chord[i] = d
                nearest[i] = best
            elif nearest[i] == best:
                stale[i] = True
        stale[best] = True
