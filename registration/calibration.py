"""What a user measured about a sensor on a flat target: bias and noise, and how to use them.

The file knows nothing but measurements (registration.calibration_fit makes it). A bias of this kind
bends every plane, and is what limits methods that trust points (section 3.2.3.2).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from registration.local_planes import local_planes
from registration.scan import FloatArray, IntArray, Scan

FORMAT, VERSION = "profile scanner calibration", 1
KNOWN_TO_MM = 0.1
WIDEST = 20.0  # both tables together over one, as methods read both on the same even nodes
PASSES = 8  # a biased surface is inclined by its bias: find the inclination that explains both


class CalibrationError(ValueError):
    """A file is no calibration; the message says which key, and what is expected."""


def cell(nodes: FloatArray, value: FloatArray) -> tuple[IntArray, FloatArray]:
    """Index of the node before each value, and the share of the way to the next, within 0 and 1."""
    inside = np.clip(value, nodes[0], nodes[-1])
    before = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, len(nodes) - 2)
    share: FloatArray = (inside - nodes[before]) / (nodes[before + 1] - nodes[before])
    return before, share


@dataclass(frozen=True)
class Table:
    """Values in mm over depth and a second coordinate, bilinear between nodes, constant beyond.

    depth_mm: (d,) ascending; at: (t,) ascending; value_mm: (d, t).
    """

    depth_mm: FloatArray
    at: FloatArray
    value_mm: FloatArray

    def value(self, depth_mm: ArrayLike, at: ArrayLike) -> FloatArray:
        """Interpolate at arrays that broadcast against each other; NaN in, NaN out."""
        row, row_share = cell(self.depth_mm, np.asarray(depth_mm, dtype=float))
        column, column_share = cell(self.at, np.asarray(at, dtype=float))
        low = self.value_mm[row, column] * (1.0 - column_share)
        low = low + self.value_mm[row, column + 1] * column_share
        high = self.value_mm[row + 1, column] * (1.0 - column_share)
        high = high + self.value_mm[row + 1, column + 1] * column_share
        value: FloatArray = low * (1.0 - row_share) + high * row_share
        return value


@dataclass(frozen=True)
class Calibration:
    """Bias and noise of the depth Z of one sensor, as a flat target showed them.

    form: whether the bias was found to go with the incidence of the beam on the surface, or with
        the lateral position in the field. On a target parallel to Y the two look the same.
    apex_mm: (3,) where the beams of a profile meet, in the frame of that profile; also that of
        scans that do not carry it and are too flat to tell.
    bias: measured minus true depth, over the measured depth and the tangent of the incidence
        (form "incidence") or the slope of the beam, Y over depth from the apex ("lateral").
    sigma: standard deviation of the depth over depth and tangent of the incidence, of the target's
        material.
    measured_by: how the file was made, for people.
    rms_mm: what each form left of the bias, and what there was without one.
    known_to_mm: how well the bias is known, as a standard deviation: what the noise and the bench,
        which does not know exactly where its targets stand, leave open (of a file that does not
        say: 0.1).
    """

    form: Literal["incidence", "lateral"]
    apex_mm: FloatArray
    bias: Table
    sigma: Table
    measured_by: str = ""
    rms_mm: dict[str, float] = field(default_factory=dict)
    known_to_mm: float = KNOWN_TO_MM

    def bias_mm(
        self, depth_mm: ArrayLike, slope: ArrayLike, cos_incidence: ArrayLike
    ) -> FloatArray:
        """Bias of the depth: subtract it from a measured Z, moving the point along its beam.

        depth_mm: measured Z; slope: of the beam, Y over depth from the apex; cos_incidence: between
        beam and normal, from 0 to 1. The arrays broadcast against each other. A method that has
        estimated a plane passes its normal's cosine and need not rely on local slopes.
        """
        if self.form == "lateral":
            return self.bias.value(depth_mm, np.broadcast_arrays(slope, cos_incidence)[0])
        return self.bias.value(depth_mm, _tangent(np.broadcast_arrays(cos_incidence, slope)[0]))

    def slopes(self, scan: Scan) -> FloatArray:
        """(profiles, pixels) slope of each beam, Y over depth from the apex."""
        points_mm = scan.in_profiles_mm
        reach_mm = points_mm[..., 2] - self.apex_mm[2]
        slope: FloatArray = (points_mm[..., 1] - self.apex_mm[1]) / reach_mm
        return slope

    def correct(self, scan: Scan) -> Scan:
        """Take the bias out of a scan, every point moved along its beam.

        The incidence comes from the points around each one. Beside edges and on surfaces smaller
        than a few beams it is a guess.
        """
        slope = self.slopes(scan)
        cos_incidence = self._cos_incidence(scan, slope)
        bias_mm = self.bias_mm(scan.in_profiles_mm[..., 2], slope, cos_incidence)
        points_mm = scan.points_mm.copy()
        points_mm[..., 1] -= slope * bias_mm
        points_mm[..., 2] -= bias_mm
        points_mm.setflags(write=False)
        return replace(scan, points_mm=points_mm)

    def sigma_mm(self, scan: Scan) -> FloatArray:
        """(profiles, pixels) standard deviation of each depth, NaN where nothing was measured.

        The incidence comes from the points around each one.
        """
        slope = self.slopes(scan)
        tangent = _tangent(self._cos_incidence(scan, slope))
        return self.sigma.value(scan.in_profiles_mm[..., 2], tangent)

    def _cos_incidence(self, scan: Scan, slope: FloatArray) -> FloatArray:
        """Between each beam and the true surface, as the points around it tell.

        The bias inclines what is measured: by its change over the neighbours that the local plane
        was fitted to, if they lie on one true plane. The inclination that explains the measured
        one is found by iteration. It converges where the bias bends a plane less than a sphere
        about the apex would, and points of different places are never mixed.
        """
        planes = local_planes(scan.points_mm)
        points_mm = scan.in_profiles_mm
        y_mm = points_mm[..., 1] - self.apex_mm[1]
        reach_mm = points_mm[..., 2] - self.apex_mm[2]
        # A fitted slope is that of a chord: sqrt(2) of the spread to both sides, for a disc.
        half_mm = np.maximum(np.sqrt(2.0) * planes.spread_mm, 0.1)
        across = planes.across

        def bias_at(offset_mm: FloatArray) -> FloatArray:
            reached_mm = reach_mm + across * offset_mm
            slopes = (y_mm + offset_mm) / reached_mm
            cosine = _cosine(planes.along, across, slopes)
            return self.bias_mm(reached_mm + self.apex_mm[2], slopes, cosine)

        for _ in range(PASSES):
            rise_mm = bias_at(planes.middle_mm + half_mm) - bias_at(planes.middle_mm - half_mm)
            across = planes.across - rise_mm / (2.0 * half_mm)
        return _cosine(planes.along, across, slope)

    def write(self, path: Path | str) -> None:
        """Write the file, UTF-8 JSON with units in its keys."""
        second = "tangent_of_incidence" if self.form == "incidence" else "slope_of_beam"
        data = {
            "format": FORMAT,
            "version": VERSION,
            "measured_by": self.measured_by,
            "rms_mm": {name: round(value, 4) for name, value in self.rms_mm.items()},
            "known_to_mm": round(self.known_to_mm, 4),
            "apex_mm": np.round(self.apex_mm, 3).tolist(),
            "bias": {"form": self.form, **_written(self.bias, second)},
            "sigma": _written(self.sigma, "tangent_of_incidence"),
        }
        Path(path).write_text(_readable(data) + "\n", encoding="utf-8")


def read_calibration(path: Path | str) -> Calibration:
    """Read a calibration; raises CalibrationError, one line, or OSError where no file opens."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # not UTF-8, not JSON, or nested endlessly
        raise CalibrationError(f"{path}: is not JSON: {error}") from None
    try:
        return _parsed(data)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None


