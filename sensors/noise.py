"""What a triangulating sensor adds to exact depths; each effect can be switched off."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from registration.scan import BoolArray, FloatArray
from sensors.calibration import FAR_MM, NEAR_MM

# One stream of random numbers each, so that switching one effect off leaves the others as they are.
RANDOM_EFFECTS = ("gaussian", "speckle", "texture", "ghosts", "mixed")
SWITCHES = ("bulge", "gaussian", "speckle", "texture", "quantised", "dropout", "shadow", "ghosts",
            "mixed")  # fmt: skip


@dataclass(frozen=True)
class NoiseParams:
    """Every measurement effect, its switch and its size.

    Lengths named near and far hold at Z = 289.6 and 1189.6 mm, the ends of the precision analysis
    of section 3.2.3 (Z' = 1100 and 200), and grow as (Z + c)^2, c chosen to meet both: what an
    error of constant size on the image becomes in depth. "Assumed" means that the thesis gives no
    number.

    enabled: False switches every effect off, and measurements are exact.

    bulge: the bias of section 3.2.3.2 depends on the "incidence" of the beam (the thesis's
        explanation) or on the "lateral" position in the field; "none" switches it off.
    bulge_near_mm, bulge_far_mm: how far the middle of a flat target stands out before the edges
        of the field (2 and 8 mm, section 3.2.3.2).
    bulge_width: tangent of the incidence, or the slope of the beam, at which the bias has fallen to
        exp(-1/2) of its peak (assumed: half the field).
    bulge_towards_sensor: the sign; a larger Z' is nearer (figure 3.10).
    gaussian, sigma_near_mm, sigma_far_mm: random error of a white, matt surface met head-on
        (assumed).
    sigma_incidence: the random error grows with 1 + this (1 / cos(incidence) - 1) (assumed; 1
        would be as the spot lengthens).
    speckle, speckle_near_mm, speckle_far_mm: error of the spot's centre by the grain of coherent
        light (assumed).
    speckle_contrast: standard deviation of that grain over its mean; it shows in the intensity,
        and the fainter a spot, the larger its speckle error (assumed).
    texture: roughness of the material and change of its reflectance from point to point
        (scenes.materials).
    quantised, step_near_mm, step_far_mm: spacing of the depths that can be told apart (0.3 and
        2 mm, section 3.2.3.1).
    dropout: points are lost at grazing incidence and where too little light comes back.
    grazing_deg: incidence beyond which nothing is measured (assumed).
    threshold: least returned light, 1 standing for a white diffuse surface met head-on (assumed).
    shadow, baseline_mm: a point that the receiver, this far along Y from where the beams meet,
        cannot see is not measured; negative on the other side (assumed).
    ghosts, ghost_pixels: beside a depth step up to this many beams that should measure the nearer
        surface measure the mirror-like inclined farther one instead (figure 3.8; size assumed).
    ghost_step_mm, ghost_incidence_deg: least depth step and inclination for that (assumed).
    mixed, spot_pixels: half width of the laser spot, in spacings of neighbouring beams; a spot cut
        by an edge measures a depth between both sides (assumed).
    mixed_step_mm: largest depth step over which spots still blend on the image (assumed).
    """

    enabled: bool = True
    bulge: Literal["incidence", "lateral", "none"] = "incidence"
    bulge_near_mm: float = 2.0
    bulge_far_mm: float = 8.0
    bulge_width: float = 0.117
    bulge_towards_sensor: bool = True
    gaussian: bool = True
    sigma_near_mm: float = 0.3
    sigma_far_mm: float = 1.5
    sigma_incidence: float = 0.5
    speckle: bool = True
    speckle_near_mm: float = 0.06
    speckle_far_mm: float = 0.3
    speckle_contrast: float = 0.3
    texture: bool = True
    quantised: bool = True
    step_near_mm: float = 0.3
    step_far_mm: float = 2.0
    dropout: bool = True
    grazing_deg: float = 82.0
    threshold: float = 0.05
    shadow: bool = True
    baseline_mm: float = 120.0
    ghosts: bool = True
    ghost_pixels: int = 4
    ghost_step_mm: float = 40.0
    ghost_incidence_deg: float = 15.0
    mixed: bool = True
    spot_pixels: float = 0.3
    mixed_step_mm: float = 60.0

    def __post_init__(self) -> None:
        if self.bulge not in ("incidence", "lateral", "none"):
            raise ValueError(f"bulge is {self.bulge!r}; expected 'incidence', 'lateral' or 'none'")
        for name in ("enabled", "bulge_towards_sensor", *SWITCHES[1:]):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected True or False")
        if not isinstance(self.ghost_pixels, int):
            raise ValueError(f"ghost_pixels is {self.ghost_pixels}; expected a whole number")
        for name in ("bulge", "sigma", "speckle", "step"):
            near, far = getattr(self, f"{name}_near_mm"), getattr(self, f"{name}_far_mm")
            if not 0.0 < near < far < np.inf:
                raise ValueError(
                    f"{name}_near_mm is {near} and {name}_far_mm is {far}; expected lengths above "
                    "0 mm, the far one larger (no effect at all: switch it off)"
                )
        for name, low, high in (
            ("bulge_width", 0.01, 10.0),
            ("sigma_incidence", 0.0, 100.0),
            ("speckle_contrast", 0.01, 0.5),
            ("grazing_deg", 0.0, 90.0),
            ("threshold", 0.0, 1.0),
            ("baseline_mm", -1000.0, 1000.0),
            ("ghost_pixels", 0, 64),
            ("ghost_step_mm", 0.0, 10_000.0),
            ("ghost_incidence_deg", 0.0, 90.0),
            ("spot_pixels", 0.0, 0.5),
            ("mixed_step_mm", 0.0, 10_000.0),
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name)}; expected {low} to {high}")

    def on(self, effect: str) -> bool:
        """Whether an effect of SWITCHES takes place."""
        return self.enabled and getattr(self, effect) not in (False, "none")

    @classmethod
    def exact(cls) -> NoiseParams:
        """Every effect switched off."""
        return cls(enabled=False)

    @classmethod
    def only(cls, effect: str, **changes: Any) -> NoiseParams:
        """A single effect of SWITCHES with its default size, or with some parameters changed."""
        default = cls()
        off = {name: "none" if name == "bulge" else False for name in SWITCHES if name != effect}
        if effect not in SWITCHES or not changes.keys() <= {f.name for f in fields(cls)}:
            raise ValueError(f"unknown effect or parameter in {effect!r}, {sorted(changes)}")
        return replace(default, **{**off, **changes})


@dataclass(frozen=True)
class SquareLaw:
    """A length that grows with depth as scale (Z + shift_mm)^2."""

    scale_per_mm: float
    shift_mm: float

    def at(self, depth_mm: FloatArray) -> FloatArray:
        """The length in mm at each depth."""
        length_mm: FloatArray = self.scale_per_mm * (depth_mm + self.shift_mm) ** 2
        return length_mm


def square_law(
    near_mm: float, far_mm: float, depths_mm: tuple[float, float] = (NEAR_MM, FAR_MM)
) -> SquareLaw:
    """The square law that has the two given lengths at the two depths."""
    ratio = np.sqrt(near_mm / far_mm)
    shift_mm = (ratio * depths_mm[1] - depths_mm[0]) / (1.0 - ratio)
    return SquareLaw(float(near_mm / (depths_mm[0] + shift_mm) ** 2), float(shift_mm))


def random_streams(rng: np.random.Generator) -> dict[str, np.random.Generator]:
    """One independent generator for each random effect."""
    seeds = rng.integers(2**63, size=(len(RANDOM_EFFECTS), 2))
    pairs = zip(RANDOM_EFFECTS, seeds.tolist(), strict=True)
    return {name: np.random.default_rng(seed) for name, seed in pairs}


def bulge_mm(
    depth_mm: FloatArray, tangent: FloatArray, edge_slope: float, params: NoiseParams
) -> FloatArray:
    """Bias of the depth, negative towards the sensor (section 3.2.3.2; its shape is assumed).

    tangent: of the incidence, or slope of the beam. On a flat target parallel to Y both are the
    same, from 0 in the middle to edge_slope, and the bias differs by the published size.
    """
    size = square_law(params.bulge_near_mm, params.bulge_far_mm).at(depth_mm)
    edge = np.exp(-0.5 * (edge_slope / params.bulge_width) ** 2)
    lobe = np.exp(-0.5 * (tangent / params.bulge_width) ** 2) / (1.0 - edge)
    bias: FloatArray = -size * lobe if params.bulge_towards_sensor else size * lobe
    return bias


def random_error_mm(
    depth_mm: FloatArray,
    cos_incidence: FloatArray,
    material_noise: FloatArray,
    roughness_mm: FloatArray,
    grain: FloatArray,
    params: NoiseParams,
    streams: dict[str, np.random.Generator],
) -> FloatArray:
    """Sum of the random depth errors that are switched on.

    All arrays have one shape. material_noise, roughness_mm: of the surface that is measured;
    grain: its speckle, see `speckle_grain`. As many random numbers are drawn as there are
    elements, measured or not, so that a beam's noise does not depend on what others meet.
    """
    error_mm = np.zeros(depth_mm.shape)
    if params.on("gaussian"):
        sigma = square_law(params.sigma_near_mm, params.sigma_far_mm).at(depth_mm)
        sigma *= material_noise * (1.0 + params.sigma_incidence * (1.0 / cos_incidence - 1.0))
        error_mm += sigma * streams["gaussian"].standard_normal(depth_mm.shape)
    if params.on("speckle"):
        sigma = square_law(params.speckle_near_mm, params.speckle_far_mm).at(depth_mm)
        sigma /= np.sqrt(np.maximum(grain, 0.05))
        error_mm += sigma * streams["speckle"].standard_normal(depth_mm.shape)
    if params.on("texture"):
        error_mm += roughness_mm * streams["texture"].standard_normal(depth_mm.shape)
    return error_mm


def speckle_grain(
    shape: tuple[int, ...], params: NoiseParams, streams: dict[str, np.random.Generator]
) -> FloatArray:
    """Brightness of each spot by speckle, mean 1: a gamma distribution of the given contrast.

    It is the sum of 1 / contrast^2 independent grains, each of exponential brightness.
    """
    if not params.on("speckle"):
        return np.ones(shape)
    grains = 1.0 / params.speckle_contrast**2
    brightness: FloatArray = streams["speckle"].standard_gamma(grains, shape) / grains
    return brightness


def quantised_mm(depth_mm: FloatArray, slopes: FloatArray, params: NoiseParams) -> FloatArray:
    """The nearest depth that the sensor can tell from its neighbours.

    slopes: (pixels,) Y over depth of the beams, along the last axis of depth_mm. Steps are even on
    the image, that is in 1 / range along the beam: off the middle of the field they are larger, as
    in figure 3.16, by sqrt(1 + slope^2).
    """
    law = square_law(params.step_near_mm, params.step_far_mm)
    stretch = np.sqrt(1.0 + slopes**2)
    image = np.rint(1.0 / ((depth_mm + law.shift_mm) * stretch * law.scale_per_mm))
    depth: FloatArray = 1.0 / (image * law.scale_per_mm * stretch) - law.shift_mm
    return depth


def too_faint(signal: FloatArray, cos_incidence: FloatArray, params: NoiseParams) -> BoolArray:
    """Where a point is lost: grazing incidence, or less light than the threshold."""
    lost: BoolArray = (signal < params.threshold) | (
        cos_incidence < np.cos(np.radians(params.grazing_deg))
    )
    return lost
