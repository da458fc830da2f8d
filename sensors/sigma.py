"""How uncertain each depth is: the variances of the noise model, without drawing from it."""

from __future__ import annotations

import numpy as np

from registration.scan import FloatArray
from scenes.scene import Scene
from sensors import light, noise
from sensors.jupiter import Jupiter
from sensors.sensor import Hits, Sensor


def depth_variance_mm2(sensor: Sensor, scene: Scene, hits: Hits) -> FloatArray | None:
    """Variance of the depth that each beam measures, or None for a sensor with another noise model.

    hits: of a straight line, where depths in the view frame are those in the profile's own.
    Returns (profiles, pixels) in mm^2, NaN where nothing returns. Independent errors add up:
    Gaussian noise, speckle (at the mean over its grain), the roughness of the material, and
    the square of the depth step over 12, as if the rounding were an independent error, which it
    nearly is where the other noise is larger than half a step. Bulge, ghosts and mixed points are
    no noise and not counted.
    """
    if not isinstance(sensor, Jupiter):
        return None
    params = sensor.params.noise
    slopes = sensor.params.slopes
    depth_mm = hits.points_mm[..., 2]
    optics = light.surface_optics(scene)
    variance = np.where(hits.valid, 0.0, np.nan)
    if params.on("gaussian"):
        ahead = -(hits.normal[..., 1] * slopes + hits.normal[..., 2])
        lengthening = np.sqrt(1.0 + slopes**2) / ahead - 1.0
        sigma = noise.square_law(params.sigma_near_mm, params.sigma_far_mm).at(depth_mm)
        sigma *= optics.noise[hits.surface] * (1.0 + params.sigma_incidence * lengthening)
        variance += sigma**2
    if params.on("speckle"):
        sigma = noise.square_law(params.speckle_near_mm, params.speckle_far_mm).at(depth_mm)
        grains = 1.0 / params.speckle_contrast**2
        # The mean of 1 / brightness, which is gamma distributed with that shape and mean 1.
        variance += sigma**2 * grains / (grains - 1.0)
    if params.on("texture"):
        variance += optics.roughness_mm[hits.surface] ** 2
    if params.on("quantised"):
        step = noise.square_law(params.step_near_mm, params.step_far_mm).at(depth_mm)
        variance += (step * np.sqrt(1.0 + slopes**2)) ** 2 / 12.0
    return variance
