"""Compile every kernel once, so that no later run waits for it: `python -m registration.warm`."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from registration.calibration import Calibration, Table
from registration.gauss_sphere.params import GaussSphereParams
from registration.methods import METHODS, PROFILE_METHODS, register
from registration.peers import PEERS
from registration.scan import Scan
from registration.thesis.params import IcpParams, RotationParams, ThesisParams
from registration.thesis.view_params import PatchParams, SegmentParams


def corner_scan(profiles: int = 24, pixels: int = 64) -> Scan:
    """Two roofs, one behind the other, as a small scan on which every stage has something to do."""
    x, y = np.meshgrid(np.arange(profiles) * 5.0, np.linspace(-120.0, 120.0, pixels), indexing="ij")
    beside = np.abs(y - 10.0)
    z = 600.0 + np.where(x > 60.0, 0.9 * beside + 0.4 * (x - 60.0), 0.3 * beside)
    return Scan.from_points(np.stack([x, y, z], axis=2), step_mm=5.0)


def sliding_scan(profiles: int = 40, pixels: int = 96) -> Scan:
    """Floor and wall, which leave one shift open, and things before them whose outlines fix it."""
    x, y = np.meshgrid(np.arange(profiles) * 5.0, np.linspace(-150.0, 150.0, pixels), indexing="ij")
    z = 900.0 - np.where(x > 100.0, 1.5 * (x - 100.0), 0.0)
    z = np.where((abs(y - 40.0) < 30.0) & (abs(x - 50.0) < 30.0), 850.0, z)
    z = np.where((abs(y + 60.0) < 25.0) & (abs(x - 60.0) < 25.0), 830.0, z)
    return Scan.from_points(np.stack([x, y * z / 900.0, z], axis=2), step_mm=5.0)


def box_scan(profiles: int = 32, pixels: int = 64) -> Scan:
    """A box on a floor, which turned half around fits nearly as well."""
    x, y = np.meshgrid(
        5.0 * np.arange(profiles) - 80.0, np.linspace(-120.0, 120.0, pixels), indexing="ij"
    )
    axes = Rotation.from_euler("xy", [30.0, 20.0], degrees=True).as_matrix()  # of the box, columns
    beam, start = axes[2], np.stack([x, y, np.zeros_like(x)], axis=2) @ axes
    reach = np.sign(beam) * [70.0, 50.0, 40.0]
    enters, leaves = (-reach - start) / beam, (reach - start) / beam
    on_box = enters.max(axis=2) < leaves.min(axis=2)
    z = 600.0 + np.where(on_box, enters.max(axis=2), leaves[..., 2])
    return Scan.from_points(np.stack([x, y, z], axis=2), step_mm=5.0)


def no_bias() -> Calibration:
    """A calibration that changes nothing, so that what takes a bias out has something to do."""
    nodes = np.array([0.0, 1500.0])
    nothing = Table(nodes, np.array([0.0, 3.0]), np.zeros((2, 2)))
    sigma = Table(nodes, np.array([0.0, 3.0]), np.ones((2, 2)))
    return Calibration("incidence", np.zeros(3), nothing, sigma)


if __name__ == "__main__":
    for name in METHODS.keys() - PEERS.keys():
        register(corner_scan(), corner_scan(), method=name)
    for scan in (sliding_scan(), box_scan()):
        register(scan, scan, method="gauss_sphere")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.json"
        no_bias().write(path)
        calibrated = GaussSphereParams(calibration=str(path))
        register(corner_scan(), corner_scan(), method="gauss_sphere", params=calibrated)
    proposals = ThesisParams(
        segments=SegmentParams(order="longest_first"),
        patches=PatchParams(shape="irregular", transitions=True),
        rotation=RotationParams(distance_tolerance_mm=40.0),
        icp=IcpParams(rounds=1),
    )
    register(corner_scan(), corner_scan(), method="thesis", params=proposals)
    for name in PROFILE_METHODS:
        register(corner_scan(profiles=1), corner_scan(profiles=1), method=name)
