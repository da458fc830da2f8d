"""What a triangulating sensor adds to an exact depth; each effect can be switched off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.scan import FloatArray


@dataclass(frozen=True)
class NoiseParams:
    """Random error and quantisation of the depth, given at the near and the far limit.

    gaussian, quantised: switch either effect off; with both off the depth is exact.
    sigma_near_mm, sigma_far_mm: standard deviation of the random error.
    step_near_mm, step_far_mm: spacing of the depths that can be told apart (section 3.2.3.1).

    Both grow as (Z + c)^2 in between, c chosen to meet the two ends: what an error of constant size
    on the image plane becomes in depth.
    """

    gaussian: bool = True
    quantised: bool = True
    sigma_near_mm: float = 0.3
    sigma_far_mm: float = 1.5
    step_near_mm: float = 0.3
    step_far_mm: float = 2.0

    def __post_init__(self) -> None:
        for name in ("sigma", "step"):
            near, far = getattr(self, f"{name}_near_mm"), getattr(self, f"{name}_far_mm")
            if not 0.0 < near < far < np.inf:
                raise ValueError(
                    f"{name}_near_mm is {near} and {name}_far_mm is {far}; expected lengths above "
                    f"0 mm, the far one larger (no effect at all: gaussian or quantised false)"
                )


@dataclass(frozen=True)
class SquareLaw:
    """A length that grows with depth as scale (Z + shift_mm)^2."""

    scale_per_mm: float
    shift_mm: float

    def at(self, depth_mm: FloatArray) -> FloatArray:
        """The length in mm at each depth."""
        length_mm: FloatArray = self.scale_per_mm * (depth_mm + self.shift_mm) ** 2
        return length_mm


def square_law(limits_mm: tuple[float, float], lengths_mm: tuple[float, float]) -> SquareLaw:
    """The square law that has the two given lengths at the two given depths."""
    ratio = np.sqrt(lengths_mm[0] / lengths_mm[1])
    shift_mm = (ratio * limits_mm[1] - limits_mm[0]) / (1.0 - ratio)
    return SquareLaw(float(lengths_mm[0] / (limits_mm[0] + shift_mm) ** 2), float(shift_mm))


def measured_depth(
    depth_mm: FloatArray,
    limits_mm: tuple[float, float],
    params: NoiseParams,
    rng: np.random.Generator,
) -> FloatArray:
    """Depth as the sensor reports it; NaN stays NaN.

    depth_mm: exact depths of any shape.
    limits_mm: the near and far depth at which params gives its lengths.

    One random number is drawn for every element, measured or not and whatever is switched on, so
    that the noise of a beam does not depend on what the other beams meet.
    """
    draws = rng.standard_normal(depth_mm.shape)
    depth = depth_mm
    if params.gaussian:
        sigma = square_law(limits_mm, (params.sigma_near_mm, params.sigma_far_mm))
        depth = depth + sigma.at(depth) * draws
    if params.quantised:
        step = square_law(limits_mm, (params.step_near_mm, params.step_far_mm))
        # Even steps of the image coordinate 1 / (Z + c) are steps of scale (Z + c)^2 in depth.
        image = np.rint(1.0 / (depth + step.shift_mm) / step.scale_per_mm)
        depth = 1.0 / (image * step.scale_per_mm) - step.shift_mm
    return depth
