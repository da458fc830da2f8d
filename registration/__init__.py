"""Registration of laser profile scans by their planes, usable alone on real data."""

from registration.gauss_sphere.params import GaussSphereParams
from registration.methods import METHODS, register
from registration.result import RegistrationResult
from registration.scan import Scan, ScanError

__all__ = [
    "METHODS",
    "GaussSphereParams",
    "RegistrationResult",
    "Scan",
    "ScanError",
    "register",
]
