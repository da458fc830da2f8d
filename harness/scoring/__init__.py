"""How far estimates are from the truth, and how near they could be."""

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
