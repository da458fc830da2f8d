"""The Cramer-Rao bound of a pair: how exact a registration can be at best, whatever the method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from registration.scan import BoolArray, FloatArray, IntArray
from sensors.sensor import Hits

# Conditions are judged with angles times this length, so that both kinds compare in mm.
LEVER_MM = 500.0
WORST_CONDITION = 1e10


class Beams(NamedTuple):
    """What one view measured on the faces, all in the target's frame.

    points_mm: (n, 3) exact. beam: (n, 3) how a point moves when its depth grows by 1.
    normal: (n, 3) of its face. face: (n,) index. variance_mm2: (n,) of the depth.
    """

    points_mm: FloatArray
    beam: FloatArray
    normal: FloatArray
    face: IntArray
    variance_mm2: FloatArray


def beams_of(
    hits: Hits,
    apex_mm: FloatArray,
    variance_mm2: FloatArray,
    counted: BoolArray,
    T_target_view: RigidTransform,
) -> Beams:
    """The counted beams of a view that was taken along a straight line.

    apex_mm: (3,) where the beams of a profile meet, in the sensor frame.
    variance_mm2, counted: (profiles, pixels).
    """
    chosen = counted & hits.valid
    points_mm = hits.points_mm[chosen]
    from_apex_mm = points_mm - apex_mm - hits.origins_mm[np.nonzero(chosen)[0]]
    reach_mm = from_apex_mm[:, 2]
    beam = np.stack(
        [
            np.zeros(len(reach_mm)),
            from_apex_mm[:, 1] / reach_mm,
            np.ones(len(reach_mm)),
        ],
        axis=1,
    )
    turn = T_target_view.rotation
    return Beams(
        T_target_view.apply(points_mm),
        turn.apply(beam),
        turn.apply(hits.normal[chosen]),
        hits.surface[chosen],
        variance_mm2[chosen],
    )


def pose_information(target: Beams, source: Beams) -> FloatArray:
    """Fisher information (6, 6) that two views hold on their pose, the faces being unknown planes.

    Of a perturbation (rotation vector w in rad, translation t in mm) on the left of
    T_target_source, so in the target's frame, as RegistrationResult.covariance is. Derivation: a
    face is the plane n . (p - c) = 0, with c a point of it and e1, e2 tangents. Let a = (a1, a2,
    a3) be its unknown deviation, n -> n + a1 e1 + a2 e2 and the plane moved by a3 along n. To first
    order, the residual of a point p of it is g . a with g = (e1 . (p - c), e2 . (p - c), -1), and
    an error of the depth of variance s^2 along the beam b changes it by (n . b) times as much. A
    view thus informs of a by

        I = sum g g^T / ((n . b) s)^2,

    which is I_T for the target's points. A perturbed pose moves the source's points by w x p + t,
    which changes their residuals by n . (w x p + t). For p on the plane this equals g . (M (w, t))
    with rows

        M = [(e1 x n, 0), (e2 x n, 0), (-(c x n), -n)],

    so the source's points inform of a + M (w, t), by I_S. The information on pose and planes
    together is [[M^T I_S M, M^T I_S], [I_S M, I_T + I_S]]; the Schur complement that removes the
    planes is, for each face,

        M^T (I_S - I_S (I_T + I_S)^-1 I_S) M = M^T I_T (I_T + I_S)^-1 I_S M.

    Faces are independent unknowns, so theirs add up; faces that only one view has add nothing.
    Two faces in one plane count as two planes. Noise is Gaussian and known. What the outlines of
    faces, missing points or intensities would tell is left out.
    """
    information = np.zeros((6, 6))
    for face in np.intersect1d(target.face, source.face).tolist():
        on_target, on_source = target.face == face, source.face == face
        centre_mm = target.points_mm[on_target].mean(axis=0)
        normal = target.normal[on_target][0]
        tangents = np.linalg.svd(normal[None, :])[2][1:]
        informed = [
            _plane_information(beams, of_face, centre_mm, normal, tangents)
            for beams, of_face in ((target, on_target), (source, on_source))
        ]
        both = informed[0] @ np.linalg.pinv(informed[0] + informed[1], hermitian=True) @ informed[1]
        moved = np.zeros((3, 6))
        moved[:2, :3] = np.cross(tangents, normal)
        moved[2, :3] = -np.cross(centre_mm, normal)
        moved[2, 3:] = -normal
        # Tilts count in units of 1 / LEVER_MM, so that the inverse above is well scaled.
        moved[:2] *= LEVER_MM
        information += moved.T @ both @ moved
    return 0.5 * (information + information.T)


def _plane_information(
    beams: Beams,
    of_face: BoolArray,
    centre_mm: FloatArray,
    normal: FloatArray,
    tangents: FloatArray,
) -> FloatArray:
    """Information (3, 3) on the deviation of a plane: two tilts times LEVER_MM, and its offset."""
    away_mm = beams.points_mm[of_face] - centre_mm
    g = np.column_stack([away_mm @ tangents.T / LEVER_MM, -np.ones(len(away_mm))])
    variance = beams.variance_mm2[of_face] * (beams.beam[of_face] @ normal) ** 2
    informed: FloatArray = (g / variance[:, None]).T @ g
    return informed


def pose_covariance(information: FloatArray) -> FloatArray | None:
    """The bound (6, 6) on the covariance of (rad, mm), or None when directions stay open."""
    scale = np.array([1.0 / LEVER_MM] * 3 + [1.0] * 3)
    scaled = information * np.outer(scale, scale)
    values = np.linalg.eigvalsh(scaled)
    if not values[0] > values[-1] / WORST_CONDITION:
        return None
    inverse = np.linalg.inv(scaled) * np.outer(scale, scale)
    covariance: FloatArray = 0.5 * (inverse + inverse.T)
    return covariance


def parameter_deviations(covariance: FloatArray, T_target_source: RigidTransform) -> FloatArray:
    """(6,) standard deviations of psi, phi, theta (deg) and x, y, z (mm) at a pose.

    covariance: (6, 6) of a perturbation (rad, mm) on the left. With R = Rz(theta) Ry(phi) Rx(psi),
    (4-6), a turn w changes the angles by E^-1 w, E holding the axes about which they turn; the
    translation T changes by w x T + t.
    """
    theta, phi, _ = T_target_source.rotation.as_euler("ZYX")
    about_z, about_y = np.array([0.0, 0.0, 1.0]), np.array([-np.sin(theta), np.cos(theta), 0.0])
    about_x = np.array([np.cos(theta) * np.cos(phi), np.sin(theta) * np.cos(phi), -np.sin(phi)])
    jacobian = np.eye(6)
    jacobian[:3, :3] = np.rad2deg(np.linalg.inv(np.column_stack([about_x, about_y, about_z])))
    x, y, z = T_target_source.translation
    jacobian[3:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    deviations: FloatArray = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
    return deviations
