"""The matches of normals in a pair, in the order that figures and the page show them."""

from __future__ import annotations

import numpy as np

from harness.figures.looks import NORMAL_COLOURS
from registration.gauss_sphere.candidates.rotation import gauss_sphere
from registration.gauss_sphere.evidence import PlaneEvidence
from registration.scan import FloatArray, IntArray
from registration.thesis.gauss_sphere import GaussSphere

UNMATCHED = -1
SAME_DIRECTION_RAD = 0.05  # of planes that share a dot on the Gauss sphere


def sorted_matches(matches: IntArray, target_weight: FloatArray) -> IntArray:
    """(k, 2) matches of normals, the one of the target's largest area first."""
    ordered: IntArray = matches[np.argsort(-target_weight[matches[:, 0]], kind="stable")]
    return ordered


def palette_places(count: int, matched: IntArray) -> IntArray:
    """(count,) place in NORMAL_COLOURS of each normal or plane of a view, or UNMATCHED.

    matched: (k,) the view's normal or plane in each match, those to be coloured first.
    """
    places = np.full(count, UNMATCHED, dtype=np.int64)
    for place, index in reversed(list(enumerate(matched[: len(NORMAL_COLOURS)]))):
        places[index] = place
    return places


def spheres_of(planes: PlaneEvidence) -> tuple[tuple[GaussSphere, GaussSphere], IntArray]:
    """The Gauss spheres of both views, and (k, 2) matches of their directions, largest first."""
    target, source = (
        GaussSphere(*gauss_sphere(view.patches, SAME_DIRECTION_RAD))
        for view in (planes.target, planes.source)
    )
    matches = np.stack(
        [target.member[planes.pairs[:, 0]], source.member[planes.pairs[:, 1]]], axis=1
    )
    _, first = np.unique(matches, axis=0, return_index=True)
    return (target, source), matches[np.sort(first)]
