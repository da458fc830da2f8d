"""The methods by name, and the one function that runs any of them."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, NamedTuple

from registration.gauss_sphere import pipeline as gauss_sphere
from registration.gauss_sphere.params import GaussSphereParams
from registration.peers import PEERS
from registration.planar import pipeline as planar
from registration.planar.params import PlanarParams
from registration.result import RegistrationResult
from registration.scan import Scan
from registration.thesis import pipeline as thesis
from registration.thesis.params import ThesisParams

MethodFunction = Callable[[Scan, Scan, Any], RegistrationResult]


class Method(NamedTuple):
    """A registration: called as function(target, source, params), params of type params_type."""

    function: MethodFunction
    params_type: type


class UnknownMethodError(ValueError):
    """No method of that name; the message lists those there are."""


METHODS: dict[str, Method] = {
    "gauss_sphere": Method(gauss_sphere.register_scans, GaussSphereParams),
    "thesis": Method(thesis.register_scans, ThesisParams),
    # Other libraries, imported when first called: MissingPeerError says what to install.
    **{name: Method(peer.function, peer.params_type) for name, peer in PEERS.items()},
}

# They take one profile of each view and find the pose in the laser plane.
PROFILE_METHODS: dict[str, Method] = {
    "planar": Method(planar.register_profiles, PlanarParams),
}


def find_method(name: str) -> Method:
    """Look a method up by its name in METHODS or PROFILE_METHODS, or by "package.module:function".

    A function of one's own is called as function(target, source, params); an attribute
    `params_type` of it, a dataclass, is taken as the type of its parameters, else `dict`.
    Raises UnknownMethodError.
    """
    known = METHODS | PROFILE_METHODS
    if name in known:
        return known[name]
    module_name, colon, function_name = str(name).partition(":")
    if not colon:
        raise UnknownMethodError(
            f"unknown method {name!r}; known are {', '.join(known)}, or a function of your own "
            'as "package.module:function"'
        )
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except Exception as error:  # whatever a module of the user's raises
        raise UnknownMethodError(f"method {name!r} cannot be loaded: {error}") from error
    if not callable(function):
        kind = type(function).__name__
        raise UnknownMethodError(f"method {name!r} is of type {kind}; expected a function")
    return Method(function, getattr(function, "params_type", dict))


def register(
    target: Scan, source: Scan, method: str = "gauss_sphere", params: Any = None
) -> RegistrationResult:
    """Find the pose of the source scan in the target's frame, without an initial guess.

    params: an instance of the method's params_type; its defaults when None.
    A pair that cannot be registered comes back with status and reason; only a method that is
    unknown or misconfigured raises: UnknownMethodError, TypeError for params of another type or
    arrays in place of scans and for a function of one's own that returns something else,
    CalibrationError or OSError for a calibration that cannot be read, MissingPeerError where a
    peer's library is not installed.
    """
    chosen = find_method(method)
    for name, scan in (("target", target), ("source", source)):
        if not isinstance(scan, Scan):
            raise TypeError(
                f"{name} is of type {type(scan).__name__}; expected Scan, as Scan.from_points makes"
            )
    if params is None:
        params = chosen.params_type()
    if ":" not in method and not isinstance(params, chosen.params_type):
        kind = chosen.params_type
        raise TypeError(
            f"params of method {method!r} are of type {type(params).__name__}; expected "
            f"{kind.__name__} of {kind.__module__}"
        )
    result = chosen.function(target, source, params)
    if not isinstance(result, RegistrationResult):
        kind = type(result).__name__
        raise TypeError(f"method {method!r} returned {kind}; expected RegistrationResult")
    return result
