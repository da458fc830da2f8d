"""From the figures chapter 3 publishes to the parameters of the simulated Jupiter, by fits.

The published field of view and the published spacings contradict each other: no fan of rays has
both. `fit_geometry` fits either with the other let go, and says what is left of every number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from registration.scan import FloatArray

OFFSET_Y_MM, OFFSET_Z_MM = -38.9, 1389.6  # (3-2), (3-3)
PIXELS = 256  # of the profiles of section 3.2.3

Quantity = Literal["width", "mean spacing", "centre spacing", "edge spacing", "depth step", "bulge"]


@dataclass(frozen=True)
class Published:
    """One number of chapter 3.

    depth_mm: Z in the sensor frame (1389.6 mm minus the Z' of the figure); value_mm: as printed.
    """

    quantity: Quantity
    depth_mm: float
    value_mm: float
    source: str


NEAR_MM, FAR_MM = OFFSET_Z_MM - 1100.0, OFFSET_Z_MM - 200.0  # the ends of the precision analysis

FIELD = (
    Published("width", 170.0, 108.0, "section 3.2.1, figure 3.6"),
    Published("width", 1175.0, 579.0, "section 3.2.1, figure 3.6"),
)
SPACINGS = (
    Published("mean spacing", NEAR_MM, 0.7, "figure 3.11"),
    Published("mean spacing", FAR_MM, 2.5, "figure 3.11"),
    Published("centre spacing", FAR_MM, 2.3, "figure 3.13"),
    Published("edge spacing", FAR_MM, 2.85, "figure 3.13 (2.8 and 2.9)"),
    Published("centre spacing", OFFSET_Z_MM - 700.0, 1.3, "figure 3.14"),
    Published("edge spacing", OFFSET_Z_MM - 700.0, 1.7, "figure 3.14"),
)
DEPTH_STEPS = (
    Published("depth step", NEAR_MM, 0.3, "section 3.2.3.1, figure 3.10 (j)"),
    Published("depth step", FAR_MM, 2.0, "section 3.2.3.1, figure 3.10 (a)"),
)
BULGES = (
    Published("bulge", NEAR_MM, 2.0, "section 3.2.3.2"),
    Published("bulge", FAR_MM, 8.0, "section 3.2.3.2"),
)
PUBLISHED = FIELD + SPACINGS + DEPTH_STEPS + BULGES


@dataclass(frozen=True)
class FanGeometry:
    """Where the rays of a profile run: Y = slope(u) (Z + apex_depth_mm), u from -1 to 1.

    edge_slope: tangent of the half angle.
    widening: by how much rays at the edge are farther apart than in the middle, as a share.
    """

    edge_slope: float
    apex_depth_mm: float
    widening: float

    def slopes(self, pixels: int) -> FloatArray:
        """(pixels,) Y over depth from the apex along each ray, ascending.

        k (u + c u^3 / 3) / (1 + c / 3) for u from -1 to 1, k the edge slope and c the widening:
        the spacing of neighbours then grows as 1 + c u^2. Equal angles, by which section 3.2.3.1
        explains it, would widen it by 5.5 % at the edge; figures 3.13 and 3.14 show 22 to 31 %.
        """
        u, c = np.linspace(-1.0, 1.0, pixels), self.widening
        slopes: FloatArray = self.edge_slope * u * (1.0 + c * u**2 / 3.0) / (1.0 + c / 3.0)
        return slopes

    def width_mm(self, depth_mm: ArrayLike) -> FloatArray:
        """Width of the field at a depth."""
        width_mm: FloatArray = (
            2.0 * self.edge_slope * (np.asarray(depth_mm, dtype=float) + self.apex_depth_mm)
        )
        return width_mm

    def predict(self, number: Published) -> float:
        """What this geometry has in place of a published width or spacing, in mm."""
        if number.quantity == "width":
            return float(self.width_mm(number.depth_mm))
        spacing_mm = np.diff(self.slopes(PIXELS)) * (number.depth_mm + self.apex_depth_mm)
        if number.quantity == "mean spacing":
            return float(spacing_mm.mean())
        if number.quantity == "centre spacing":
            return float(spacing_mm[len(spacing_mm) // 2])
        if number.quantity == "edge spacing":
            return float(spacing_mm[0])
        raise ValueError(f"the geometry says nothing of the {number.quantity}")


def fan_of_field(
    near_mm: float, far_mm: float, near_width_mm: float, far_width_mm: float, widening: float
) -> FanGeometry:
    """The fan whose field has the given widths at two depths."""
    edge_slope = 0.5 * (far_width_mm - near_width_mm) / (far_mm - near_mm)
    return FanGeometry(edge_slope, 0.5 * near_width_mm / edge_slope - near_mm, widening)


def fit_geometry(keep: Literal["field", "spacings"]) -> FanGeometry:
    """Fit the relative misfits of the published spacings (section 3.2.3.1).

    keep: "field" holds the field of view at its published widths and leaves the widening free;
        "spacings" frees the field too.
    Least is the sum of fourth powers, in which the largest misfit counts most.
    """
    if keep == "field":
        (near, far) = FIELD
        field = (near.depth_mm, far.depth_mm, near.value_mm, far.value_mm)

        def fan(free: FloatArray) -> FanGeometry:
            return fan_of_field(*field, float(free[0]))

        start = [0.2]
    elif keep == "spacings":

        def fan(free: FloatArray) -> FanGeometry:
            # The apex in units that make all three parameters about as large.
            return FanGeometry(float(free[0]), 100.0 * float(free[1]), float(free[2]))

        start = [0.2, 0.5, 0.2]
    else:
        raise ValueError(f"keep is {keep!r}; expected 'field' or 'spacings'")

    def residuals(free: FloatArray) -> FloatArray:
        squares: FloatArray = misfits(fan(free), SPACINGS) ** 2
        return 10.0 * squares  # about 1 to begin with

    return fan(least_squares(residuals, start, xtol=1e-12, ftol=1e-12).x)


def misfits(geometry: FanGeometry, numbers: Sequence[Published]) -> FloatArray:
    """(k,) relative difference of the geometry from each published width or spacing."""
    return np.array([geometry.predict(n) / n.value_mm - 1.0 for n in numbers])
