"""How well a pose is known, and the directions that it leaves open."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from registration.gauss_sphere.params import DecisionParams
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.holding import middle_of_pairs
from registration.gauss_sphere.refinement.matching import Settled
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

NOTHING_OPEN = np.zeros((0, 6))


def uncertainty(
    pose: Settled, known: FloatArray, target: View, params: DecisionParams
) -> tuple[FloatArray | None, FloatArray, str]:
    """Covariance, open directions (k, 6) and their description, of a pose known as well as that.

    known: (6, 6) its information.

    Directions are judged about the middle of the matched surface, where turns and shifts are
    nearly independent, in units of params.open_rad and params.open_mm; covariance and directions
    are of a perturbation on the left about the target's origin.
    """
    scale = params.open_rad, params.open_mm
    values, vectors, moved, covariance = _principal(target.patches, pose.pairs, known, *scale)
    loose = values < 1.0
    if not loose.any():
        return covariance, NOTHING_OPEN, ""
    directions = moved[:, loose].T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    names = [_describe(vectors[:, i], values[i], *scale) for i in np.flatnonzero(loose)]
    reason = (
        f"{pose.pairs.shape[0]} matched planes leave {len(names)} of 6 directions open: "
        + "; ".join(names)
    )
    return None, directions, reason


def open_directions_of(pose: Settled, target: View, params: DecisionParams) -> FloatArray:
    """(k, 6) the directions that a pose leaves open, by what it is sure of."""
    return uncertainty(pose, pose.sure, target, params)[1]


def open_shift(pose: Settled, target: View, params: DecisionParams) -> FloatArray | None:
    """(3,) the direction of the shift that planes leave open, if that is all they leave open."""
    open_directions = open_directions_of(pose, target, params)
    if open_directions.shape[0] != 1:
        return None
    turn, shift = open_directions[0, :3], open_directions[0, 3:]
    along: FloatArray = shift + np.cross(turn, centre_of(pose, target))
    length = np.linalg.norm(along)
    if np.linalg.norm(turn) * params.open_mm > length * params.open_rad:
        return None
    return along / length


def covariance_of(pose: Settled, target: View, params: DecisionParams) -> FloatArray | None:
    """Covariance of a pose, or None where its planes leave a direction open or none are known."""
    return uncertainty(pose, pose.sure, target, params)[0] if pose.pairs.size else None


def widest_covariance_of(pose: Settled, target: View, params: DecisionParams) -> FloatArray | None:
    """The same where parameters call a direction open: None only if one is not known at all."""
    scale = params.open_rad, params.open_mm
    values, _, _, covariance = _principal(target.patches, pose.pairs, pose.sure, *scale)
    return covariance if values[0] > 0.0 else None


def open_units(pose: Settled, target: View, params: DecisionParams) -> FloatArray:
    """(6, 6) perturbations about the target's origin, a column each, that are of one unit of
    params.open_rad or params.open_mm about the middle of the matched surface."""
    return _units(centre_of(pose, target), params.open_rad, params.open_mm)


def centre_of(pose: Settled, target: View) -> FloatArray:
    """(3,) middle in mm of the surface that a pose matches, in the target's frame."""
    return middle_of_pairs(target.patches, pose.pairs)


def is_elsewhere(
    pose: Settled, best: Settled, directions: FloatArray, target: View, params: DecisionParams
) -> bool:
    """Whether a pose differs from the best one by more than a motion along open directions (k, 6).

    A large turn is taken for one about its axis, however far it goes.
    """
    turn = Rotation.from_matrix(pose.rotation @ best.rotation.T)
    centre = centre_of(best, target)
    moved = turn.apply(centre - best.shift_mm) + pose.shift_mm - centre
    step = np.concatenate([turn.as_rotvec() / params.open_rad, moved / params.open_mm])
    along = np.linalg.solve(open_units(best, target, params), directions.T)
    along /= np.linalg.norm(along, axis=0)
    step -= along @ (along.T @ step)  # they are at right angles in these units
    return bool(
        np.linalg.norm(step[:3]) * params.open_rad > params.distinct_rad
        or np.linalg.norm(step[3:]) * params.open_mm > params.distinct_mm
    )


@compiled
def _units(centre: FloatArray, open_rad: float, open_mm: float) -> FloatArray:
    # v = v_centre - w x centre: v_centre is what the perturbation (w, v) moves the centre by.
    units, (x, y, z) = np.zeros((6, 6)), centre
    for u in range(3):
        units[u, u], units[3 + u, 3 + u] = open_rad, open_mm
    units[3, 1], units[3, 2] = -z * open_rad, y * open_rad
    units[4, 0], units[4, 2] = z * open_rad, -x * open_rad
    units[5, 0], units[5, 1] = -y * open_rad, x * open_rad
    return units


@compiled
def _principal(
    patches: Patches, pairs: IntArray, known: FloatArray, open_rad: float, open_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What is known (6, 6) in its principal directions, the least known first.

    Returns their information (6,), the directions (6, 6), a column each, in units of open_rad and
    open_mm about the middle of the matched surface and as they are about the origin, and the
    covariance about it, of no meaning where one of them is not known.
    """
    units = _units(middle_of_pairs(patches, pairs), open_rad, open_mm)
    values, vectors = np.linalg.eigh(units.T @ known @ units)
    moved = units @ vectors
    deviations = moved / np.sqrt(values)
    covariance = deviations @ deviations.T
    return values, vectors, moved, 0.5 * (covariance + covariance.T)


def sliding(patches: Patches) -> FloatArray:
    """(3, 6) what parallel planes leave open: a turn about their normal, shifts along them."""
    normal, centre = patches.normal[0], patches.centroid_mm[0]
    directions = np.zeros((3, 6))
    directions[0, :3] = normal
    directions[0, 3:] = -np.cross(normal, centre)  # the turn is about the plane's middle
    directions[1:, 3:] = patches.basis[0]
    rows: FloatArray = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return rows


def _describe(vector: FloatArray, value: float, open_rad: float, open_mm: float) -> str:
    turn, shift = np.linalg.norm(vector[:3]), np.linalg.norm(vector[3:])
    sigma = 1.0 / np.sqrt(max(value, 1e-12))
    kind, part, unit = (
        ("turn about", vector[:3], "degrees") if turn > shift else ("shift along", vector[3:], "mm")
    )
    size = sigma * (np.rad2deg(open_rad) if turn > shift else open_mm)
    axis = ", ".join(f"{c:.2f}" for c in part / np.linalg.norm(part))
    known = f"known to {size:.0f} {unit}" if sigma < 100.0 else "unknown"
    return f"{kind} ({axis}) {known}"
