"""The Jupiter laser range finder: one fan of rays a profile, and what becomes of each ray."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from registration.scan import BoolArray, FloatArray, IntArray, Scan
from scenes.rays import cast_fans, ray_target
from scenes.scene import Scene
from sensors import edges, light, noise
from sensors.calibration import FanGeometry, fan_of_field
from sensors.noise import NoiseParams
from sensors.paths import ViewPath
from sensors.sensor import Hits


@dataclass(frozen=True)
class JupiterParams:
    """Geometry of the field and the measurement effects.

    pixels: points a profile, 256 or 512.
    near_mm, far_mm: depths of the near and the far plane, from the sensor's front (section 3.2.1,
        figure 3.6).
    near_width_mm, far_width_mm: width of the field at these planes (likewise).
    widening: by how much beams at the edge are farther apart than in the middle, as a share;
        0 spaces them evenly on a plane. The default is calibration.fit_geometry("field"): the
        published field holds and the published spacings are met within 9 %. With widths 114.8
        and 618.2 mm and widening 0.292, fit_geometry("spacings"), it is the other way round.
    range_limits: whether nothing is measured outside of the two planes.
    noise: measurement effects, all on; `noise: {enabled: false}` switches all off.
    """

    pixels: Literal[256, 512] = 256
    near_mm: float = 170.0
    far_mm: float = 1175.0
    near_width_mm: float = 108.0
    far_width_mm: float = 579.0
    widening: float = 0.273
    range_limits: bool = True
    noise: NoiseParams = field(default_factory=NoiseParams)

    def __post_init__(self) -> None:
        if self.pixels not in (256, 512):
            raise ValueError(f"pixels is {self.pixels}; the sensor measures 256 or 512 a profile")
        if not 0.0 < self.near_mm < self.far_mm < np.inf:
            raise ValueError(
                f"near_mm is {self.near_mm} and far_mm is {self.far_mm}; expected depths above 0 "
                "mm, the far one larger"
            )
        if not 0.0 < self.near_width_mm < self.far_width_mm < np.inf:
            raise ValueError(
                f"near_width_mm is {self.near_width_mm} and far_width_mm is {self.far_width_mm}; "
                "expected widths above 0 mm, the far one larger"
            )
        if not 0.0 <= self.widening <= 10.0:
            raise ValueError(f"widening is {self.widening}; expected 0 to 10")

    @property
    def fan(self) -> FanGeometry:
        """Where the rays of a profile run."""
        widths_mm = self.near_width_mm, self.far_width_mm
        return fan_of_field(self.near_mm, self.far_mm, *widths_mm, self.widening)

    @property
    def slopes(self) -> FloatArray:
        """(pixels,) Y over depth from the apex along each ray, wider apart towards the edges."""
        return self.fan.slopes(self.pixels)

    @property
    def edge_slope(self) -> float:
        """Y over depth from the apex along the outermost ray, the tangent of the half angle."""
        return self.fan.edge_slope

    @property
    def apex_depth_mm(self) -> float:
        """How far behind the front the rays meet."""
        return self.fan.apex_depth_mm


@dataclass(frozen=True)
class Jupiter:
    """A sensor; its frame has X along the motion, Y along the profile, Z in depth."""

    params: JupiterParams = field(default_factory=JupiterParams)

    @property
    def apex_mm(self) -> FloatArray:
        """(3,) point in the sensor frame where the rays meet."""
        return np.array([0.0, 0.0, -self.params.apex_depth_mm])

    def hits(self, scene: Scene, path: ViewPath) -> Hits:
        """Cast every ray of a view; exact points, surfaces and normals in the view frame."""
        reach_mm, surface = self._cast(scene, path)
        outside = ~self._in_range(reach_mm - self.params.apex_depth_mm)
        reach_mm[outside], surface[outside] = np.nan, -1
        T_view_profile = path.T_world_view.inv() * path.T_world_profile
        in_profile = self._points(reach_mm)
        points_mm = in_profile @ T_view_profile.rotation.as_matrix().transpose(0, 2, 1)
        points_mm += T_view_profile.translation[:, None, :]
        normal = path.T_world_view.rotation.inv().apply(ray_target(scene).normal)[surface]
        return Hits(points_mm, surface, normal, T_view_profile.translation)

    def scan(self, scene: Scene, path: ViewPath, rng: np.random.Generator) -> Scan:
        """Scan a view, with the effects of the parameters.

        The profiles are put together as the controller would: profile k at k step_mm along the
        commanded motion, wherever the sensor really was. Intensity is 0 to 255, 0 where nothing was
        measured.
        """
        reach_mm, intensity = self._measure(scene, path, rng)
        points_mm = self._points(reach_mm)
        points_mm += path.origins_mm[:, None]
        return Scan.from_points(points_mm, path.step_mm, intensity, travel=path.travel)

    def in_field(self, points_mm: FloatArray) -> BoolArray:
        """Whether Y and Z of points (n, 3) in the sensor frame lie in the field and the range."""
        depth_mm = points_mm[:, 2] + self.params.apex_depth_mm
        edge_mm = self.params.edge_slope * (1.0 + 1e-9) * depth_mm  # with the outermost ray
        return self._in_range(points_mm[:, 2]) & (np.abs(points_mm[:, 1]) <= edge_mm)

    def outline(self, path: ViewPath) -> tuple[FloatArray, ...]:
        """What a picture shows of a view, as polylines (k, 3) in world coordinates in mm.

        First the line that the sensor's front travels, then the borders of the field at the first
        and at the last profile.
        """
        params = self.params
        depth_mm = np.array([params.near_mm, params.near_mm, params.far_mm, params.far_mm])
        field_mm = np.zeros((5, 3))
        field_mm[:4, 1] = params.edge_slope * (depth_mm + params.apex_depth_mm) * [-1, 1, 1, -1]
        field_mm[:4, 2] = depth_mm
        field_mm[4] = field_mm[0]
        fields = (path.T_world_profile[k].apply(field_mm) for k in (0, -1))
        return (path.T_world_profile.translation, *fields)

    def _measure(
        self, scene: Scene, path: ViewPath, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Depth from the apex as measured (profiles, pixels), NaN where nothing is, and intensity.

        The order is that of the light's way: which spot, where the receiver sees it, how bright.
        """
        params = self.params.noise
        streams = noise.random_streams(rng)
        slopes = self.params.slopes
        reach_mm, surface = self._cast(scene, path)
        matrix = path.T_world_profile.rotation.as_matrix()
        optics = light.surface_optics(scene)
        if params.on("shadow"):
            apexes_mm = path.T_world_profile.apply(self.apex_mm)
            hidden = edges.shadowed(
                scene, matrix, apexes_mm, params.baseline_mm, reach_mm, slopes, surface
            )
            reach_mm[hidden], surface[hidden] = np.nan, -1
        cos_incidence = self._cos_incidence(scene, matrix, surface)
        exact_mm, on_ghost = reach_mm, None
        if params.on("mixed"):
            reach_mm = edges.mixed(
                reach_mm, surface, params.spot_pixels, params.mixed_step_mm, streams["mixed"]
            )
        if params.on("ghosts"):
            inclined = cos_incidence < np.cos(np.radians(params.ghost_incidence_deg))
            ghost_mm, on_ghost, source = edges.ghosts(
                exact_mm, slopes, surface, np.where(inclined, optics.gloss[surface], 0.0),
                ray_target(scene).normal, matrix, params.ghost_pixels, params.ghost_step_mm,
                streams["ghosts"],
            )  # fmt: skip
            reach_mm = np.where(on_ghost, ghost_mm, reach_mm)
            surface = source
            cos_incidence = self._cos_incidence(scene, matrix, surface)
        signal = light.returned_light(optics, surface, cos_incidence)
        if params.on("texture"):
            signal = light.textured(signal, optics, surface, streams["texture"])
        grain = noise.speckle_grain(signal.shape, params, streams)
        signal = signal * grain
        depth_mm = reach_mm - self.params.apex_depth_mm
        lost = ~self._in_range(depth_mm)
        if params.on("dropout"):
            lost |= noise.too_faint(signal, cos_incidence, params)
        measured_mm = depth_mm + noise.random_error_mm(
            depth_mm, cos_incidence, optics.noise[surface], optics.roughness_mm[surface], grain,
            params, streams,
        )  # fmt: skip
        if params.on("bulge"):
            incident = params.bulge == "incidence"
            tangent = np.sqrt(1.0 / cos_incidence**2 - 1.0) if incident else slopes
            measured_mm += noise.bulge_mm(depth_mm, tangent, self.params.edge_slope, params)
        if params.on("quantised"):
            measured_mm = noise.quantised_mm(measured_mm, slopes, params)
        measured_mm[lost], signal[lost] = np.nan, np.nan
        return measured_mm + self.params.apex_depth_mm, light.levels(signal)

    def _cast(self, scene: Scene, path: ViewPath) -> tuple[FloatArray, IntArray]:
        """Depth from the apex (profiles, pixels) in mm, NaN where nothing is met, and surface."""
        slopes = self.params.slopes
        fan = np.stack([np.zeros_like(slopes), slopes, np.ones_like(slopes)], axis=1)
        # A ray that advances one unit in depth is (0, slope, 1): distances come out as depths.
        directions = fan @ path.T_world_profile.rotation.as_matrix().transpose(0, 2, 1)
        apexes_mm = path.T_world_profile.apply(self.apex_mm)
        reach_m, surface = cast_fans(scene, apexes_mm / 1000.0, directions)
        return 1000.0 * reach_m, surface

    def _cos_incidence(self, scene: Scene, matrix: FloatArray, surface: IntArray) -> FloatArray:
        """Cosine between each beam and the surface's normal, (profiles, pixels), NaN for none.

        matrix: (profiles, 3, 3) rotations of the profiles.
        """
        slopes = self.params.slopes
        # Y and Z of every surface's normal in every profile's frame: few, beside the beams.
        normals = np.einsum("si,kij->ksj", ray_target(scene).normal, matrix[:, :, 1:])
        y, z = (np.take_along_axis(normals[:, :, i], surface, axis=1) for i in (0, 1))
        cosine: FloatArray = -(y * slopes + z) / np.sqrt(1.0 + slopes**2)
        return cosine

    def _in_range(self, depth_mm: FloatArray) -> BoolArray:
        """False for NaN and for depths that are not measured."""
        if not self.params.range_limits:
            return depth_mm > -self.params.apex_depth_mm
        return (depth_mm >= self.params.near_mm) & (depth_mm <= self.params.far_mm)

    def _points(self, reach_mm: FloatArray) -> FloatArray:
        """Points (profiles, pixels, 3) that far along each ray, each in its profile's frame."""
        points_mm = np.zeros((*reach_mm.shape, 3))
        points_mm[..., 1] = self.params.slopes * reach_mm
        points_mm[..., 2] = reach_mm - self.params.apex_depth_mm
        points_mm[np.isnan(reach_mm)] = np.nan
        return points_mm
