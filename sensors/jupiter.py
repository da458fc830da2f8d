"""The Jupiter laser range finder: one fan of rays a profile, from its published geometry."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from registration.scan import BoolArray, FloatArray, IntArray, Scan
from scenes.rays import cast_fans, ray_target
from scenes.scene import Scene
from sensors.noise import NoiseParams, measured_depth
from sensors.paths import ViewPath
from sensors.sensor import Hits


@dataclass(frozen=True)
class JupiterParams:
    """Geometry of the field (section 3.2.1 and figure 3.6) and the noise.

    pixels: points a profile, 256 or 512.
    near_mm, far_mm: depths of the near and the far plane, from the sensor's front.
    near_width_mm, far_width_mm: width of the field at these planes.
    range_limits: whether nothing is measured outside of the two planes.
    """

    pixels: Literal[256, 512] = 256
    near_mm: float = 170.0
    far_mm: float = 1175.0
    near_width_mm: float = 108.0
    far_width_mm: float = 579.0
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

    @property
    def edge_slope(self) -> float:
        """Y over depth from the apex along the outermost ray, the tangent of the half angle."""
        return 0.5 * (self.far_width_mm - self.near_width_mm) / (self.far_mm - self.near_mm)

    @property
    def apex_depth_mm(self) -> float:
        """How far behind the front the rays meet."""
        return 0.5 * self.near_width_mm / self.edge_slope - self.near_mm


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
        depth_mm, surface = self._cast(scene, path)
        T_view_profile = path.T_world_view.inv() * path.T_world_profile
        in_profile = self._points(depth_mm)
        points_mm = in_profile @ T_view_profile.rotation.as_matrix().transpose(0, 2, 1)
        points_mm += T_view_profile.translation[:, None, :]
        normal = path.T_world_view.rotation.inv().apply(ray_target(scene).normal)[surface]
        return Hits(points_mm, surface, normal)

    def scan(self, scene: Scene, path: ViewPath, rng: np.random.Generator) -> Scan:
        """Scan a view, with the noise of the parameters.

        The profiles are put together as the controller would: profile k at x = k step_mm, wherever
        the sensor really was.
        """
        params = self.params
        exact_mm, _ = self._cast(scene, path)
        depth_mm = measured_depth(exact_mm, (params.near_mm, params.far_mm), params.noise, rng)
        points_mm = self._points(depth_mm)
        points_mm[..., 0] += path.step_mm * np.arange(path.profiles)[:, None]
        return Scan.from_points(points_mm, path.step_mm, apex_mm=self.apex_mm)

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

    def _cast(self, scene: Scene, path: ViewPath) -> tuple[FloatArray, IntArray]:
        """Depth in mm (profiles, pixels), NaN where nothing returns, and the surface."""
        params = self.params
        slopes = lateral_slopes(params)
        fan = np.stack([np.zeros_like(slopes), slopes, np.ones_like(slopes)], axis=1)
        # A ray that advances one unit in depth is (0, slope, 1): distances come out as depths.
        directions = fan @ path.T_world_profile.rotation.as_matrix().transpose(0, 2, 1)
        apexes_mm = path.T_world_profile.apply(self.apex_mm)
        depth_m, surface = cast_fans(scene, apexes_mm / 1000.0, directions)
        depth_mm = 1000.0 * depth_m - params.apex_depth_mm
        outside = ~self._in_range(depth_mm)
        depth_mm[outside], surface[outside] = np.nan, -1
        return depth_mm, surface

    def _in_range(self, depth_mm: FloatArray) -> BoolArray:
        """False for NaN and for depths that are not measured."""
        if not self.params.range_limits:
            return depth_mm > -self.params.apex_depth_mm
        return (depth_mm >= self.params.near_mm) & (depth_mm <= self.params.far_mm)

    def _points(self, depth_mm: FloatArray) -> FloatArray:
        """Points (profiles, pixels, 3) at the given depths, each in its own profile's frame."""
        points_mm = np.zeros((*depth_mm.shape, 3))
        points_mm[..., 1] = lateral_slopes(self.params) * (depth_mm + self.params.apex_depth_mm)
        points_mm[..., 2] = depth_mm
        points_mm[np.isnan(depth_mm)] = np.nan
        return points_mm


def lateral_slopes(params: JupiterParams) -> FloatArray:
    """(pixels,) Y over depth from the apex along each ray, evenly spaced across the field.

    The real spacing widens towards the edges (section 3.2.3.1); this function is its place.
    """
    slopes: FloatArray = np.linspace(-params.edge_slope, params.edge_slope, params.pixels)
    return slopes
