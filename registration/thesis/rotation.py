"""Rotation by the largest overlap of normals (sections 4.3.2, 5.6 and 6.6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from registration.result import Status
from registration.scan import FloatArray, IntArray
from registration.thesis.angles import two_rotations
from registration.thesis.gauss_sphere import GaussSphere
from registration.thesis.params import RotationParams
from registration.thesis.triplet_search import (
    angle_table,
    count_triplets,
    equal_distances,
    equal_triplets,
    matched_normals,
    overlaps,
)


@dataclass(frozen=True)
class RotationSearch:
    """The distinct rotations found, best first.

    R_target_source: (c, 3, 3); overlap: (c,) of each, as a share of the smaller total weight.
    two_rotations: found by the fallback of section 6.6, with the turn about Z taken as zero.
    status, reason: "ok", or why there is none: "underdetermined" when a view has no three normals
        that are not coplanar, "failed" when no triplet of one fits one of the other.
    """

    R_target_source: FloatArray
    overlap: FloatArray
    two_rotations: bool = False
    status: Status = "ok"
    reason: str = ""


def search_rotation(
    target: GaussSphere,
    source: GaussSphere,
    params: RotationParams,
    distinct_rad: float = 0.17,
    centroids_mm: tuple[FloatArray, FloatArray] | None = None,
) -> RotationSearch:
    """Try every pair of triplets with equal angles and rank them by the overlap of all normals.

    distinct_rad: rotations nearer than this to a better one are left out.
    centroids_mm: (m, 3) of the patches of target and source, for params.distance_tolerance_mm.
    Bounded by params.max_normals and params.max_hypotheses: at most C(30, 3) triplets of the
    target are compared and 20,000 rotations scored with the defaults. Equal overlaps, on which the
    thesis is silent, are ranked by the smaller residual.
    """
    n = params.max_normals
    triplets = [
        count_triplets(angle_table(sphere.direction[:n]), params.angle_tolerance_rad)
        for sphere in (target, source)
    ]
    if min(triplets) > 0:
        candidates = _triplet_rotations(target, source, params, centroids_mm)
        if len(candidates):
            return _ranked(target, source, candidates, params, distinct_rad, two=False)
    if params.zero_rotation == "z":
        candidates = _pair_rotations(target, source, params)
        if len(candidates):
            return _ranked(target, source, candidates, params, distinct_rad, two=True)
    return _none_found(target, source, triplets, params)


def _triplet_rotations(
    target: GaussSphere,
    source: GaussSphere,
    params: RotationParams,
    centroids_mm: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """(h, 3, 3) rotations of all triplet pairs that pass the orthogonality check."""
    n = params.max_normals
    like = np.zeros((0, 0, 0, 0), dtype=bool)
    if params.distance_tolerance_mm is not None:
        if centroids_mm is None:
            raise ValueError("RotationParams.distance_tolerance_mm needs the patches' centroids")
        like = equal_distances(
            centroids_mm[0],
            target.member,
            centroids_mm[1],
            source.member,
            angle_table(target.direction[:n]),
            angle_table(source.direction[:n]),
            params.angle_tolerance_rad,
            params.distance_tolerance_mm,
        )
    rows = equal_triplets(
        target.direction[:n],
        target.weight[:n],
        source.direction[:n],
        source.weight[:n],
        params.angle_tolerance_rad,
        params.max_hypotheses,
        params.min_area_ratio,
        like,
    )
    normals = target.direction[rows[:, :3]]
    source_normals = source.direction[rows[:, 3:]]
    if params.solver == "svd":
        weight = np.minimum(target.weight[rows[:, :3]], source.weight[rows[:, 3:]])
        return fit_rotation(normals, source_normals, weight)
    R, distance = project_on_rotations(solve_correspondences(normals, source_normals))
    return R[distance <= params.orthogonality]


def solve_correspondences(normals: ArrayLike, source_normals: ArrayLike) -> FloatArray:
    """Solve n_i = R n_i' for the nine elements of R, (4-9) to (4-14).

    normals, source_normals: (..., 3, 3), one normal a row. The 9 x 9 matrix of (4-12) consists of
    three copies of the same 3 x 3 block, one for each row of R, so it is solved block by block.
    The answer is a rotation only when the normals are exact. Raises numpy.linalg.LinAlgError for
    coplanar normals.
    """
    block: FloatArray = np.asarray(source_normals, dtype=np.float64)
    right: FloatArray = np.asarray(normals, dtype=np.float64)
    R_transposed: FloatArray = np.asarray(np.linalg.solve(block, right), dtype=np.float64)
    return R_transposed.swapaxes(-1, -2)


def project_on_rotations(matrix: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Find the nearest rotation of each matrix, and how far it is (Frobenius norm).

    matrix: (..., 3, 3). The orthogonality check of section 5.6, by SVD; with determinant +1,
    so a reflection is found to be far from every rotation.
    """
    matrix = np.asarray(matrix, np.float64)
    U, _, Vt = np.linalg.svd(matrix)
    U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    R = U @ Vt
    return R, np.linalg.norm(matrix - R, axis=(-2, -1))


