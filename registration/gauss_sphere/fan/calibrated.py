"""What was measured of the sensor, put to use: bias out of the depths, points weighted by noise.

Both go with the inclination of the surface, which the plane that a point lies on gives better than
the points around it.
"""

from __future__ import annotations

import math
import os
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from registration.calibration import Calibration, Table, read_calibration
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

DEPTH_NODES, NODES = 65, 513  # much finer than any calibration's own

BLOCK = 512  # beams of a plane that are worked on at a time: they stay in the nearest memory

# Rows of the beams of one plane, as the compiled loops take them: position of the profile, slope,
# depth and its standard deviation as corrected, and the depth that was measured.
X, SLOPE, DEPTH, SIGMA, MEASURED = range(5)


class EvenTable(NamedTuple):
    """A table of a calibration on even nodes, as the compiled loops take it.

    first, per_unit: (2,) first node and nodes per unit, of Z in mm and of the other coordinate.
    value_mm: (d, t).
    """

    first: FloatArray
    per_unit: FloatArray
    value_mm: FloatArray


class Known(NamedTuple):
    """A calibration: the bias of the depth, and its standard deviation, both in mm.

    given: False where there is none. lateral: whether the bias goes with the slope of the beam,
        else with the tangent of the incidence, as the standard deviation always does: without
        lateral, both tables have the same nodes.
    known_to_mm: how well the bias is known: planes are trusted no better.
    apex_mm: (3,) where the beams of a profile meet; NaN without a calibration.
    """

    given: bool
    lateral: bool
    bias: EvenTable
    sigma: EvenTable
    known_to_mm: float
    apex_mm: FloatArray


def known_of(calibration: Calibration) -> Known:
    """The tables of a calibration."""
    bias, sigma = calibration.bias, calibration.sigma
    lateral = calibration.form == "lateral"
    tables = (
        (_even(bias, bias), _even(sigma, sigma))
        if lateral
        else (_even(bias, bias, sigma), _even(sigma, bias, sigma))
    )
    apex_mm = np.array(calibration.apex_mm, dtype=np.float64)
    return Known(True, lateral, *tables, calibration.known_to_mm, apex_mm)


def _even(table: Table, *reaching: Table) -> EvenTable:
    """A table on even nodes that reach as far as all of the given ones, close enough for each."""
    depth_mm = _even_nodes([each.depth_mm for each in reaching], DEPTH_NODES)
    at = _even_nodes([each.at for each in reaching], NODES)
    return EvenTable(
        np.array([depth_mm[0], at[0]]),
        np.array([1.0 / (depth_mm[1] - depth_mm[0]), 1.0 / (at[1] - at[0])]),
        np.ascontiguousarray(table.value(depth_mm[:, None], at[None, :])),
    )


def _even_nodes(nodes: list[FloatArray], least: int) -> FloatArray:
    """Nodes that reach as far as all of the given ones, and least of them over the shortest."""
    first, last = min(each[0] for each in nodes), max(each[-1] for each in nodes)
    shortest = min(each[-1] - each[0] for each in nodes)
    return np.linspace(first, last, math.ceil((least - 1) * (last - first) / shortest) + 1)


_NO_TABLE = EvenTable(np.zeros(2), np.ones(2), np.zeros((2, 2)))
NOTHING_KNOWN = Known(False, False, _NO_TABLE, _NO_TABLE, 0.0, np.full(3, np.nan))


@lru_cache(maxsize=8)
def _read(path: str, _file: tuple[int, int, int]) -> Known:
    return known_of(read_calibration(path))


def read_known(path: str) -> Known:
    """Read a calibration file once per version of the file; nothing is known where path is empty.

    Raises CalibrationError or OSError.
    """
    if not path:
        return NOTHING_KNOWN
    file = os.stat(path)  # a path may lead to another one, from another directory
    return _read(path, (file.st_dev, file.st_ino, file.st_mtime_ns))


@compiled
def bias_and_noise(
    slope: FloatArray,
    measured: FloatArray,
    plane: FloatArray,
    apex_z_mm: float,
    known: Known,
    bias: FloatArray,
    sigma: FloatArray,
) -> None:
    """Bias of the depths of the beams (n,) of one plane, and their standard deviations, (n,) out.

    measured: (n,) depths from the apex.
    """
    tangent = _tangents(slope, plane)
    there = _places(known.sigma, measured, apex_z_mm, tangent)
    _read_at(known.sigma, there, sigma)
    if known.lateral:
        there = _places(known.bias, measured, apex_z_mm, slope)
    _read_at(known.bias, there, bias)  # without lateral both tables have the same nodes