def _parsed(data: Any) -> Calibration:
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise CalibrationError(f"format: should be {FORMAT!r}, as a calibration file begins")
    if data.get("version") != VERSION:
        raise CalibrationError(f"version: is {data.get('version')!r}; this program reads {VERSION}")
    bias, sigma = (_section(data, key) for key in ("bias", "sigma"))
    form = bias.get("form")
    if form not in ("incidence", "lateral"):
        raise CalibrationError(f"bias.form: is {form!r}; expected 'incidence' or 'lateral'")
    second = "tangent_of_incidence" if form == "incidence" else "slope_of_beam"
    bias_table = _table(bias, "bias", second)
    sigma_table = _table(sigma, "sigma", "tangent_of_incidence")
    if form == "incidence":
        _check_reaches(bias_table, sigma_table)
    if (sigma_table.value_mm <= 0.0).any():
        raise CalibrationError("sigma.value_mm: holds a value that is not above 0")
    rms_mm = data.get("rms_mm", {})
    if not isinstance(rms_mm, dict) or not all(isinstance(v, int | float) for v in rms_mm.values()):
        raise CalibrationError("rms_mm: expected numbers by name")
    apex_mm = _numbers(data, "apex_mm", "apex_mm", 1)
    if apex_mm.shape != (3,):
        raise CalibrationError("apex_mm: expected three coordinates")
    known_to_mm = data.get("known_to_mm", KNOWN_TO_MM)
    if not isinstance(known_to_mm, int | float) or not 0.0 <= known_to_mm < np.inf:
        raise CalibrationError(f"known_to_mm: is {known_to_mm!r}; expected a number from 0 up")
    measured_by = str(data.get("measured_by", ""))
    return Calibration(
        form, apex_mm, bias_table, sigma_table, measured_by, dict(rms_mm), float(known_to_mm)
    )


