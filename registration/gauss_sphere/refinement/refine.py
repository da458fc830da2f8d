"""The pose that makes pairs of planes most likely, with its information."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import RefineParams
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.holding import held_where_it_is, hold
from registration.gauss_sphere.refinement.plane_pairs import (
    Difference,
    compare,
    no_difference,
    squared_distance,
)
from registration.gauss_sphere.small_matrices import apply_step, solve_damped6
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

ROUGHLY, EXACTLY = 1e-3, 1e-6  # gain in log likelihood at which a maximum is reached
WIDENING_STEPS, LEAST_FLOOR_MM = 16, 1e-4


class Likelihood(NamedTuple):
    """RefineParams as the compiled loops take them."""

    rounds: int
    tail: float
    lever_mm: float
    consistent_distance2: float
    consistent_share: float
    capped_distance2: float
    widest_mm: float
    held_mm: float
    held_rad: float


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
        params.held_mm,
        params.held_rad,
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
    doubt: float,
) -> float:
    """The information under the least systematic error that explains the planes' disagreement.

    Maximising sharpens on the planes that agree; how sure the pose is must be told by all: their
    squared distances sum to the degrees of freedom, at most, or the error of every plane is larger.

    information: (6, 6) out, for a floor of floor_mm or more, which is returned. doubt: standard
    deviations over the degrees of freedom that the squared distances may sum to before it is more.
    """
    gradient, distance2, difference = np.empty(6), np.empty(pairs.shape[0]), no_difference()
    freedom = max(3 * pairs.shape[0] - 6, 1)
    low, high = floor_mm, max(likely.widest_mm, floor_mm)
    floor, used = low, low
    for step in range(WIDENING_STEPS):
        used = floor
        _accumulate(
            target, source, pairs, likely, used, r, t, information, gradient, distance2, difference
        )
        total = 0.0
        for d2 in distance2:
            total += min(d2, likely.capped_distance2)
        if step == 0 and total <= freedom + doubt * np.sqrt(2.0 * freedom):
            break
        if total > freedom:
            low = max(floor, LEAST_FLOOR_MM)
        else:
            high = floor
        floor = np.sqrt(low * high)
    return float(used)


@compiled
def distances2(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    floor_mm: float,
    r: FloatArray,
    t: FloatArray,
) -> FloatArray:
    """(m,) squared Mahalanobis distances of pairs of planes (m, 2) under a pose."""
    hessian, gradient, distance2 = np.empty((6, 6)), np.empty(6), np.empty(pairs.shape[0])
    _accumulate(
        target, source, pairs, likely, floor_mm, r, t, hessian, gradient, distance2, no_difference()
    )
    return distance2


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
    nuisances. A heavy tail keeps single wrong pairs from bending the pose. Its rotation, and the
    middle of the matched surface, are held, softly, where they are: along a direction that no plane
    fixes, the noise of the normals would carry the pose away. The information is that of the
    planes alone.

    pairs: (m, 2) target and source patch.  floor_mm: systematic error of a plane's offset, and over
    the lever of its tilt, added to every covariance.  r (3, 3), t (3,): the pose, changed in place.
    information: (6, 6) out, of a perturbation (rad, mm) on the left, about the target's origin.
    distance2: (m,) or longer, out: squared Mahalanobis distances, three degrees of freedom each.
    enough: gain in log likelihood below which a step is the last.
    """
    hessian, gradient = np.zeros((6, 6)), np.zeros(6)
    lower, planes_alone, step = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    trial_r, trial_t = r.copy(), t.copy()
    damping = 1e-4
    held = held_where_it_is(target, pairs, r, t, likely.held_mm, likely.held_rad)
    difference = no_difference()
    cost = _accumulate(
        target, source, pairs, likely, floor_mm, r, t, hessian, gradient, distance2, difference
    )
    information[:] = hessian
    hold(held, r, t, hessian, gradient)
    for _ in range(likely.rounds):
        solve_damped6(hessian, gradient, damping, lower, step)
        # No step may turn further than the linearisation holds.
        turn = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        if turn > 0.2:
            step *= 0.2 / turn
        apply_step(step, r, t, trial_r, trial_t)
        trial = _accumulate(
            target, source, pairs, likely, floor_mm, trial_r, trial_t, hessian, gradient, distance2,
            difference,
        )  # fmt: skip
        planes_alone[:] = hessian
        trial += hold(held, trial_r, trial_t, hessian, gradient)
        if trial <= cost:
            gain = cost - trial
            cost = trial
            r[:] = trial_r
            t[:] = trial_t
            information[:] = planes_alone
            damping = max(damping * 0.1, 1e-9)
            if gain < enough:
                break
        else:
            damping *= 100.0
            _accumulate(
                target, source, pairs, likely, floor_mm, r, t, hessian, gradient, distance2,
                difference,
            )  # fmt: skip
            hold(held, r, t, hessian, gradient)
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
    difference: Difference,
) -> float:
    """The cost of a pose, its gradient and Gauss-Newton Hessian.  difference: to work in."""
    tail, tilt_floor = likely.tail, floor_mm / likely.lever_mm
    hessian[:] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    weight, pull, jacobian = difference.weight, difference.pull, difference.jacobian
    for m in range(pairs.shape[0]):
        i, k = pairs[m, 0], pairs[m, 1]
        compare(target, i, source, k, r, t, tilt_floor, floor_mm, difference)
        d2 = squared_distance(difference)
        distance2[m] = d2
        # Cauchy: cost tail log(1 + d2 / tail).
        robust = 1.0 / (1.0 + d2 / tail)
        cost += tail * np.log1p(d2 / tail)
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
