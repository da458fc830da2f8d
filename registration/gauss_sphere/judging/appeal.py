"""Poses that planes alone leave in doubt, or outlines of faces deny, judged again by outlines.

Planes do not tell where along themselves they are seen, nor which of two like scenes is meant.
Outlines do: a face that ends in one view must end there in the other, if that sees the place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from registration.gauss_sphere.judging.bending import doubted
from registration.gauss_sphere.judging.decision import agreeing_planes, is_thin
from registration.gauss_sphere.judging.looking_along import carried_back, starts_along
from registration.gauss_sphere.judging.misfits import without_misfits
from registration.gauss_sphere.judging.open_directions import (
    centre_of,
    is_elsewhere,
    open_directions_of,
    open_units,
)
from registration.gauss_sphere.outlines.coinciding import information_of
from registration.gauss_sphere.outlines.ends import Ends, Outlines, as_ends, moved_outlines
from registration.gauss_sphere.outlines.testimony import said, said_along
from registration.gauss_sphere.params import DecisionParams, GaussSphereParams, OutlineParams
from registration.gauss_sphere.refinement.matching import Settled, different, scored, settle_best
from registration.gauss_sphere.refinement.refine import distances2, likelihood
from registration.gauss_sphere.small_matrices import apply_step
from registration.gauss_sphere.view import View
from registration.scan import FloatArray

ROUNDS = 3
HOPELESS = 0.6  # share of ends that deny a pose: to move it to where outlines coincide cannot help
BARELY = 1e-9  # of the information: enough to solve for what stays open
A_TURN = 1e-9  # of the length of a direction: one that moves the middle of the surface by less


def appealed(
    settled: list[Settled],
    target: View,
    source: View,
    outlines: tuple[Outlines, Outlines],
    bias_mm: float,
    params: GaussSphereParams,
) -> list[Settled]:
    """The settled poses, and what becomes of them where ends confirm them, less what these deny.

    bias_mm: what is seen of a bias of the planes. None are left where outlines do not confirm the
    best of them, or few planes do.
    """
    how = params.outlines
    of_target, of_source = outlines
    ends = as_ends(of_target), as_ends(of_source)
    rotations, shifts = starts_along(settled, target, source, ends, params)
    again = settle_best(
        target, source, rotations, shifts, _settling_all(len(shifts), params), look_again=False
    )
    again = [without_misfits(pose, target, source, params) for pose in again]
    if bias_mm > 0.0:
        again = [doubted(p, target.patches, source.patches, bias_mm, params) for p in again]
    told_by = target, source, ends, how
    there = [carried_back(pose, target, source, ends, params) for pose in again]
    hopeful = [pose for pose in there if _denied_of(_told(pose, *told_by), how) < HOPELESS]
    fixed = [_fixed(pose, target, source, outlines, params) for pose in hopeful]
    poses = _surest(fixed, target, source, params)
    needed = max(how.least, how.confirmed_share * (of_target.line.size + of_source.line.size))
    words = [_told(pose, *told_by) for pose in poses]
    shares = [_denied_of(word, how) for word in words]
    sure = [share for share, (confirmed, _) in zip(shares, words, strict=True)
            if confirmed >= how.least]  # fmt: skip
    if not sure:
        return []
    most = min(sure) + how.dropped_share
    left = [k for k in range(len(poses)) if shares[k] <= most]
    left = [k for k in left if not _is_elsewhere(poses[k], target, source, ends, params)] or left
    first = left[0]
    if words[first][0] < needed or shares[first] > how.denied_share:
        return []
    if is_thin(poses[first], target, source, params.decision):
        return []
    return [poses[k] for k in left]


def outscoring(
    settled: list[Settled],
    answer: Settled,
    target: View,
    source: View,
    params: DecisionParams,
) -> list[Settled]:
    """Those of the settled poses that speak against another one that ends of faces prefer.

    They are of higher score, and nearly as many planes agree on them. Ends deny the true pose where
    a thing was moved or taken away between the scans, and confirm one a period off. A pose that was
    only to be shifted along what its planes leave open speaks against it by much more surface.
    """
    least = agreeing_planes(answer, target, params) - 1
    return [
        pose
        for pose in settled
        if pose.score > answer.score
        and agreeing_planes(pose, target, params) >= least
        and len(different([pose, answer], source, params)) == 2
        and not (
            answer.score > params.rival_share * pose.score
            and _is_shift_of(answer, pose, target, params)
        )
    ]


def _is_shift_of(answer: Settled, pose: Settled, target: View, params: DecisionParams) -> bool:
    """Whether an answer is a pose moved along what its planes leave open."""
    left_open = open_directions_of(pose, target, params)
    return bool(left_open.size) and not is_elsewhere(answer, pose, left_open, target, params)


def _settling_all(n: int, params: GaussSphereParams) -> GaussSphereParams:
    """Parameters by which n poses are settled, down to those that `judge` calls rivals here."""
    least = params.decision.repeat_share
    every = replace(
        params.verification,
        ranked=n,
        kept=n,
        rough_stride=1,
        worth_settling=min(params.verification.worth_settling, least),
        worth_refining=min(params.verification.worth_refining, least),
    )
    return replace(params, verification=every)


def _told(
    pose: Settled, target: View, source: View, ends: tuple[Ends, Ends], params: OutlineParams
) -> tuple[int, int]:
    """How many ends of faces confirm a pose, and deny it."""
    return said(pose.rotation, pose.shift_mm, target, source, ends, params)


def _denied_of(words: tuple[int, int], params: OutlineParams) -> float:
    """Of what ends of faces say, the share that denies; few of them say little."""
    confirmed, denied = words
    return denied / max(confirmed + denied, params.least)


def _surest(
    poses: list[Settled], target: View, source: View, params: GaussSphereParams
) -> list[Settled]:
    """The poses that are different, best first, each the one of those like it that is surest.

    Planes slid some of them to where they are, and led others there.
    """
    n_open = [open_directions_of(pose, target, params.decision).shape[0] for pose in poses]
    chosen = list[int]()
    for best in different(poses, source, params.decision):
        alike = [k for k, one in enumerate(poses)
                 if len(different([best, one], source, params.decision)) == 1]  # fmt: skip
        surest = min(alike, key=n_open.__getitem__)
        if surest not in chosen:  # it may be like two that are not like each other
            chosen.append(surest)
    return sorted((poses[k] for k in chosen), key=lambda pose: -pose.score)


def _is_elsewhere(
    pose: Settled, target: View, source: View, ends: tuple[Ends, Ends], params: GaussSphereParams
) -> bool:
    """Whether ends of faces deny a pose along what planes and outlines left open.

    Then it stands for places along there, of which the true one would be another pose.
    """
    how = params.outlines
    open_directions = open_directions_of(pose, target, params.decision)
    for confirmed, denied in _said_across(pose, open_directions, target, source, ends, how):
        said_at_all = confirmed + denied
        if said_at_all >= how.worth_starting and denied > how.dropped_share * said_at_all:
            return True
    return False


def _said_across(
    pose: Settled,
    directions: FloatArray,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: OutlineParams,
) -> Iterator[tuple[int, int]]:
    """How many ends of faces across each direction (k, 6) confirm a pose, and deny it.

    Of a turn about the middle of the surface all tell.
    """
    centre, here = centre_of(pose, target), (pose.rotation, pose.shift_mm)
    for direction in directions:
        across = direction[3:] + np.cross(direction[:3], centre)
        length = float(np.linalg.norm(across))
        if length < A_TURN * float(np.linalg.norm(direction)):
            yield said(*here, target, source, ends, params)
        else:
            unmoved = np.zeros(1)
            told = said_along(*here, across / length, unmoved, target, source, ends, params)
            yield int(told[0, 0]), int(told[0, 1])


def _fixed(
    pose: Settled,
    target: View,
    source: View,
    outlines: tuple[Outlines, Outlines],
    params: GaussSphereParams,
) -> Settled:
    """The pose, moved by outlines and surer by them in what its planes leave open."""
    how, likely = params.outlines, likelihood(params.refine)
    planes, (of_target, of_source) = (target.patches, source.patches), outlines
    open_directions = open_directions_of(pose, target, params.decision)
    if not open_directions.shape[0]:
        return pose
    sure, known = (_without_negative(of, pose, target, params)
                   for of in (pose.sure, pose.information))  # fmt: skip
    r, t = pose.rotation.copy(), pose.shift_mm.copy()
    information, gradient = np.zeros((6, 6)), np.zeros(6)
    step, whole = np.zeros(6), np.zeros(6)
    for done in range(ROUNDS + 1):
        gate_mm = how.gate_mm if done == 0 else 0.5 * how.gate_mm
        there = moved_outlines(of_source, r, t)
        information_of(of_target, there, gate_mm, how.on_mm, how.line_mm, information, gradient)
        if done < ROUNDS:
            curved = sure + information
            if (np.diag(curved) <= 0.0).any():  # neither planes nor outlines say anything of it
                return pose
            curved += BARELY * np.diag(np.diag(curved))
            # The planes go on pulling to where they had the pose.
            step[:] = -np.linalg.solve(curved, gradient + sure @ whole)
            whole += step
            new_r, new_t = np.empty((3, 3)), np.empty(3)
            apply_step(step, r, t, new_r, new_t)
            r, t = new_r, new_t
    moved_there = pose._replace(
        rotation=r,
        shift_mm=t,
        sure=sure + information,
        information=known + information,
        distance2=distances2(*planes, pose.pairs, likely, pose.floor_mm, r, t),
    )
    moved_there = scored(moved_there, target, source, params)
    ends = as_ends(of_target), as_ends(of_source)
    for confirmed, denied in _said_across(moved_there, open_directions, target, source, ends, how):
        if confirmed < how.least or denied > how.denied_share * (confirmed + denied):
            return pose
    return moved_there


def _without_negative(
    information: FloatArray, pose: Settled, target: View, params: GaussSphereParams
) -> FloatArray:
    """The information, nothing where chance was larger: about the middle of the surface."""
    units = open_units(pose, target, params.decision)
    values, vectors = np.linalg.eigh(units.T @ information @ units)
    half = np.linalg.inv(units).T @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    kept: FloatArray = half @ half.T
    return kept
