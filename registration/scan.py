"""The input of a registration: the profiles of one view, exactly as the scanner delivered them."""

from __future__ import annotations

from dataclasses import dataclass, field
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.int32]  # where there is one for every point: half the memory to walk


LEAST_ALONG_X = (
    0.1  # of a unit of travel: a sensor that moves within its laser plane sweeps nothing
)


class ScanError(ValueError):
    """The given arrays cannot be a scan; the message says what would have been one."""


@dataclass(frozen=True)
class Scan:
    """The measurements of one view, in the sensor frame of its first profile.

    Y lies along the profile and Z is depth. X is across the laser plane: the direction in which the
    sensor moved, unless travel says otherwise.

    points_mm: (profiles, pixels, 3), NaN where nothing returned; the index is the beam.
    step_mm: how far the sensor moved between neighbouring profiles. Where they are unevenly spaced
        it is the mean, and k step_mm, below and in origins_mm, is where a profile was due:
        gauss_sphere reads from the points where it lies.
    intensity: (profiles, pixels) or None.
    apex_mm: (3,) the point behind the sensor's front where the beams of the first profile meet, or
        None; profile k has its own at apex_mm + k step_mm travel.
    travel: (3,) unit vector along which the sensor moved, in its own frame: (1, 0, 0), or another
        where the sensor is mounted at a slant to its motion. Profile k was measured from
        k step_mm travel, and the points already stand where that puts them.
    """

    points_mm: FloatArray
    step_mm: float
    intensity: FloatArray | None = None
    apex_mm: FloatArray | None = None
    travel: FloatArray = field(default_factory=lambda: _direction([1.0, 0.0, 0.0]))

    @classmethod
    def from_points(
        cls,
        points_mm: ArrayLike,
        step_mm: float,
        intensity: ArrayLike | None = None,
        apex_mm: ArrayLike | None = None,
        travel: ArrayLike = (1.0, 0.0, 0.0),
    ) -> Scan:
        """Check and copy organised points into a scan; raises ScanError.

        points_mm: (profiles, pixels, 3) in mm; a point with any coordinate not finite is a
            no-return.
        travel: (3,) of any length; it is made a unit vector.
        """
        points = _float_array(points_mm, "points_mm")
        if points.ndim != 3 or points.shape[2] != 3 or 0 in points.shape:
            raise ScanError(
                f"points_mm has shape {points.shape}; expected (profiles, pixels, 3), "
                "NaN where nothing returned"
            )
        step = np.asarray(step_mm, dtype=object)  # ragged lists, too
        number = step.item() if step.shape == () else None
        if not isinstance(number, Real) or not 0.0 < float(number) < np.inf:
            raise ScanError(f"step_mm is {step_mm!r}; expected a number above 0, in mm")
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
        return cls(points, float(step_mm), brightness, apex, _direction(travel))

    @property
    def origins_mm(self) -> FloatArray:
        """(profiles, 3) where the sensor was at each profile, as its commanded motion has it."""
        steps = self.step_mm * np.arange(self.points_mm.shape[0])
        origins: FloatArray = steps[:, None] * self.travel
        return origins

    @property
    def in_profiles_mm(self) -> FloatArray:
        """(profiles, pixels, 3) the points, each in the sensor frame of its own profile."""
        moved: FloatArray = self.points_mm - self.origins_mm[:, None]
        return moved

    @property
    def valid(self) -> BoolArray:
        """(profiles, pixels) True where a point was measured."""
        mask: BoolArray = np.isfinite(self.points_mm[..., 2])
        return mask

    @property
    def n_valid(self) -> int:
        """Number of measured points."""
        return int(np.count_nonzero(self.valid))


def _direction(travel: ArrayLike) -> FloatArray:
    vector = _float_array(travel, "travel")
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not (0.0 < length < np.inf and abs(vector[0]) > LEAST_ALONG_X * length):
        raise ScanError(
            f"travel is {vector.tolist()}; expected three numbers, the direction of the motion in "
            f"the sensor frame, with {LEAST_ALONG_X:g} of it along X or more"
        )
    vector /= length
    vector.setflags(write=False)
    return vector


def _float_array(values: ArrayLike, name: str) -> FloatArray:
    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan)
        return np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise ScanError(f"{name} is not an array of numbers: {error}") from None
