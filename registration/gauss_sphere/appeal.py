"""Poses that planes alone leave in doubt, or outlines of faces deny, judged again by outlines.

Planes do not tell where along themselves they are seen, nor which of two like scenes is meant.
Outlines do: a face that ends in one view must end there in the other, if that sees the place.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from registration.gauss_sphere.bending import doubted
from registration.gauss_sphere.decision import is_thin
from registration.gauss_sphere.matching import Settled, different, settle_best
from registration.gauss_sphere.open_directions import centre_of, open_units, uncertainty
from registration.gauss_sphere.outlines import Outlines, as_ends, moved_outlines
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refine import distances2, likelihood
from registration.gauss_sphere.small_matrices import apply_step
from registration.gauss_sphere.testimony import ANY_WAY, said
from registration.gauss_sphere.verification import compared
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray

LIKE, SAME_WAY = 0.98, 0.95  # cosines between normals, and between outward directions
LEAST_SLANT = 0.3  # of an outline against a shift, to tell where along it
ROUNDS = 3
BARELY = 1e-9  # of the information: enough to solve for what stays open


def appealed(
    settled: list[Settled],
    target: View,
    source: View,
    outlines: tuple[Outlines, Outlines],
    bias_mm: float,
    params: GaussSphereParams,
) -> list[Settled]:
    """The settled poses, moved to where outlines coincide, without those that outlines deny.

    bias_mm: what is seen of a bias of the planes. None are left where outlines do not confirm the
    best of them, or few planes do.
    """
    how = params.outlines
    of_target, of_source = outlines
    starts = []
    for pose in settled:
        starts.extend(_starts(pose, target, of_target, of_source, params))
    rotations = np.array([r for r, _ in starts])
    shifts = np.array([t for _, t in starts])
    n = len(starts)
    all_of_them = replace(params.verification, ranked=n, kept=n, rough_stride=1)
    again = settle_best(
        target,
        source,
        rotations,
        shifts,
        replace(params, verification=all_of_them),
        look_again=False,
    )
    if bias_mm > 0.0:
        again = [doubted(p, target.patches, source.patches, bias_mm, params) for p in again]
    fixed = [_fixed(pose, target, source, of_target, of_source, params) for pose in again]
    poses = different(fixed, source, params.decision)
    needed = max(how.least, how.confirmed_share * (of_target.line.size + of_source.line.size))
    ends = as_ends(of_target), as_ends(of_source)
    words = [said(p.rotation, p.shift_mm, target, source, ends, ANY_WAY, how) for p in poses]
    shares = [denied / max(confirmed + denied, how.least) for confirmed, denied in words]
    sure = [share for share, (confirmed, _) in zip(shares, words, strict=True)
            if confirmed >= how.least]  # fmt: skip
    if not sure:
        return []
    most = min(sure) + how.dropped_share
    left = [k for k in range(len(poses)) if shares[k] <= most]
    first = left[0]
    if words[first][0] < needed or shares[first] > how.denied_share:
        return []
    if is_thin(poses[first], target, source, params.decision):
        return []
    return [poses[k] for k in left]


def _starts(
    pose: Settled,
    target: View,
    of_target: Outlines,
    of_source: Outlines,
    params: GaussSphereParams,
) -> list[tuple[FloatArray, FloatArray]]:
    """A pose, or where along the one shift that its planes leave open outlines coincide."""
    how, here = params.outlines, [(pose.rotation, pose.shift_mm)]
    _, open_directions, _ = uncertainty(pose, pose.sure, target, params.decision)
    if open_directions.shape[0] != 1:
        return here
    turn, shift = open_directions[0, :3], open_directions[0, 3:]
    along = shift + np.cross(turn, centre_of(pose, target))
    length = np.linalg.norm(along)
    if np.linalg.norm(turn) * params.decision.open_mm > length * params.decision.open_rad:
        return here
    along = along / length
    n = int(how.slide_mm / how.cell_mm)
    points = _coincide(
        of_target, moved_outlines(of_source, pose.rotation, pose.shift_mm), along, how.cell_mm, n,
        how.on_mm,
    )  # fmt: skip
    found: list[tuple[FloatArray, FloatArray]] = []
    most = max(points.max() * how.peak_share, how.least)
    while points.max() >= most and len(found) < params.verification.kept:
        k = int(points.argmax())
        found.append((pose.rotation, pose.shift_mm + (k - n) * how.cell_mm * along))
        near = int(params.decision.distinct_mm / how.cell_mm)
        points[max(k - near, 0) : k + near + 1] = 0.0
    return found or here


def _fixed(
    pose: Settled,
    target: View,
    source: View,
    of_target: Outlines,
    of_source: Outlines,
    params: GaussSphereParams,
) -> Settled:
    """The pose, moved by outlines and surer by them in what its planes leave open."""
    how, likely = params.outlines, likelihood(params.refine)
    planes = target.patches, source.patches
    _, open_directions, _ = uncertainty(pose, pose.sure, target, params.decision)
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
        _accumulate(of_target, there, gate_mm, how.on_mm, how.line_mm, information, gradient)
        if done < ROUNDS:
            curved = sure + information
            curved += BARELY * np.diag(np.diag(curved))
            # The planes go on pulling to where they had the pose.
            step[:] = -np.linalg.solve(curved, gradient + sure @ whole)
            whole += step
            new_r, new_t = np.empty((3, 3)), np.empty(3)
            apply_step(step, r, t, new_r, new_t)
            r, t = new_r, new_t
    areas, score = compared(
        target, source, r, t, params.match.tolerances_mm[-1], params.verification
    )
    moved_there = pose._replace(
        rotation=r,
        shift_mm=t,
        sure=sure + information,
        information=known + information,
        distance2=distances2(*planes, pose.pairs, likely, pose.floor_mm, r, t),
        areas=areas,
        score=score,
    )
    centre = centre_of(pose, target)
    ends = as_ends(of_target), as_ends(of_source)
    for direction in open_directions:
        across = direction[3:] + np.cross(direction[:3], centre)
        across = across / max(float(np.linalg.norm(across)), 1e-12)
        confirmed, denied = said(r, t, target, source, ends, across, how)
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


@compiled
def _coincide(
    of_target: Outlines, of_source: Outlines, along: FloatArray, cell: float, n: int, on_mm: float
) -> FloatArray:
    """(2 n + 1,) points of the source's outlines that lie on the target's, shift by shift."""
    points, last = np.zeros(2 * n + 1), np.full(2 * n + 1, -1)
    a, b = of_target, of_source
    slant = np.empty(a.line.size)
    for i in range(a.line.size):
        o = a.outward[i]
        slant[i] = o[0] * along[0] + o[1] * along[1] + o[2] * along[2]
    for k in range(b.line.size):
        m, normal = b.outward[k], b.normal[k]
        if abs(m[0] * along[0] + m[1] * along[1] + m[2] * along[2]) < LEAST_SLANT:
            continue
        for i in range(a.line.size):
            if abs(slant[i]) < LEAST_SLANT:
                continue
            same_way, like, over, ahead, aside, drift = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for u in range(3):
                d = a.point_mm[i, u] - b.point_mm[k, u]
                same_way += a.outward[i, u] * m[u]
                like += a.normal[i, u] * normal[u]
                over += a.normal[i, u] * d
                ahead += a.outward[i, u] * d
                aside += a.along[i, u] * d
                drift += a.along[i, u] * along[u]
            if same_way < SAME_WAY or like < LIKE or abs(over) > on_mm:
                continue
            shift = ahead / slant[i]
            if abs(aside - shift * drift) > on_mm:
                continue
            c = int(np.floor(shift / cell + 0.5)) + n
            for v in range(max(c - 1, 0), min(c + 2, 2 * n + 1)):
                if last[v] != k:
                    last[v] = k
                    points[v] += 1.0
    return points


@compiled
def _accumulate(
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
            same_way, like, over, ahead, away2 = 0.0, 0.0, 0.0, 0.0, 0.0
            for u in range(3):
                d = a.point_mm[i, u] - b.point_mm[k, u]
                away2 += d * d
                same_way += a.outward[i, u] * b.outward[k, u]
                like += a.normal[i, u] * b.normal[k, u]
                over += a.normal[i, u] * d
                ahead += a.outward[i, u] * d
            if away2 > nearest2 or same_way < SAME_WAY or like < LIKE:
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
