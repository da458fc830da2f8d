"""What a registration answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from registration.scan import FloatArray

Status = Literal["ok", "ambiguous", "underdetermined", "failed"]
STAGES = (
    "scan", "segments", "patches", "rotation", "translation", "verification", "scene", "decision",
    "refinement",
)  # fmt: skip


@dataclass(frozen=True)
class Candidate:
    """One pose that was considered, with the score that ranked it (higher is better)."""

    T_target_source: RigidTransform
    score: float


@dataclass(frozen=True)
class RegistrationResult:
    """The estimate, how it went, and how sure it is.

    T_target_source: p_target = T p_source in mm, or None when none could be decided; never an
        identity in place of a failure.
    status, reason: "ok" has an empty reason, every other status says why.
    stage: where the method stopped believing when the status is not "ok", as "patches"; "" where it
        does not say. Methods of this package use STAGES.
    covariance: (6, 6) of (rotation vector rad, translation mm), a perturbation applied on the left
        of T_target_source (in the target frame), or None when the method does not estimate it.
    undetermined: (k, 6) directions of the same coordinates that the scans leave open, of length 1
        in rad and mm together: they are about the target's origin, so an open turn about a far axis
        is mostly mm. The reason says of each what it is, about the middle of the matched surface.
        Empty if only the source's planes leave them open: without a pose nothing of its frame is
        known in the target's.
    candidates: runners-up, best first; where no pose is given, the refused best one comes first.
    stage_ms: wall time of each stage.
    evidence: intermediate results by name, for figures and diagnosis; never needed for the answer.
    notes: what a user should know of an answer of any status, "ok" too, a line each: as that no
        calibration was given, and what that does to the accuracy. Empty where there is nothing.
    """

    T_target_source: RigidTransform | None
    status: Status
    reason: str = ""
    covariance: FloatArray | None = None
    undetermined: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    candidates: tuple[Candidate, ...] = ()
    stage_ms: dict[str, float] = field(default_factory=dict)
    evidence: dict[str, Any] = field(default_factory=dict)
    stage: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.status == "ok" and self.T_target_source is None:
            raise ValueError("status 'ok' needs a T_target_source")
        if self.status != "ok" and not self.reason:
            raise ValueError(f"status {self.status!r} needs a reason")
