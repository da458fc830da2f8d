"""How far an estimate is from the truth: pure functions, and the only place where both meet."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from registration.scan import FloatArray
from sensors.arm import ArmPath
from sensors.paths import ViewPath

# The six parameters of a pose, as columns of rows end.
PARAMETERS = ("rotation_x_deg", "rotation_y_deg", "rotation_z_deg", "x_mm", "y_mm", "z_mm")


class Tolerance(NamedTuple):
    """A success: both the rotation angle and the translation norm are at most these."""

    rotation_deg: float
    translation_mm: float

    def __str__(self) -> str:
        """As captions and columns have it: "5 deg and 30 mm"."""
        return f"{self.rotation_deg:g} deg and {self.translation_mm:g} mm"

    def holds(self, rotation_deg: Any, translation_mm: Any) -> Any:
        """Whether errors are within it: numbers, or arrays or columns of as many; NaN is not."""
        return (rotation_deg <= self.rotation_deg) & (translation_mm <= self.translation_mm)


COARSE = Tolerance(5.0, 30.0)
FINE = Tolerance(1.0, 5.0)


class PoseError(NamedTuple):
    """The pose that takes the estimate to the truth, as an angle and a length."""

    rotation_rad: float
    translation_mm: float


def exact_pose(target: ViewPath, source: ViewPath) -> RigidTransform:
    """The true T_target_source, in mm, between the frames of the two views' first profiles.

    This is (3-1) of the thesis with the world in the place of the arm's bases.
    """
    return target.T_world_view.inv() * source.T_world_view


def encoder_pose(target: ViewPath, source: ViewPath) -> RigidTransform | None:
    """T_target_source by (3-1) from the arm's encoders and the nominal tool centre point, in mm.

    The thesis's "theoretical" values; off by what the bracket is. None for views without an arm.
    """
    if isinstance(target, ArmPath) and isinstance(source, ArmPath):
        return target.T_world_encoder_view.inv() * source.T_world_encoder_view
    return None


def pose_error(T_exact: RigidTransform, T_estimated: RigidTransform) -> PoseError:
    """Angle of the rotation between two poses and distance between their translations.

    Both poses are T_target_source; the angle is the norm of the rotation vector, so 1e-9 rad reads
    as such.
    """
    turn = T_estimated.rotation * T_exact.rotation.inv()
    shift = np.asarray(T_estimated.translation) - np.asarray(T_exact.translation)
    return PoseError(float(turn.magnitude()), float(np.linalg.norm(shift)))


def is_success(error: PoseError | None, tolerance: Tolerance) -> bool:
    """Whether an estimate exists and is within the tolerance; no estimate is no success."""
    if error is None:
        return False
    return bool(tolerance.holds(np.rad2deg(error.rotation_rad), error.translation_mm))


def six_parameters(T_target_source: RigidTransform) -> FloatArray:
    """(6,) psi, phi, theta in degrees and x, y, z in mm, as the tables of chapter 6 list them.

    Of many poses (n, 6). R = Rz(theta) Ry(phi) Rx(psi), equations (4-6) and (4-7); the angles are
    the corrected (4-15) to (4-17), which SciPy's "ZYX" gives.
    """
    return parameters_of(T_target_source.rotation, T_target_source.translation)


def parameters_of(rotation: Rotation, translation_mm: FloatArray) -> FloatArray:
    """(..., 6) the six parameters of poses that are at hand as rotations and translations."""
    angles_deg = rotation.as_euler("ZYX", degrees=True)[..., ::-1]
    return np.concatenate([angles_deg, translation_mm], axis=-1)


def pose_from_parameters(rotation_deg: FloatArray, translation_mm: FloatArray) -> RigidTransform:
    """The pose whose psi, phi, theta (about X, Y, Z, degrees) and translation (mm) are given.

    The inverse of `six_parameters`, equations (4-6) and (4-7).
    """
    psi, phi, theta = rotation_deg
    rotation = Rotation.from_euler("ZYX", [theta, phi, psi], degrees=True)
    return RigidTransform.from_components(np.asarray(translation_mm, dtype=np.float64), rotation)


def parameter_errors(exact: FloatArray, estimated: FloatArray) -> FloatArray:
    """(..., 6) estimated minus exact, the three angles in degrees wrapped to (-180, 180]."""
    difference = np.asarray(estimated, dtype=np.float64) - np.asarray(exact, dtype=np.float64)
    difference[..., :3] = 180.0 - np.mod(180.0 - difference[..., :3], 360.0)
    return difference
