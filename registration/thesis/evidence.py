"""What the stages made of one view."""

from __future__ import annotations

from dataclasses import dataclass

from registration.scan import Scan
from registration.thesis.gauss_sphere import GaussSphere
from registration.thesis.patches import Patches
from registration.thesis.segments import Segments


@dataclass(frozen=True)
class ViewEvidence:
    """Intermediate results of one view; None for the stages that were skipped."""

    scan_filtered: Scan | None
    segments: Segments | None
    patches: Patches
    sphere: GaussSphere
