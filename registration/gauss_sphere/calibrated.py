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
from registration.kernels import compiled
from registration.scan import FloatArray

DEPTH_NODES, NODES = 65, 513  # much finer than any calibration's own

# Rows of the beams of one plane, as the compiled loops take them: position of the profile, slope,
# depth and its standard deviation as corrected, and the depth that was measured.
X, SLOPE, DEPTH, SIGMA, MEASURED = range(5)


class EvenTable(NamedTuple):
    """Tables of a calibration on common even nodes, as the compiled loops take them.

    first, per_unit: (2,) first node and nodes per unit, of Z in mm and of the other coordinate.
    value_mm: (d, t, k) of k tables.
    """

    first: FloatArray
    per_unit: FloatArray
    value_mm: FloatArray


class Known(NamedTuple):
    """A calibration: the bias of the depth, and its standard deviation, both in mm.

    given: False where there is none. lateral: whether the bias goes with the slope of the beam,
        else with the tangent of the incidence, as the standard deviation always does.
    by_tangent: the standard deviation, and the bias unless it is lateral; by_slope: the bias if so.
    sigma_scale: noise of the scan over that of the calibration's target.
    known_to_mm: how well the bias is known: planes are trusted no better.
    """

    given: bool
    lateral: bool
    by_tangent: EvenTable
    by_slope: EvenTable
    sigma_scale: float
    known_to_mm: float


def known_of(calibration: Calibration) -> Known:
    """The tables of a calibration."""
    bias, sigma = calibration.bias, calibration.sigma
    lateral = calibration.form == "lateral"
    by_tangent = _even(sigma, sigma) if lateral else _even(sigma, bias)
    by_slope = _even(bias, bias) if lateral else _NO_TABLE
    return Known(True, lateral, by_tangent, by_slope, 1.0, calibration.known_to_mm)


def _even(*tables: Table) -> EvenTable:
    low_mm = min(table.depth_mm[0] for table in tables)
    depth_mm = np.linspace(low_mm, max(table.depth_mm[-1] for table in tables), DEPTH_NODES)
    low = min(table.at[0] for table in tables)
    at = np.linspace(low, max(table.at[-1] for table in tables), NODES)
    values = [table.value(depth_mm[:, None], at[None, :]) for table in tables]
    return EvenTable(
        np.array([low_mm, low]),
        np.array([1.0 / (depth_mm[1] - depth_mm[0]), 1.0 / (at[1] - at[0])]),
        np.ascontiguousarray(np.stack(values, axis=2)),
    )


_NO_TABLE = EvenTable(np.zeros(2), np.ones(2), np.zeros((2, 2, 2)))
NOTHING_KNOWN = Known(False, False, _NO_TABLE, _NO_TABLE, 1.0, 0.0)


@lru_cache(maxsize=8)
def _read(path: str, _changed_ns: int) -> Known:
    return known_of(read_calibration(path))


def read_known(path: str) -> Known:
    """Read a calibration file once per version of the file; nothing is known where path is empty.

    Raises CalibrationError or OSError.
    """
    return _read(path, Path(path).stat().st_mtime_ns) if path else NOTHING_KNOWN


@compiled
def take_bias(beams: FloatArray, plane: FloatArray, apex_z_mm: float, known: Known) -> None:
    """Correct the depths of the beams (5, n) of one plane, and their standard deviations."""
    n = beams.shape[1]
    n1, n2 = plane[1], plane[2]
    tangent, value = np.empty(n), np.empty((2, n))
    for j in range(n):
        s = beams[SLOPE, j]
        along = -(n1 * s + n2)
        across2 = 1.0 + s * s - along * along
        size = np.sqrt(across2 if across2 > 0.0 else 0.0)
        tangent[j] = size / (along if along > 1e-3 else 1e-3)
    look_up(known.by_tangent, beams[MEASURED], apex_z_mm, tangent, value)
    for j in range(n):
        beams[SIGMA, j] = known.sigma_scale * value[0, j]
    if known.lateral:
        look_up(known.by_slope, beams[MEASURED], apex_z_mm, beams[SLOPE], value)
    for j in range(n):
        beams[DEPTH, j] = beams[MEASURED, j] - value[1, j]


@compiled
def take_lateral_bias(
    depth_mm: FloatArray, slope: FloatArray, apex_z_mm: float, known: Known
) -> None:
    """Correct depths (n,) in place by what can be told without the surface's inclination."""
    value = np.empty((2, depth_mm.size))
    look_up(known.by_slope, depth_mm, apex_z_mm, slope, value)
    for j in range(depth_mm.size):
        depth_mm[j] -= value[1, j]


@compiled
def look_up(
    table: EvenTable, depth: FloatArray, apex_z: float, at: FloatArray, value: FloatArray
) -> None:
    """Both tables at all points, (2, n) out: bilinear between the nodes, constant beyond them."""
    # First where, then what: the first loop runs on vectors of points.
    nodes = table.value_mm.shape[1]
    flat = table.value_mm.reshape(-1, 2)
    low, high_x, high_y = apex_z - table.first[0], table.value_mm.shape[0] - 1.0, nodes - 1.0
    n, scale_x, scale_y, first = depth.size, table.per_unit[0], table.per_unit[1], table.first[1]
    xs, ys, place = np.empty(n), np.empty(n), np.empty(n, np.int64)
    for j in range(n):
        x, y = (depth[j] + low) * scale_x, (at[j] - first) * scale_y
        x = x if x > 0.0 else 0.0
        y = y if y > 0.0 else 0.0
        x = x if x < high_x else high_x
        y = y if y < high_y else high_y
        i, k = np.int64(x), np.int64(y)
        i = i if x < high_x else i - 1
        k = k if y < high_y else k - 1
        xs[j], ys[j], place[j] = x - i, y - k, i * nodes + k
    for j in range(n):
        x, y, i = xs[j], ys[j], place[j]
        a, b, c, d = (1.0 - x) * (1.0 - y), (1.0 - x) * y, x * (1.0 - y), x * y
        k = i + nodes
        value[0, j] = a * flat[i, 0] + b * flat[i + 1, 0] + c * flat[k, 0] + d * flat[k + 1, 0]
        value[1, j] = a * flat[i, 1] + b * flat[i + 1, 1] + c * flat[k, 1] + d * flat[k + 1, 1]
