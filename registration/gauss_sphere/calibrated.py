"""What was measured of the sensor, put to use: bias out of the depths, points weighted by noise.

Both go with the inclination of the surface, which the plane that a point lies on gives better than
the points around it.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from registration.calibration import Calibration, Table, read_calibration
from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.patches import Patches
from registration.kernels import compiled
from registration.scan import FloatArray

DEPTH_NODES, NODES = 65, 513  # much finer than any calibration's own


class EvenTable(NamedTuple):
    """A table of a calibration on even nodes, as the compiled loops take it.

    depth_mm, at: (2,) first node and nodes per unit, of Z and of the other; value_mm: (d, t).
    """

    depth_mm: FloatArray
    at: FloatArray
    value_mm: FloatArray


class Known(NamedTuple):
    """A calibration: the bias of the depth, and its standard deviation, both in mm.

    lateral: whether the bias goes with the slope of the beam, else with the tangent of the
        incidence, as the standard deviation always does.
    """

    lateral: bool
    bias: EvenTable
    sigma: EvenTable


def known_of(calibration: Calibration) -> Known:
    """The tables of a calibration."""
    return Known(
        calibration.form == "lateral", _even(calibration.bias), _even(calibration.sigma)
    )  # fmt: skip


def _even(table: Table) -> EvenTable:
    depth_mm = np.linspace(table.depth_mm[0], table.depth_mm[-1], DEPTH_NODES)
    at = np.linspace(table.at[0], table.at[-1], NODES)
    return EvenTable(
        np.array([depth_mm[0], 1.0 / (depth_mm[1] - depth_mm[0])]),
        np.array([at[0], 1.0 / (at[1] - at[0])]),
        np.ascontiguousarray(table.value(depth_mm[:, None], at[None, :])),
    )


@lru_cache(maxsize=8)
def _read(path: str, _changed_ns: int) -> Known:
    return known_of(read_calibration(path))


def read_known(path: str) -> Known:
    """Read a calibration file once per version of the file.

    Raises CalibrationError or OSError.
    """
    return _read(path, Path(path).stat().st_mtime_ns)


def corrected(fan: Fan, patches: Patches, known: Known) -> Fan:
    """A fan without the bias, and with the noise that goes with the inclination.

    Both hold for the points on patches; a lateral bias goes from all. The calibration knows the
    noise of its target's material: it is scaled to what the scan shows.
    """
    depth_mm, sigma_mm = fan.depth_mm.copy(), fan.sigma_mm.copy()
    _correct(fan, patches, known, depth_mm, sigma_mm)
    on = patches.label >= 0
    scale = np.median(fan.sigma_mm[on] / sigma_mm[on]) if on.any() else 1.0
    sigma_mm[on] *= scale
    return fan._replace(depth_mm=depth_mm, sigma_mm=sigma_mm)


@compiled
def _correct(
    fan: Fan, patches: Patches, known: Known, depth: FloatArray, sigma: FloatArray
) -> None:
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            if not np.isfinite(depth[p, u]):
                continue
            i, s = patches.label[p, u], fan.slope[p, u]
            z = fan.depth_mm[p, u] + fan.apex_mm[2]
            if known.lateral:
                depth[p, u] -= _value(known.bias, z, s)
            if i >= 0:
                n = patches.normal[i]
                cos = -(n[1] * s + n[2]) / np.sqrt(1.0 + s * s)
                tangent = np.sqrt(max(1.0 - cos * cos, 0.0)) / max(cos, 1e-3)
                sigma[p, u] = _value(known.sigma, z, tangent)
                if not known.lateral:
                    depth[p, u] -= _value(known.bias, z, tangent)


@compiled
def _value(table: EvenTable, depth_mm: float, at: float) -> float:
    """Bilinear between the nodes, constant beyond them."""
    v = table.value_mm
    x = min(max((depth_mm - table.depth_mm[0]) * table.depth_mm[1], 0.0), v.shape[0] - 1.0)
    y = min(max((at - table.at[0]) * table.at[1], 0.0), v.shape[1] - 1.0)
    i, j = min(int(x), v.shape[0] - 2), min(int(y), v.shape[1] - 2)
    x, y = x - i, y - j
    low = v[i, j] * (1.0 - y) + v[i, j + 1] * y
    high = v[i + 1, j] * (1.0 - y) + v[i + 1, j + 1] * y
    return float(low * (1.0 - x) + high * x)
