"""How well a pose is known, and the directions that it leaves open."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.matching import Settled
from registration.gauss_sphere.params import DecisionParams
from registration.gauss_sphere.patches import Patches
from registration.gauss_sphere.view import View
from registration.scan import FloatArray


def uncertainty(
    pose: Settled, known: FloatArray, target: View, params: DecisionParams
) -> tuple[FloatArray | None, FloatArray, str]:
    """Covariance, open directions (k, 6) and their description, of a pose known as well as that.

    known: (6, 6) its information.

    Directions are judged about the middle of the matched surface, where turns and shifts are
    nearly independent, in units of params.open_rad and params.open_mm; covariance and directions
    are of a perturbation on the left about the target's origin.
    """
    units, scale = open_units(pose, target, params), _scale(params)
    values, vectors = np.linalg.eigh(units.T @ known @ units)
    loose = values < 1.0
    if not loose.any():
        deviations = units @ vectors / np.sqrt(values)
        return deviations @ deviations.T, np.zeros((0, 6)), ""
    directions = (units @ vectors[:, loose]).T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    names = [_describe(vectors[:, i], values[i], scale) for i in np.flatnonzero(loose)]
    reason = (
        f"{pose.pairs.shape[0]} matched planes leave {len(names)} of 6 directions open: "
        + "; ".join(names)
    )
    return None, directions, reason


def covariance_of(pose: Settled, target: View, params: DecisionParams) -> FloatArray | None:
    """Covariance of a pose, or None where its planes leave a direction open or none are known."""
    return uncertainty(pose, pose.sure, target, params)[0] if pose.pairs.size else None


def open_units(pose: Settled, target: View, params: DecisionParams) -> FloatArray:
    """(6, 6) perturbations about the target's origin, a column each, that are of one unit of
    params.open_rad or params.open_mm about the middle of the matched surface."""
    # v = v_centre - w x centre: v_centre is what the perturbation (w, v) moves the centre by.
    about_origin = np.eye(6)
    about_origin[3:, :3] = _cross(centre_of(pose, target))
    return about_origin * _scale(params)


def _scale(params: DecisionParams) -> FloatArray:
    return np.array([params.open_rad] * 3 + [params.open_mm] * 3)


def centre_of(pose: Settled, target: View) -> FloatArray:
    """(3,) middle in mm of the surface that a pose matches, in the target's frame."""
    weight = target.patches.area_mm2[pose.pairs[:, 0]]
    centre: FloatArray = weight @ target.patches.centroid_mm[pose.pairs[:, 0]] / weight.sum()
    return centre


def sliding(patches: Patches) -> FloatArray:
    """(3, 6) what parallel planes leave open: a turn about their normal, shifts along them."""
    normal, centre = patches.normal[0], patches.centroid_mm[0]
    directions = np.zeros((3, 6))
    directions[0, :3] = normal
    directions[0, 3:] = -np.cross(normal, centre)  # the turn is about the plane's middle
    directions[1:, 3:] = patches.basis[0]
    rows: FloatArray = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return rows


def _describe(vector: FloatArray, value: float, scale: FloatArray) -> str:
    turn, shift = np.linalg.norm(vector[:3]), np.linalg.norm(vector[3:])
    sigma = 1.0 / np.sqrt(max(value, 1e-12))
    kind, part, unit = (
        ("turn about", vector[:3], "degrees") if turn > shift else ("shift along", vector[3:], "mm")
    )
    size = sigma * (np.rad2deg(scale[0]) if turn > shift else scale[3])
    axis = ", ".join(f"{c:.2f}" for c in part / np.linalg.norm(part))
    known = f"known to {size:.0f} {unit}" if sigma < 100.0 else "unknown"
    return f"{kind} ({axis}) {known}"


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
