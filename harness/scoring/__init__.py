"""How far an estimate is from the truth."""

from harness.scoring.poses import (
    PoseError,
    Tolerance,
    exact_pose,
    is_success,
    parameter_errors,
    pose_error,
    six_parameters,
)

__all__ = [
    "PoseError",
    "Tolerance",
    "exact_pose",
    "is_success",
    "parameter_errors",
    "pose_error",
    "six_parameters",
]