def _check_reaches(bias: Table, sigma: Table) -> None:
    for key, name in (("depth_mm", "depth_mm"), ("at", "tangent_of_incidence")):
        (low, high), (low_of_sigma, high_of_sigma) = (
            getattr(table, key)[[0, -1]] for table in (bias, sigma)
        )
        both = max(high, high_of_sigma) - min(low, low_of_sigma)
        if both > WIDEST * min(high - low, high_of_sigma - low_of_sigma):
            raise CalibrationError(
                f"bias.{name} and sigma.{name}: reach from {low:g} to {high:g} and from "
                f"{low_of_sigma:g} to {high_of_sigma:g}; expected ranges of which both together "
                f"are at most {WIDEST:g} times as wide as the narrower (values are constant beyond)"
            )


def _section(data: dict[str, Any], key: str) -> dict[str, Any]:
    section = data.get(key)
    if not isinstance(section, dict):
        raise CalibrationError(f"{key}: is missing or holds no keys")
    return section


def _table(section: dict[str, Any], name: str, second: str) -> Table:
    depth_mm = _numbers(section, "depth_mm", f"{name}.depth_mm", 1)
    at = _numbers(section, second, f"{name}.{second}", 1)
    for nodes, key in ((depth_mm, "depth_mm"), (at, second)):
        if len(nodes) < 2 or (np.diff(nodes) <= 0.0).any():
            raise CalibrationError(f"{name}.{key}: expected at least two ascending numbers")
    value_mm = _numbers(section, "value_mm", f"{name}.value_mm", 2)
    if value_mm.shape != (len(depth_mm), len(at)):
        raise CalibrationError(
            f"{name}.value_mm: has shape {value_mm.shape}; expected {(len(depth_mm), len(at))}, "
            f"depth_mm by {second}"
        )
    return Table(depth_mm, at, value_mm)


def _numbers(section: dict[str, Any], key: str, name: str, dimensions: int) -> FloatArray:
    try:
        values = np.array(section[key], dtype=np.float64)
    except KeyError:
        raise CalibrationError(f"{name}: is missing") from None
    except (TypeError, ValueError):
        raise CalibrationError(f"{name}: expected numbers") from None
    if values.ndim != dimensions or not np.isfinite(values).all():
        kind = "a list" if dimensions == 1 else "a list of lists"
        raise CalibrationError(f"{name}: expected {kind} of finite numbers")
    return values


def _written(table: Table, second: str) -> dict[str, Any]:
    return {
        "depth_mm": np.round(table.depth_mm, 3).tolist(),
        second: np.round(table.at, 5).tolist(),
        "value_mm": np.round(table.value_mm, 4).tolist(),
    }


def _readable(data: dict[str, Any]) -> str:
    """JSON with innermost lists of numbers on one line each."""

    def text(value: Any, indent: int) -> str:
        inner, outer = " " * (indent + 2), " " * indent
        if isinstance(value, dict):
            items = [f"{inner}{json.dumps(k)}: {text(v, indent + 2)}" for k, v in value.items()]
            return "{\n" + ",\n".join(items) + f"\n{outer}}}"
        if isinstance(value, list) and value and isinstance(value[0], list):
            return "[\n" + ",\n".join(inner + json.dumps(v) for v in value) + f"\n{outer}]"
        return json.dumps(value)

    return text(data, 0)


def _cosine(along: FloatArray, across: FloatArray, slope: FloatArray) -> FloatArray:
    """Cosine between a beam (0, slope, 1) and the normal of a surface of that inclination."""
    length = np.sqrt((1.0 + along**2 + across**2) * (1.0 + slope**2))
    cosine: FloatArray = np.abs(1.0 - across * slope) / length
    return cosine


def _tangent(cos_incidence: ArrayLike) -> FloatArray:
    cosine = np.clip(np.asarray(cos_incidence, dtype=float), 1e-6, 1.0)
    tangent: FloatArray = np.sqrt(1.0 / cosine**2 - 1.0)
    return tangent
