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


class Bias(NamedTuple):
    """A calibration's bias as the compiled loops take it.

    lateral: whether it goes with the slope of the beam, else with the tangent of the incidence.
    depth_mm: (d,) nodes of Z; at: (t,) nodes of the other; value_mm: (d, t).
    """

    lateral: bool
    depth_mm: FloatArray
    at: FloatArray
    value_mm: FloatArray


def bias_of(calibration: Calibration) -> Bias:
    """The bias of a calibration."""
    table = calibration.bias
    return Bias(
        calibration.form == "lateral",
        np.ascontiguousarray(table.depth_mm, dtype=np.float64),
        np.ascontiguousarray(table.at, dtype=np.float64),
        np.ascontiguousarray(table.value_mm, dtype=np.float64),
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
    row, row_share = _cell(bias.depth_mm, depth_mm)
    column, share = _cell(bias.at, at)
    v = bias.value_mm
    low = v[row, column] * (1.0 - share) + v[row, column + 1] * share
    high = v[row + 1, column] * (1.0 - share) + v[row + 1, column + 1] * share
    return float(low * (1.0 - row_share) + high * row_share)


@compiled
def _cell(nodes: FloatArray, value: float) -> tuple[int, float]:
    inside = min(max(value, nodes[0]), nodes[-1])
    i = 0
    while i < nodes.size - 2 and nodes[i + 1] < inside:
        i += 1
    return i, (inside - nodes[i]) / (nodes[i + 1] - nodes[i])
