"""The sensor's measured bias, taken out of the depths by the inclination of each point's plane."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from registration.calibration import Calibration, read_calibration
from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.patches import Patches
from registration.kernels import compiled
from registration.scan import FloatArray

DEPTH_NODES, NODES = 65, 513  # much finer than any calibration's own


class Bias(NamedTuple):
    """A calibration's bias as the compiled loops take it, on even nodes.

    lateral: whether it goes with the slope of the beam, else with the tangent of the incidence.
    depth_mm, at: (2,) first node and nodes per unit, of Z and of the other; value_mm: (d, t).
    """

    lateral: bool
    depth_mm: FloatArray
    at: FloatArray
    value_mm: FloatArray


def bias_of(calibration: Calibration) -> Bias:
    """The bias of a calibration."""
    table = calibration.bias
    depth_mm = np.linspace(table.depth_mm[0], table.depth_mm[-1], DEPTH_NODES)
    at = np.linspace(table.at[0], table.at[-1], NODES)
    return Bias(
        calibration.form == "lateral",
        np.array([depth_mm[0], 1.0 / (depth_mm[1] - depth_mm[0])]),
        np.array([at[0], 1.0 / (at[1] - at[0])]),
        np.ascontiguousarray(table.value(depth_mm[:, None], at[None, :])),
    )


@lru_cache(maxsize=8)
def _read(path: str, _changed_ns: int) -> Bias:
    return bias_of(read_calibration(path))


def read_bias(path: str) -> Bias:
    """Read the bias of a calibration file once per version of the file.

    Raises CalibrationError or OSError.
    """
    return _read(path, Path(path).stat().st_mtime_ns)


def corrected(fan: Fan, patches: Patches, bias: Bias) -> Fan:
    """A fan without the bias: of all points where it is lateral, else of those on patches.

    Where the bias goes with the incidence, a point's is taken from the plane that it lies on; local
    slopes would be as noisy as the points.
    """
    depth_mm = fan.depth_mm.copy()
    _correct(fan, patches, bias, depth_mm)
    return fan._replace(depth_mm=depth_mm)


@compiled
def _correct(fan: Fan, patches: Patches, bias: Bias, depth: FloatArray) -> None:
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            i, s = patches.label[p, u], fan.slope[p, u]
            if bias.lateral:
                at = s
            elif i >= 0:
                n = patches.normal[i]
                size = np.sqrt(1.0 + s * s)
                cos = -(n[1] * s + n[2]) / size
                at = np.sqrt(max(1.0 - cos * cos, 0.0)) / max(cos, 1e-3)
            else:
                continue
            if np.isfinite(depth[p, u]):
                depth[p, u] -= _value(bias, fan.depth_mm[p, u] + fan.apex_mm[2], at)


@compiled
def _value(bias: Bias, depth_mm: float, at: float) -> float:
    """Bilinear between the nodes, constant beyond them."""
    v = bias.value_mm
    x = min(max((depth_mm - bias.depth_mm[0]) * bias.depth_mm[1], 0.0), v.shape[0] - 1.0)
    y = min(max((at - bias.at[0]) * bias.at[1], 0.0), v.shape[1] - 1.0)
    i, j = min(int(x), v.shape[0] - 2), min(int(y), v.shape[1] - 2)
    x, y = x - i, y - j
    low = v[i, j] * (1.0 - y) + v[i, j + 1] * y
    high = v[i + 1, j] * (1.0 - y) + v[i + 1, j + 1] * y
    return float(low * (1.0 - x) + high * x)
