"""ICP on top of the method gauss_sphere: a method of one's own, for experiments."""

from __future__ import annotations

from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.pipeline import register_scans
from registration.result import RegistrationResult
from registration.scan import Scan
from registration.thesis.icp import refined
from registration.thesis.params import IcpParams

ROUNDS = 30


def gauss_sphere_icp(target: Scan, source: Scan, params: GaussSphereParams) -> RegistrationResult:
    """Register by gauss_sphere, then by points; the covariance is that of gauss_sphere."""
    return refined(register_scans(target, source, params), target, source, IcpParams(ROUNDS))


gauss_sphere_icp.params_type = GaussSphereParams  # type: ignore[attr-defined]  # names its params
