"""The pose that makes pairs of planes most likely, with its information."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import RefineParams
from registration.gauss_sphere.patches import Patches
from registration.gauss_sphere.small_matrices import (
    apply_step,
    invert_symmetric3,
    solve_damped6,
)
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

ROUGHLY, EXACTLY = 1e-3, 1e-6  # gain in log likelihood at which a maximum is reached
WIDENING_STEPS = 16


class Likelihood(NamedTuple):
    """RefineParams as the compiled loops take them."""

    rounds: int
    tail: float
    lever_mm: float
    consistent_distance2: float
    consistent_share: float
    capped_distance2: float
    widest_mm: float


def likelihood(params: RefineParams) -> Likelihood:
    """The parameters that decide how the pose is refined."""
    return Likelihood(
        params.rounds,
        params.tail,
        params.floor_lever_mm,
        params.consistent_distance2,
        params.consistent_share,
        params.capped_distance2,
        params.widest_mm,
    )


@compiled
def maximise_consistently(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    floors_mm: FloatArray,
    r: FloatArray,
    t: FloatArray,
    information: FloatArray,
    distance2: FloatArray,
) -> float:
    """Maximise with the smallest systematic error under which most of the surface agrees.

    The noise alone makes large planes so certain that an uncorrected bias of the sensor looks like
    a contradiction among them, and the pose would follow the few that happen to agree. The floor
    that is needed is returned; it is part of the information, so the answer's covariance has it.
    """
    n_floors = floors_mm.size
    poses_r, poses_t = np.empty((n_floors, 3, 3)), np.empty((n_floors, 3))
    used = n_floors - 1
    # From the largest floor down, each from the pose of the one before: the planes' agreement
    # sharpens step by step, and a few that agree by chance do not catch the pose.
    for f in range(n_floors - 1, -1, -1):
        maximise(target, source, pairs, likely, floors_mm[f], r, t, information, distance2, ROUGHLY)
        poses_r[f] = r
        poses_t[f] = t
        agreeing, total, n_agreeing = 0.0, 0.0, 0
        for m in range(pairs.shape[0]):
            area = min(target.area_mm2[pairs[m, 0]], source.area_mm2[pairs[m, 1]])
            total += area
            if distance2[m] < likely.consistent_distance2:
                agreeing += area
                n_agreeing += 1
        enough = n_agreeing == pairs.shape[0] or n_agreeing >= 4
        if enough and agreeing >= likely.consistent_share * total:
            used = f
    r[:] = poses_r[used]
    t[:] = poses_t[used]
    maximise(target, source, pairs, likely, floors_mm[used], r, t, information, distance2, EXACTLY)
    return float(floors_mm[used])


@compiled
def widened(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    floor_mm: float,
    r: FloatArray,
    t: FloatArray,
    information: FloatArray,
) -> None:
    """The information under the least systematic error that explains the planes' disagreement.

    Maximising sharpens on the planes that agree; how sure the pose is must be told by all: their
    squared distances sum to the degrees of freedom, at most, or the error of every plane is larger.

    information: (6, 6) out, for a floor of floor_mm or more.
    """
    gradient, distance2 = np.empty(6), np.empty(pairs.shape[0])
    freedom = max(3 * pairs.shape[0] - 6, 1)
    low, high = floor_mm, max(likely.widest_mm, floor_mm)
    floor = low
    for step in range(WIDENING_STEPS):
        _accumulate(target, source, pairs, likely, floor, r, t, information, gradient, distance2)
        total = 0.0
        for d2 in distance2:
            total += min(d2, likely.capped_distance2)
        if total > freedom:
            low = floor
        elif step == 0:
            break
        else:
            high = floor
        floor = np.sqrt(low * high)


@compiled
def maximise(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    floor_mm: float,
    r: FloatArray,
    t: FloatArray,
    information: FloatArray,
    distance2: FloatArray,
    enough: float,
) -> None:
    """Maximise the likelihood of matched planes, unknown in both views, over the pose.

    Each view has measured (tilt, tilt, offset) of a plane with the covariance of its own fit; under
    the pose their difference has the sum of both covariances. Gauss-Newton with
    Levenberg-Marquardt damping on it attains the Cramer-Rao bound with the plane parameters as
    nuisances. A heavy tail keeps single wrong pairs from bending the pose.

    pairs: (m, 2) target and source patch.  floor_mm: systematic error of a plane's offset, and over
    the lever of its tilt, added to every covariance.  r (3, 3), t (3,): the pose, changed in place.
    information: (6, 6) out, of a perturbation (rad, mm) on the left, about the target's origin.
    distance2: (m,) or longer, out: squared Mahalanobis distances, three degrees of freedom each.
    enough: gain in log likelihood below which a step is the last.
    """
    hessian, gradient = np.zeros((6, 6)), np.zeros(6)
    lower, step = np.zeros((6, 6)), np.zeros(6)
    trial_r, trial_t = r.copy(), t.copy()
    damping = 1e-4
    cost = _accumulate(target, source, pairs, likely, floor_mm, r, t, hessian, gradient, distance2)
    information[:] = hessian
    for _ in range(likely.rounds):
        solve_damped6(hessian, gradient, damping, lower, step)
        # No step may turn further than the linearisation holds.
        turn = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        if turn > 0.2:
            step *= 0.2 / turn
        apply_step(step, r, t, trial_r, trial_t)
        trial = _accumulate(
            target, source, pairs, likely, floor_mm, trial_r, trial_t, hessian, gradient, distance2
        )
        if trial <= cost:
            gain = cost - trial
            cost = trial
            r[:] = trial_r
            t[:] = trial_t
            information[:] = hessian
            damping = max(damping * 0.1, 1e-9)
            if gain < enough:
                break
        else:
            damping *= 100.0
            _accumulate(target, source, pairs, likely, floor_mm, r, t, hessian, gradient, distance2)
            if damping > 1e6:
                break


@compiled
def _accumulate(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    floor_mm: float,
    r: FloatArray,
    t: FloatArray,
    hessian: FloatArray,
    gradient: FloatArray,
    distance2: FloatArray,
) -> float:
    """The cost of a pose, its gradient and Gauss-Newton Hessian."""
    ca, ea, cov_a = target.centroid_mm, target.basis, target.covariance
    nb, cb, eb, cov_b = source.normal, source.centroid_mm, source.basis, source.covariance
    tail, offset_floor, tilt_floor = likely.tail, floor_mm, floor_mm / likely.lever_mm
    hessian[:] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    n, c, d = np.empty(3), np.empty(3), np.empty(3)
    f = np.empty((2, 3))
    map_b, mapped = np.empty((3, 3)), np.empty((3, 3))
    spread, weight = np.empty((3, 3)), np.empty((3, 3))
    jacobian, residual, pull = np.zeros((3, 6)), np.empty(3), np.empty(3)
    for m in range(pairs.shape[0]):
        i, k = pairs[m, 0], pairs[m, 1]
        for u in range(3):
            n[u] = r[u, 0] * nb[k, 0] + r[u, 1] * nb[k, 1] + r[u, 2] * nb[k, 2]
            c[u] = t[u] + r[u, 0] * cb[k, 0] + r[u, 1] * cb[k, 1] + r[u, 2] * cb[k, 2]
            for v in range(2):
                f[v, u] = r[u, 0] * eb[k, v, 0] + r[u, 1] * eb[k, v, 1] + r[u, 2] * eb[k, v, 2]
        # Source plane in the target patch's coordinates: two tilts, offset at its centroid.
        for u in range(3):
            d[u] = c[u] - ca[i, u]
        residual[2] = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
        for v in range(2):
            e = ea[i, v]
            residual[v] = e[0] * n[0] + e[1] * n[1] + e[2] * n[2]
            for w in range(2):
                map_b[v, w] = e[0] * f[w, 0] + e[1] * f[w, 1] + e[2] * f[w, 2]
            map_b[v, 2] = 0.0
            map_b[2, v] = f[v, 0] * d[0] + f[v, 1] * d[1] + f[v, 2] * d[2]
        map_b[2, 2] = 1.0
        # Covariance of the difference: cov_a + map_b cov_b map_b^T, map_b = [[m, 0], [l, 1]].
        for u in range(3):
            for v in range(3):
                mapped[u, v] = map_b[u, 0] * cov_b[k, 0, v] + map_b[u, 1] * cov_b[k, 1, v]
        for v in range(3):
            mapped[2, v] += cov_b[k, 2, v]
        for u in range(3):
            for v in range(u + 1):
                total = mapped[u, 0] * map_b[v, 0] + mapped[u, 1] * map_b[v, 1]
                if v == 2:
                    total += mapped[u, 2]
                spread[u, v] = cov_a[i, u, v] + total
                spread[v, u] = spread[u, v]
        spread[0, 0] += tilt_floor * tilt_floor
        spread[1, 1] += tilt_floor * tilt_floor
        spread[2, 2] += offset_floor * offset_floor
        invert_symmetric3(spread, weight)
        for u in range(3):
            pull[u] = 0.0
            for v in range(3):
                pull[u] += weight[u, v] * residual[v]
        d2 = residual[0] * pull[0] + residual[1] * pull[1] + residual[2] * pull[2]
        distance2[m] = d2
        # Cauchy: cost tail log(1 + d2 / tail).
        robust = 1.0 / (1.0 + d2 / tail)
        cost += tail * np.log1p(d2 / tail)
        for v in range(2):
            e = ea[i, v]
            jacobian[v, 0] = n[1] * e[2] - n[2] * e[1]
            jacobian[v, 1] = n[2] * e[0] - n[0] * e[2]
            jacobian[v, 2] = n[0] * e[1] - n[1] * e[0]
        # offset = n . (c - ca): n turns, c moves with the pose about the origin.
        jacobian[2, 0] = -(n[1] * ca[i, 2] - n[2] * ca[i, 1])
        jacobian[2, 1] = -(n[2] * ca[i, 0] - n[0] * ca[i, 2])
        jacobian[2, 2] = -(n[0] * ca[i, 1] - n[1] * ca[i, 0])
        for u in range(3):
            jacobian[2, 3 + u] = n[u]
        for u in range(6):
            j0, j1, j2 = jacobian[0, u], jacobian[1, u], jacobian[2, u]
            gradient[u] += robust * (j0 * pull[0] + j1 * pull[1] + j2 * pull[2])
            w0 = robust * (j0 * weight[0, 0] + j1 * weight[1, 0] + j2 * weight[2, 0])
            w1 = robust * (j0 * weight[0, 1] + j1 * weight[1, 1] + j2 * weight[2, 1])
            w2 = robust * (j0 * weight[0, 2] + j1 * weight[1, 2] + j2 * weight[2, 2])
            for v in range(u, 6):
                hessian[u, v] += w0 * jacobian[0, v] + w1 * jacobian[1, v] + w2 * jacobian[2, v]
    for u in range(6):
        for v in range(u):
            hessian[u, v] = hessian[v, u]
    return cost
