"""What surfaces are made of: their colour in pictures and what a laser spot on them does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """How a surface sends a laser's light back; no numbers but the order of them is in the thesis.

    rgb: colour in pictures.
    albedo: share of the light that returns from a diffuse surface met head-on, 0 to 1.
    gloss: share that is added head-on by a mirror-like lobe, 0 to 1.
    gloss_width: tangent of the incidence at which the lobe has fallen to exp(-1/2).
    contrast: spread of the natural logarithm of the returned light, from point to point.
    roughness_mm: standard deviation of the height of the surface within a spot.
    noise: factor on the sensor's random error.

    Section 3.2.3.2 orders them: rough dark foam loses points and shape; white paper over it gives
    a true profile with plain Gaussian noise; a computer screen is clear but for large angles.
    """

    rgb: tuple[float, float, float]
    albedo: float
    gloss: float = 0.0
    gloss_width: float = 0.2
    contrast: float = 0.1
    roughness_mm: float = 0.0
    noise: float = 1.0

    def __post_init__(self) -> None:
        if not (self.albedo > 0.0 and self.gloss >= 0.0 and self.albedo + self.gloss <= 1.0):
            raise ValueError(
                f"albedo is {self.albedo} and gloss is {self.gloss}; expected an albedo above 0 "
                "and a gloss from 0 that sum to 1 at most"
            )
        if self.gloss_width <= 0.0 or min(self.contrast, self.roughness_mm, self.noise) < 0.0:
            raise ValueError(
                "expected gloss_width above 0 and contrast, roughness_mm and noise from 0, not "
                f"{self.gloss_width}, {self.contrast}, {self.roughness_mm} and {self.noise}"
            )


MATERIALS: dict[str, Material] = {
    "rough_foam": Material(
        (0.55, 0.56, 0.58), albedo=0.18, contrast=0.5, roughness_mm=1.2, noise=0.8
    ),
    "white_paper": Material((0.95, 0.94, 0.90), albedo=0.85, gloss=0.05, roughness_mm=0.05),
    "matt_plastic": Material(
        (0.80, 0.77, 0.68), albedo=0.60, gloss=0.10, gloss_width=0.3, roughness_mm=0.02, noise=0.9
    ),
    "specular_plastic": Material(
        (0.25, 0.30, 0.36), albedo=0.16, gloss=0.70, contrast=0.05, noise=0.7
    ),
    "wood": Material(
        (0.76, 0.58, 0.38), albedo=0.45, gloss=0.05, contrast=0.2, roughness_mm=0.1, noise=0.9
    ),
    "fabric": Material((0.62, 0.35, 0.27), albedo=0.25, contrast=0.4, roughness_mm=0.5, noise=0.9),
    "metal": Material((0.62, 0.68, 0.74), albedo=0.25, gloss=0.60, gloss_width=0.15, noise=0.8),
}
