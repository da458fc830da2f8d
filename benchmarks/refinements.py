"""What other ways to a pose would give in gauss_sphere: weighted SVD and point-to-plane.

python benchmarks/refinements.py [--pairs N] [--seed N]

Views are those of configs/random_pairs.yaml with another seed, calibrated. Each way starts from the
planes that the answers matched, so that only the last step differs; errors are in units of the
Cramer-Rao bound from all points.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

import argparse  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import replace  # noqa: E402
from functools import partial  # noqa: E402
from typing import NamedTuple  # noqa: E402

import numpy as np  # noqa: E402
from missing_returns import PARAMS, trials_of  # noqa: E402
from scipy.spatial import KDTree  # noqa: E402
from scipy.spatial.transform import RigidTransform, Rotation  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.execution import perform  # noqa: E402
from harness.scoring.bound import parameter_deviations  # noqa: E402
from harness.scoring.poses import (  # noqa: E402
    COARSE,
    Tolerance,
    is_success,
    parameter_errors,
    pose_error,
    six_parameters,
)
from registration import Scan, register  # noqa: E402
from registration.gauss_sphere.evidence import PlaneEvidence  # noqa: E402
from registration.gauss_sphere.view import View  # noqa: E402
from registration.result import RegistrationResult  # noqa: E402
from registration.scan import FloatArray  # noqa: E402

PIECES = replace(PARAMS, whole_planes=replace(PARAMS.whole_planes, most_floor_mm=0.0))
LEVER_MM = 500.0  # as in the bound: so far away a turn counts as a shift
NEAR_MM = 15.0  # points of one face, seen by both views, lie so close together
STEPS = 5


class Drawn(NamedTuple):
    """Target and source, the truth, and the bound (6, 6) from all points of shared faces."""

    scans: tuple[Scan, Scan]
    T_exact: RigidTransform
    bound: FloatArray


class Pair(NamedTuple):
    """A pair that was answered right: the truth, and what two runs of the method made of it.

    deviations: (6,) the bound's, of psi, phi, theta (deg) and x, y, z (mm).
    T_pieces: by the likelihood over plane pairs alone; T_whole: the answer, by whole planes.
    seen: views and matched planes of the former. condition: the largest standard deviation of its
    covariance by the least, about the middle of these planes, a radian counting as LEVER_MM.
    """

    T_exact: RigidTransform
    deviations: FloatArray
    T_pieces: RigidTransform
    T_whole: RigidTransform
    seen: PlaneEvidence
    condition: float


Way = Callable[[Pair], RigidTransform]


def normals_by_svd(target: FloatArray, source: FloatArray, weight: FloatArray) -> Rotation:
    """The rotation that takes normals (m, 3) of the source to the target's, by weighted SVD.

    Source: K. S. Arun, T. S. Huang, S. D. Blostein, PAMI 9 (1987) 698.
    """
    u, _, vt = np.linalg.svd((weight[:, None] * target).T @ source)
    return Rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def alike(pair: Pair) -> FloatArray:
    return np.ones(len(pair.seen.pairs))


def by_area(pair: Pair) -> FloatArray:
    i, k = pair.seen.pairs.T
    return np.minimum(pair.seen.target.patches.area_mm2[i], pair.seen.source.patches.area_mm2[k])


def by_certainty(pair: Pair) -> FloatArray:
    """The inverse of the mean variance of both normals' tilts."""
    tilt = [
        view.patches.covariance[of, :2, :2].trace(axis1=1, axis2=2)
        for view, of in zip((pair.seen.target, pair.seen.source), pair.seen.pairs.T, strict=True)
    ]
    return 2.0 / (tilt[0] + tilt[1])


def svd_and_plane_distances(weights: Callable[[Pair], FloatArray], pair: Pair) -> RigidTransform:
    """The rotation by SVD, then the shift by n . t = d at the middles of the source's planes.

    Each distance is as certain as both planes are there; where weights are equal, all count alike.
    """
    a, b, (i, k) = pair.seen.target.patches, pair.seen.source.patches, pair.seen.pairs.T
    turn = normals_by_svd(a.normal[i], b.normal[k], weights(pair))
    middle_mm = turn.apply(b.centroid_mm[k]) - a.centroid_mm[i]
    distance_mm = -np.einsum("mi,mi->m", a.normal[i], middle_mm)
    root = np.ones(len(i))
    if weights is not alike:
        away_mm = middle_mm + pair.T_pieces.translation
        lever = np.c_[np.einsum("mvi,mi->mv", a.basis[i], away_mm), -np.ones(len(i))]
        at_target = np.einsum("mu,muv,mv->m", lever, a.covariance[i], lever)
        root = 1.0 / np.sqrt(at_target + b.covariance[k, 2, 2])
    shift_mm = np.linalg.lstsq(root[:, None] * a.normal[i], root * distance_mm)[0]
    return RigidTransform.from_components(shift_mm, turn)


