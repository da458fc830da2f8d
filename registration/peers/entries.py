"""The peers by name, and whether what they need is installed; imports none of them."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from time import perf_counter
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from registration.peers.params import (
    FgrParams,
    IcpParams,
    KissMatcherParams,
    RansacParams,
    RefineParams,
)
from registration.result import RegistrationResult
from registration.scan import FloatArray, Scan

# Fewer points than this have no neighbourhoods to take normals from.
LEAST_POINTS = 50

DEBIAN_PACKAGES = {"libusb-1.0": "libusb-1.0-0", "libGL.": "libgl1", "libgomp": "libgomp1"}


class MissingPeerError(RuntimeError):
    """A peer's library cannot be imported; the message says what to install."""


class Peer(NamedTuple):
    """A registration called as function(target, source, params); needs: modules to be imported."""

    function: Callable[[Scan, Scan, Any], RegistrationResult]
    params_type: type
    needs: tuple[str, ...]


def require(module: str) -> ModuleType:
    """Import the library of a peer; raises MissingPeerError with one line."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingPeerError(
            f"{error.name} is not installed; pip install -c constraints.txt -e '.[peers]' adds it"
        ) from None
    except ImportError as error:
        problem = str(error).splitlines()[0]
        found = [package for name, package in DEBIAN_PACKAGES.items() if name in problem]
        way_out = f"; apt-get install {found[0]} adds it on Debian and Ubuntu" if found else ""
        raise MissingPeerError(
            f"{module} is installed but lacks a library of the system: {problem}{way_out}"
        ) from None


def check_installed(name: str, params: Any) -> None:
    """Import all that a peer needs with these parameters; raises MissingPeerError."""
    peer = PEERS[name]
    refine: RefineParams = params.refine
    for module in peer.needs if refine.kind == "none" else (*peer.needs, "small_gicp"):
        require(module)
    start = getattr(params, "start", "identity")
    if start in PEERS:
        check_installed(start, PEERS[start].params_type())


def open3d_ransac(target: Scan, source: Scan, params: RansacParams) -> RegistrationResult:
    """Open3D: FPFH and RANSAC."""
    from registration.peers import open3d_global

    return _registered(open3d_global.ransac, target, source, params)


def open3d_fgr(target: Scan, source: Scan, params: FgrParams) -> RegistrationResult:
    """Open3D: FPFH and fast global registration."""
    from registration.peers import open3d_global

    return _registered(open3d_global.fast_global, target, source, params)


def kiss_matcher(target: Scan, source: Scan, params: KissMatcherParams) -> RegistrationResult:
    """KISS-Matcher: FasterPFH, k-core pruning and graduated non-convexity."""
    from registration.peers import kiss

    return _registered(kiss.match, target, source, params)


def icp(target: Scan, source: Scan, params: IcpParams) -> RegistrationResult:
    """small_gicp from the identity, or from another method's answer."""
    return _registered(_starting_pose, target, source, params)


def _starting_pose(
    target: Scan, source: Scan, params: IcpParams
) -> tuple[RigidTransform | None, str, dict[str, float]]:
    if params.start == "identity":
        return RigidTransform.identity(), "", {}
    from registration.methods import register

    result = register(target, source, params.start)
    reason = f"{params.start} gave no start: {result.reason}"
    return result.T_target_source, reason, {params.start: sum(result.stage_ms.values())}


def _registered(
    find: Callable[[Scan, Scan, Any], tuple[RigidTransform | None, str, dict[str, float]]],
    target: Scan,
    source: Scan,
    params: Any,
) -> RegistrationResult:
    """Run a global registration and what refines it; these libraries know no doubt of their own.

    "ok" therefore means no more than that the library calls its result valid.
    """
    for name, scan in (("target", target), ("source", source)):
        if scan.n_valid < LEAST_POINTS:
            return RegistrationResult(
                None,
                "failed",
                f"the {name} scan has {scan.n_valid} measured points; {LEAST_POINTS} are needed",
                stage="scan",
            )
    pose, reason, stage_ms = find(target, source, params)
    if pose is None:
        return RegistrationResult(None, "failed", reason, stage_ms=stage_ms)
    if params.refine.kind != "none":
        from registration.peers import small_gicp_refine

        started = perf_counter()
        pose, reason = small_gicp_refine.refined(
            target, source, pose, params.refine, params.threads
        )
        stage_ms[params.refine.kind] = 1e3 * (perf_counter() - started)
        if pose is None:
            return RegistrationResult(None, "failed", reason, stage_ms=stage_ms, stage="refinement")
    return RegistrationResult(pose, "ok", stage_ms=stage_ms)


def measured_mm(scan: Scan) -> FloatArray:
    """(n, 3) the measured points of a scan."""
    return np.ascontiguousarray(scan.points_mm[scan.valid])


PEERS: dict[str, Peer] = {
    "open3d_ransac": Peer(open3d_ransac, RansacParams, ("open3d",)),
    "open3d_fgr": Peer(open3d_fgr, FgrParams, ("open3d",)),
    "kiss_matcher": Peer(kiss_matcher, KissMatcherParams, ("kiss_matcher",)),
    "icp": Peer(icp, IcpParams, ("small_gicp",)),
}
