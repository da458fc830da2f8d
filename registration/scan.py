"""The input of a registration: the profiles of one view, exactly as the scanner delivered them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


class ScanError(ValueError):
    """The given arrays cannot be a scan; the message says what would have been one."""


@dataclass(frozen=True)
class Scan:
    """The measurements of one view, in the sensor frame of its first profile.

    X is the direction in which the sensor moved, Y lies along the profile, Z is depth.

    points_mm: (profiles, pixels, 3), NaN where nothing returned; the index is the beam.
    step_mm: distance along X between neighbouring profiles.
    intensity: (profiles, pixels) or None.
    apex_mm: (3,) the point behind the sensor's front where the beams of the first profile meet, or
        None; profile k has its own at apex_mm + (k step_mm, 0, 0).
    """

    points_mm: FloatArray
    step_mm: float
    intensity: FloatArray | None = None
    apex_mm: FloatArray | None = None

    @classmethod
    def from_points(
        cls,
        points_mm: ArrayLike,
        step_mm: float,
        intensity: ArrayLike | None = None,
        apex_mm: ArrayLike | None = None,
    ) -> Scan:
        """Check and copy organised points into a scan; raises ScanError.

        points_mm: (profiles, pixels, 3) in mm; a point with any coordinate not finite is a
            no-return.
        """
        points = _float_array(points_mm, "points_mm")
        if points.ndim != 3 or points.shape[2] != 3 or 0 in points.shape:
            raise ScanError(
                f"points_mm has shape {points.shape}; expected (profiles, pixels, 3), "
                "NaN where nothing returned"
            )
        if not (np.isfinite(step_mm) and step_mm > 0.0):
            raise ScanError(f"step_mm is {step_mm}; expected a length above 0 mm")
        points[~np.isfinite(points).all(axis=2)] = np.nan
        brightness = None
        if intensity is not None:
            brightness = _float_array(intensity, "intensity")
            if brightness.shape != points.shape[:2]:
                raise ScanError(
                    f"intensity has shape {brightness.shape}; expected {points.shape[:2]}"
                )
            brightness.setflags(write=False)
        apex = None
        if apex_mm is not None:
            apex = _float_array(apex_mm, "apex_mm")
            if apex.shape != (3,) or not np.isfinite(apex).all():
                raise ScanError(f"apex_mm is {apex.tolist()}; expected three finite lengths in mm")
            apex.setflags(write=False)
        points.setflags(write=False)
        return cls(points, float(step_mm), brightness, apex)

    @property
    def valid(self) -> BoolArray:
        """(profiles, pixels) True where a point was measured."""
        mask: BoolArray = np.isfinite(self.points_mm[..., 2])
        return mask

    @property
    def n_valid(self) -> int:
        """Number of measured points."""
        return int(np.count_nonzero(self.valid))


def _float_array(values: ArrayLike, name: str) -> FloatArray:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ScanError(f"{name} is not an array of numbers: {error}") from None