def points_of(view: View, patch: int) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) of a patch in mm, and their variances along its normal."""
    fan, chosen = view.fan, view.patches.label == patch
    x_mm = np.broadcast_to(fan.x_mm[:, None], chosen.shape)[chosen]
    slope, depth_mm = fan.slope[chosen], fan.depth_mm[chosen]
    points_mm = np.stack(
        [
            x_mm,
            fan.apex_mm[1] + slope * depth_mm + fan.lean[0] * x_mm,
            fan.apex_mm[2] + depth_mm + fan.lean[1] * x_mm,
        ],
        axis=1,
    )
    beam = np.stack([np.zeros_like(slope), slope, np.ones_like(slope)], axis=1)
    return points_mm, (fan.sigma_mm[chosen] * (beam @ view.patches.normal[patch])) ** 2


def point_to_plane(both_ways: bool, common_only: bool, pair: Pair) -> RigidTransform:
    """Points of matched planes on the other view's planes, weighted by noise, by Gauss-Newton.

    both_ways: the target's points, too. common_only: points near to one of the other view only.
    """
    pose = pair.T_pieces
    views = pair.seen.target, pair.seen.source
    terms = []
    for i, k in pair.seen.pairs:
        clouds = [points_of(view, of) for view, of in zip(views, (i, k), strict=True)]
        if common_only:
            moved = clouds[0][0], pose.apply(clouds[1][0])
            near = [
                np.isfinite(KDTree(moved[1 - w]).query(moved[w], distance_upper_bound=NEAR_MM)[0])
                for w in (0, 1)
            ]
            clouds = [(p[n], v[n]) for (p, v), n in zip(clouds, near, strict=True)]
        terms.append((i, k, clouds))
    for _ in range(STEPS):
        hessian, gradient = np.zeros((6, 6)), np.zeros(6)
        for i, k, clouds in terms:
            a, b = views[0].patches, views[1].patches
            moved = pose.apply(clouds[1][0])
            parts = [(moved, a.normal[i], moved @ a.normal[i] - a.offset_mm[i], clouds[1][1])]
            if both_ways:
                # A move of the pose does to a plane of the source what it does to points on it.
                normal = pose.rotation.apply(b.normal[k])
                offset = b.offset_mm[k] + normal @ pose.translation
                parts.append((clouds[0][0], normal, offset - clouds[0][0] @ normal, clouds[0][1]))
            for points, normal, residual, variance in parts:
                jacobian = np.c_[np.cross(points, normal), np.broadcast_to(normal, points.shape)]
                weighted = jacobian / variance[:, None]
                hessian += weighted.T @ jacobian
                gradient += weighted.T @ residual
        # Angles scaled, or the matrix is near to singular by its units alone.
        scale = np.array([1.0 / LEVER_MM] * 3 + [1.0] * 3)
        step = -scale * np.linalg.lstsq(hessian * np.outer(scale, scale), scale * gradient)[0]
        pose = RigidTransform.from_components(step[3:], Rotation.from_rotvec(step[:3])) * pose
    return pose


WAYS: dict[str, Way] = {
    "normals by SVD, planes alike": partial(svd_and_plane_distances, alike),
    "normals by SVD, by area": partial(svd_and_plane_distances, by_area),
    "normals by SVD, by certainty": partial(svd_and_plane_distances, by_certainty),
    "points of the source to planes": partial(point_to_plane, False, False),
    "points of both to planes": partial(point_to_plane, True, False),
    "points of both to planes, common ones": partial(point_to_plane, True, True),
    "likelihood over plane pairs": lambda pair: pair.T_pieces,
    "and whole planes (`gauss_sphere`)": lambda pair: pair.T_whole,
}


def agreeing(seen: PlaneEvidence) -> PlaneEvidence:
    """Without the pairs that the likelihood's tail counts for less than half: ways have no tail."""
    return replace(seen, pairs=seen.pairs[seen.distance2 < seen.params.refine.tail])