@compiled
def take_bias(beams: FloatArray, plane: FloatArray, apex_z_mm: float, known: Known) -> None:
    """Correct the depths of the beams (5, n) of one plane."""
    for first in range(0, beams.shape[1], BLOCK):
        depth, slope = beams[DEPTH, first : first + BLOCK], beams[SLOPE, first : first + BLOCK]
        measured = beams[MEASURED, first : first + BLOCK]
        at = slope if known.lateral else _tangents(slope, plane)
        look_up(known.bias, measured, apex_z_mm, at, depth)
        for j in range(depth.size):
            depth[j] = measured[j] - depth[j]


@compiled
def take_lateral_bias(
    depth_mm: FloatArray, slope: FloatArray, apex_z_mm: float, known: Known
) -> None:
    """Correct depths (n,) in place by what can be told without the surface's inclination."""
    value = np.empty(depth_mm.size)
    look_up(known.bias, depth_mm, apex_z_mm, slope, value)
    for j in range(depth_mm.size):
        depth_mm[j] -= value[j]


@compiled
def _tangents(slope: FloatArray, plane: FloatArray) -> FloatArray:
    tangent = np.empty(slope.size)
    for j in range(slope.size):
        tangent[j] = tangent_of(slope[j], plane)
    return tangent


@compiled
def tangent_of(slope: float, plane: FloatArray) -> float:
    """Tangent of the angle between a beam and the normal of a plane."""
    along = -(plane[1] * slope + plane[2])
    across2 = 1.0 + slope * slope - along * along
    size = np.sqrt(across2 if across2 > 0.0 else 0.0)
    return float(size / (along if along > 1e-3 else 1e-3))


class _Places(NamedTuple):
    """Where points (n,) fall among the nodes of a table: the node before, and how far beyond."""

    node: IntArray
    past_x: FloatArray
    past_y: FloatArray


@compiled
def look_up(
    table: EvenTable, depth: FloatArray, apex_z: float, at: FloatArray, value: FloatArray
) -> None:
    """The table at all points, (n,) out: bilinear between the nodes, constant beyond them."""
    _read_at(table, _places(table, depth, apex_z, at), value)


@compiled
def _places(table: EvenTable, depth: FloatArray, apex_z: float, at: FloatArray) -> _Places:
    # Apart from the values, because this runs on vectors of points, if whole numbers stay floats,
    # and become integers of 32 bits, which a vector of floats can be made.
    nodes = float(table.value_mm.shape[1])
    low, high_x, high_y = apex_z - table.first[0], table.value_mm.shape[0] - 1.0, nodes - 1.0
    last_x, last_y = high_x - 1.0, high_y - 1.0
    n, scale_x, scale_y, first = depth.size, table.per_unit[0], table.per_unit[1], table.first[1]
    xs, ys, node = np.empty(n), np.empty(n), np.empty(n, np.int64)
    for j in range(n):
        x, y = (depth[j] + low) * scale_x, (at[j] - first) * scale_y
        x = x if x > 0.0 else 0.0
        y = y if y > 0.0 else 0.0
        x = x if x < high_x else high_x
        y = y if y < high_y else high_y
        i, k = np.floor(x), np.floor(y)
        i = i if i < last_x else last_x
        k = k if k < last_y else last_y
        xs[j], ys[j], node[j] = x - i, y - k, np.int32(i * nodes + k)
    return _Places(node, xs, ys)


@compiled
def _read_at(table: EvenTable, there: _Places, value: FloatArray) -> None:
    nodes, here = table.value_mm.shape[1], table.value_mm.reshape(-1)
    right, below, beyond = here[1:], here[nodes:], here[nodes + 1 :]
    node, xs, ys = there.node, there.past_x, there.past_y
    for j in range(value.size):
        x, y, i = xs[j], ys[j], np.uint64(node[j])  # with a sign, each would be tested for it
        near = here[i] + y * (right[i] - here[i])
        far = below[i] + y * (beyond[i] - below[i])
        value[j] = near + x * (far - near)
