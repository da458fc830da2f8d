"""How much light a spot sends back: by material, incidence and texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.scan import FloatArray, IntArray
from scenes.materials import MATERIALS, Material
from scenes.scene import Scene


@dataclass(frozen=True)
class SurfaceOptics:
    """Properties of the material of each surface, arrays (surfaces + 1,).

    The last entry, NaN, stands for no surface, so that index -1 of a no-return leads to it.
    """

    albedo: FloatArray
    gloss: FloatArray
    gloss_width: FloatArray
    contrast: FloatArray
    roughness_mm: FloatArray
    noise: FloatArray


def surface_optics(scene: Scene) -> SurfaceOptics:
    """Look the materials of a scene's surfaces up."""
    materials: list[Material] = [MATERIALS[s.material] for s in scene.surfaces]
    names = ("albedo", "gloss", "gloss_width", "contrast", "roughness_mm", "noise")
    return SurfaceOptics(*(np.array([*(getattr(m, n) for m in materials), np.nan]) for n in names))


def returned_light(
    optics: SurfaceOptics, surface: IntArray, cos_incidence: FloatArray
) -> FloatArray:
    """Light that comes back from each spot, 1 for a white diffuse surface met head-on.

    A diffuse part by Lambert's law and a lobe about the mirrored direction: laser and receiver are
    so close to each other that a mirror sends light back only when met head-on. The controller
    holds the laser's power so that distance does not matter (section 3.2.3.2).
    """
    tangent_squared = 1.0 / cos_incidence**2 - 1.0
    lobe = np.exp(-0.5 * tangent_squared / optics.gloss_width[surface] ** 2)
    light: FloatArray = optics.albedo[surface] * cos_incidence + optics.gloss[surface] * lobe
    return light


def textured(
    light: FloatArray, optics: SurfaceOptics, surface: IntArray, rng: np.random.Generator
) -> FloatArray:
    """Light after the change of the reflectance from point to point, log-normal, median 1."""
    factor: FloatArray = np.exp(optics.contrast[surface] * rng.standard_normal(light.shape))
    return light * factor


def levels(light: FloatArray) -> FloatArray:
    """Light as the controller stores it, whole numbers 0 to 255, 0 where nothing came back."""
    level: FloatArray = np.rint(255.0 * np.clip(np.nan_to_num(light, nan=0.0), 0.0, 1.0))
    return level
