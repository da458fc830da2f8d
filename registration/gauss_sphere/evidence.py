"""What the method saw, for figures and diagnosis."""

from __future__ import annotations

from dataclasses import dataclass

from registration.gauss_sphere.verification import View
from registration.scan import FloatArray, IntArray


@dataclass(frozen=True)
class PlaneEvidence:
    """Both views with their planes, and the planes that the best pose lays on each other.

    pairs: (m, 2) target and source patch; distance2: (m,) squared Mahalanobis distance of each
    under the pose, three degrees of freedom. Empty where no pose was found.
    """

    target: View
    source: View
    pairs: IntArray
    distance2: FloatArray
