"""The outcome of one trial, as methods and simulation leave it and the store keeps it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from harness.scoring.poses import COARSE

RowStatus = Literal["ok", "ambiguous", "underdetermined", "failed", "no_overlap", "error"]


@dataclass(frozen=True)
class Row:
    """The outcome of one trial.

    spec: its canonical JSON. T_exact, T_theoretical, T_estimated: T_target_source or None; the
        theoretical one is what the arm's encoders say.
    overlap_target, overlap_source: exact share of either view's points that the other sees.
    bounds: Cramer-Rao bounds (2, 6, 6) of the pose, see harness.scoring.common_points.
    counts: points, segments, patches and so on, by name.
    stage_ms: wall times; all else is the same in every run.
    stage: where the method stopped, as it says; "" where it does not.
    notes: what the method says of its answer, of whatever status.
    """

    id: str
    spec: str
    status: RowStatus
    reason: str = ""
    traceback: str = ""
    T_exact: RigidTransform | None = None
    T_theoretical: RigidTransform | None = None
    T_estimated: RigidTransform | None = None
    rotation_error_deg: float | None = None
    translation_error_mm: float | None = None
    overlap_target: float | None = None
    overlap_source: float | None = None
    bounds: np.ndarray[Any, np.dtype[np.float64]] | None = None
    covariance: np.ndarray[Any, np.dtype[np.float64]] | None = None
    undetermined: np.ndarray[Any, np.dtype[np.float64]] | None = None
    counts: dict[str, int] = field(default_factory=dict)
    stage_ms: dict[str, float] = field(default_factory=dict)
    stage: str = ""
    notes: tuple[str, ...] = ()

    @property
    def right(self) -> bool:
        """Whether it is answered "ok" and within COARSE, as row_scores.within says of many."""
        if self.status != "ok" or self.rotation_error_deg is None:
            return False
        return bool(COARSE.holds(self.rotation_error_deg, self.translation_error_mm))