def condition_of(covariance: FloatArray, middle_mm: FloatArray) -> float:
    """Of a covariance (6, 6) about the origin, moved to a point: see Pair."""
    about = np.eye(6)
    about[3:, :3] = np.cross(np.eye(3), middle_mm).T  # a turn w moves the point by w x middle
    scale = np.array([LEVER_MM] * 3 + [1.0] * 3)
    values = np.linalg.eigvalsh(np.outer(scale, scale) * (about @ covariance @ about.T))
    return float(np.sqrt(values[-1] / values[0]))


def drawn_pairs(count: int, seed: int) -> list[Drawn]:
    """So many pairs of each family."""
    drawn = []
    for trial in trials_of(count, seed):
        row, pair = (outcome := perform(trial)).row, outcome.pair
        if pair is None or row.bounds is None:
            raise RuntimeError(f"{trial.pair}: {row.status}: {row.reason}")
        drawn.append(Drawn((pair.target, pair.source), pair.T_target_source_exact, row.bounds[0]))
    return drawn


def answered(drawn: Drawn) -> Pair | None:
    """What two runs answer, None where either is not right, or the bound not finite."""
    runs = [register(*drawn.scans, params=params) for params in (PIECES, PARAMS)]
    right = all(is_right(result, drawn.T_exact, COARSE) for result in runs)
    if not (right and np.isfinite(drawn.bound).all()):
        return None
    seen = agreeing(runs[0].evidence["planes"])
    middle_mm = seen.target.patches.centroid_mm[seen.pairs[:, 0]].mean(axis=0)
    deviations = parameter_deviations(drawn.bound, drawn.T_exact)
    condition = condition_of(runs[0].covariance, middle_mm)
    return Pair(drawn.T_exact, deviations, *(r.T_target_source for r in runs), seen, condition)


def is_right(result: RegistrationResult, T_exact: RigidTransform, tolerance: Tolerance) -> bool:
    pose = result.T_target_source
    error = None if pose is None else pose_error(T_exact, pose)
    return result.status == "ok" and is_success(error, tolerance)


def errors_table(pairs: list[Pair]) -> str:
    """Errors of each way, and the largest of six RMSE / bound by how well conditioned pairs are."""
    order = np.argsort([pair.condition for pair in pairs])
    thirds = np.array_split(order, 3)
    rows = []
    for name, way in WAYS.items():
        poses = [way(pair) for pair in pairs]
        errors = [pose_error(pair.T_exact, pose) for pair, pose in zip(pairs, poses, strict=True)]
        ratios = np.array(
            [
                parameter_errors(six_parameters(pair.T_exact), six_parameters(pose))
                / pair.deviations
                for pair, pose in zip(pairs, poses, strict=True)
            ]
        )
        angle_deg = np.rad2deg([error.rotation_rad for error in errors])
        shift_mm = np.array([error.translation_mm for error in errors])
        rows.append(
            [
                name,
                *(f"{np.quantile(angle_deg, q):.3f}" for q in (0.5, 0.9)),
                *(f"{np.quantile(shift_mm, q):.3f}" for q in (0.5, 0.9)),
                *(f"{np.sqrt((ratios[third] ** 2).mean(axis=0)).max():.2f}" for third in thirds),
            ]
        )
    limits = [pairs[third[-1]].condition for third in thirds]
    headers = [
        "pose by", "rotation median (°)", "90 %", "translation median (mm)", "90 %",
        *(f"RMSE / bound, condition up to {limit:.0f}" for limit in limits),
    ]  # fmt: skip
    return tabulate(rows, headers, "github", disable_numparse=True)


def options_of(description: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=100, help="of each family")
    parser.add_argument("--seed", type=int, default=20108)
    return parser.parse_args()


def main() -> None:
    options = options_of(__doc__)
    drawn = drawn_pairs(options.pairs, options.seed)
    pairs = [pair for each in drawn if (pair := answered(each)) is not None]
    print(f"{len(pairs)} of {len(drawn)} pairs answered right\n\n{errors_table(pairs)}")


if __name__ == "__main__":
    main()
