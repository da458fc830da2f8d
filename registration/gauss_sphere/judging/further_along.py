"""Poses further along what planes leave open, for and against which ends of faces say nothing.

An extruded thing looks the same all along. Where ends of faces say at which place two views saw it,
as those of a gap do, equal ones elsewhere would say the same, if each view saw another of them.
"""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.judging.bending import doubted
from registration.gauss_sphere.judging.decision import is_plain
from registration.gauss_sphere.judging.free_planes import without_free_planes
from registration.gauss_sphere.judging.open_directions import open_shift
from registration.gauss_sphere.outlines.ends import Ends
from registration.gauss_sphere.outlines.testimony import said_along
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, floors_of, scored
from registration.gauss_sphere.refinement.refine import likelihood
from registration.gauss_sphere.refinement.settling import make_likely
from registration.gauss_sphere.view import View
from registration.scan import FloatArray

REACH = 2.0  # of OutlineParams.slide_mm
LOOKED_AT, APART_MM = 6, 40.0  # places to each side, the nearest that lie so far apart


def unsaid_along(
    best: Settled,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    bias_mm: float,
    params: GaussSphereParams,
) -> list[Settled]:
    """The best pose moved along the one shift that planes leave open, where the scans allow it.

    They do if it keeps decision.repeat_share of its score, with next to nothing in free space and
    no plane, unless the best pose has one there, and ends of faces say too little to tell. At most
    one pose, of most score.
    bias_mm: what is seen of a bias of the planes.
    """
    by_planes = _by_planes(best, target, source, bias_mm, params)
    along = open_shift(by_planes, target, params.decision)
    if along is None:
        return []
    found = list[Settled]()
    for shift_mm in _silent(best, along, target, source, ends, params):
        moved = best._replace(shift_mm=best.shift_mm + shift_mm * along)
        there = scored(moved, target, source, params)
        enough = there.score > params.decision.repeat_share * best.score
        if enough and is_plain(there, params.decision):
            found.append(there)
    found.sort(key=lambda pose: -pose.score)
    return without_free_planes(found, best, target, source, params)[:1]


def _by_planes(
    pose: Settled, target: View, source: View, bias_mm: float, params: GaussSphereParams
) -> Settled:
    """The pose, as sure as its planes alone make it."""
    r, t, information, sure = pose.rotation.copy(), pose.shift_mm.copy(), *np.zeros((2, 6, 6))
    make_likely(
        target.patches, source.patches, pose.pairs, likelihood(params.refine), floors_of(params),
        r, t, information, sure, np.empty(len(pose.pairs)),
    )  # fmt: skip
    alone = pose._replace(information=information, sure=sure)
    if bias_mm > 0.0:
        alone = doubted(alone, target.patches, source.patches, bias_mm, params)
    return alone


def _silent(
    best: Settled,
    along: FloatArray,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: GaussSphereParams,
) -> FloatArray:
    """Shifts (m,) along a direction, in mm, of which ends of faces say next to nothing."""
    how, pose = params.outlines, (best.rotation, best.shift_mm)
    n = int(REACH * how.slide_mm / how.cell_mm)
    shifts_mm = how.cell_mm * np.arange(-n, n + 1, dtype=np.float64)
    confirmed, denied = said_along(*pose, along, shifts_mm, target, source, ends, how).T
    silent = (confirmed + denied < how.least) & (denied <= how.denied_share * how.least)
    looked_at = list[float]()
    for way in (-1.0, 1.0):
        there = way * shifts_mm[silent & (way * shifts_mm >= APART_MM)]
        there.sort()
        last, left = 0.0, LOOKED_AT
        for shift_mm in there:
            if left and shift_mm >= last + APART_MM:
                looked_at.append(way * shift_mm)
                last, left = shift_mm, left - 1
    return np.array(looked_at)