def fit_rotation(normals: ArrayLike, source_normals: ArrayLike, weight: ArrayLike) -> FloatArray:
    """Least-squares rotation of weighted pairs of normals, by SVD.

    normals, source_normals: (..., k, 3); weight: (..., k). At least two normals that are not
    parallel. Returns (..., 3, 3); not in the thesis.
    """
    n, m = np.asarray(normals, np.float64), np.asarray(source_normals, np.float64)
    moment = np.einsum("...k,...ki,...kj->...ij", np.asarray(weight, np.float64), n, m)
    return project_on_rotations(moment)[0]


def _pair_rotations(target: GaussSphere, source: GaussSphere, params: RotationParams) -> FloatArray:
    """(h, 3, 3) rotations without a turn about Z, one or two for every pair of normals."""
    n = params.max_normals
    found = [
        two_rotations(a, b).as_matrix() for a in target.direction[:n] for b in source.direction[:n]
    ]
    return np.concatenate(found) if found else np.zeros((0, 3, 3))


def match_normals(
    target: GaussSphere, source: GaussSphere, R_target_source: FloatArray, tolerance_rad: float
) -> IntArray:
    """(k, 2) pairs of target and source normals that overlap under a given rotation."""
    match = matched_normals(target.direction, source.direction, R_target_source, tolerance_rad)
    found = np.flatnonzero(match >= 0)
    return np.stack([found, match[found]], axis=1)


def _ranked(
    target: GaussSphere,
    source: GaussSphere,
    R: FloatArray,
    params: RotationParams,
    distinct_rad: float,
    *,
    two: bool,
) -> RotationSearch:
    scores = _scores(target, source, R, params)
    order = np.lexsort((scores[:, 1], -np.round(scores[:, 0], 9)))
    chosen: list[int] = []
    # |Ra - Rb| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm.
    apart = 2.0 * np.sqrt(2.0) * np.sin(0.5 * distinct_rad)
    while len(order) and len(chosen) < params.candidates:
        chosen.append(int(order[0]))
        order = order[np.linalg.norm(R[order] - R[order[0]], axis=(1, 2)) > apart]
    best, overlap = R[chosen], scores[chosen, 0]
    if params.refit and not two:
        best = np.stack([_refit(target, source, r, params) for r in best])
        overlap = _scores(target, source, best, params)[:, 0]
        order = np.argsort(-overlap, kind="stable")
        best, overlap = best[order], overlap[order]
    return RotationSearch(best, overlap, two)


def _scores(
    target: GaussSphere, source: GaussSphere, R: FloatArray, params: RotationParams
) -> FloatArray:
    scores = overlaps(
        target.direction,
        target.weight,
        source.direction,
        source.weight,
        np.ascontiguousarray(R),
        params.overlap_tolerance_rad,
    )
    scores[:, 0] /= min(target.weight.sum(), source.weight.sum())
    return scores


def _refit(
    target: GaussSphere, source: GaussSphere, R: FloatArray, params: RotationParams
) -> FloatArray:
    """Solve again over all normals that overlap, as long as they fix the rotation."""
    pairs = match_normals(target, source, R, params.overlap_tolerance_rad)
    n, m = target.direction[pairs[:, 0]], source.direction[pairs[:, 1]]
    if len(pairs) < 2 or np.linalg.svd(n, compute_uv=False)[1] < params.angle_tolerance_rad:
        return R
    return fit_rotation(n, m, np.minimum(target.weight[pairs[:, 0]], source.weight[pairs[:, 1]]))


def _none_found(
    target: GaussSphere, source: GaussSphere, triplets: list[int], params: RotationParams
) -> RotationSearch:
    empty = (np.zeros((0, 3, 3)), np.zeros(0))
    poor = [
        f"{len(sphere)} distinct normal{'s' if len(sphere) != 1 else ''} in the {name}"
        for name, sphere, count in zip(
            ("target", "source"), (target, source), triplets, strict=True
        )
        if count == 0
    ]
    if poor:
        hint = (
            ""
            if params.zero_rotation != "none"
            else ' (or rotation.zero_rotation = "z", if the views are not turned about Z)'
        )
        return RotationSearch(
            *empty,
            status="underdetermined",
            reason=f"{' and '.join(poor)}: three that are not coplanar are needed{hint}",
        )
    constraints = f"within {params.angle_tolerance_rad:g} rad"
    if params.min_area_ratio > 0.0:
        constraints += f", areas alike to {params.min_area_ratio:.0%}"
    if params.distance_tolerance_mm is not None:
        constraints += f", centroids as far apart within {params.distance_tolerance_mm:g} mm"
    return RotationSearch(
        *empty,
        status="failed",
        reason=f"none of the {triplets[0]} triplets of normals of the target makes the same angles "
        f"as one of the {triplets[1]} of the source, {constraints}",
    )
