"""A picture of a scene, drawn with our own rays: no display and no graphics driver is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from scenes.materials import MATERIALS
from scenes.rays import cast_fans, ray_target
from scenes.scene import FloatArray, Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SKY = np.array([0.965, 0.970, 0.980])
INK = np.array([0.13, 0.14, 0.17])
# Told apart by colour-blind readers too, and dark enough on every material (after Okabe and Ito).
VIEW_COLOURS = ("#0072b2", "#d55e00", "#007a5a", "#8a3f78", "#7a6400", "#1d1d1d")


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; columns of `rotation` are right, down and forward in the world.

    half_width: tangent of half the horizontal field of view.
    """

    origin_m: FloatArray
    rotation: FloatArray
    half_width: float
    width_px: int
    height_px: int

    def pixels(self, points_m: FloatArray) -> FloatArray:
        """(n, 2) image coordinates of world points (n, 3); NaN behind the camera."""
        right, down, ahead = ((points_m - self.origin_m) @ self.rotation).T
        ahead = np.where(ahead > 1e-6, ahead, np.nan)
        scale = 0.5 * self.width_px / self.half_width
        middle = 0.5 * np.array([self.width_px - 1, self.height_px - 1])
        return np.stack([right / ahead, down / ahead], axis=1) * scale + middle


def save_picture(
    scene: Scene,
    path: Path,
    views: Mapping[str, Sequence[ArrayLike]] | None = None,
    yaw_deg: float = -20.0,
    pitch_deg: float = 42.0,
    size_px: tuple[int, int] = (1280, 860),
) -> None:
    """Write a PNG of the scene, shaded, with the viewing lines and fields of the given views.

    views: polylines (k, 3) in mm in the world for each view's name, the viewing line first (drawn
        as an arrow); a sensor's `outline(path)` makes them. Faint where the scene hides them.
    yaw_deg, pitch_deg: where the camera looks, 0 along the world's X, positive to the left and
        downwards; the whole scene and all views fit in.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import: only on use
    from matplotlib.figure import Figure

    outlines = {
        name: [np.asarray(line, dtype=float) / 1000.0 for line in lines]
        for name, lines in (views or {}).items()
    }
    points_m = [s.polygon_m for s in scene.surfaces]
    points_m += [line for lines in outlines.values() for line in lines]
    camera = camera_on(np.concatenate(points_m), yaw_deg, pitch_deg, size_px)
    figure = Figure(figsize=(size_px[0] / 100.0, size_px[1] / 100.0), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(_render(scene, camera), interpolation="none")
    for (name, lines), colour in zip(outlines.items(), _cycle(len(outlines)), strict=True):
        _draw_view(axes, scene, camera, name, lines, colour)
    axes.set_xlim(-0.5, size_px[0] - 0.5)
    axes.set_ylim(size_px[1] - 0.5, -0.5)
    axes.axis("off")
    figure.savefig(path, dpi=100, format="png")


def _cycle(count: int) -> list[str]:
    return [VIEW_COLOURS[i % len(VIEW_COLOURS)] for i in range(count)]


def camera_on(
    points_m: FloatArray,
    yaw_deg: float,
    pitch_deg: float,
    size_px: tuple[int, int],
    half_width: float = 0.32,
) -> Camera:
    """Place a camera as near as it can be with all points (n, 3) in the picture."""
    facing = Rotation.from_euler("ZY", [yaw_deg, pitch_deg], degrees=True).as_matrix()
    rotation = np.stack([-facing[:, 1], -facing[:, 2], facing[:, 0]], axis=1)
    half = half_width * np.array([1.0, size_px[1] / size_px[0]])
    seen = points_m @ rotation
    # A point at `side` of the axis is inside when side <= 0.94 half (distance + depth).
    slope = 0.94 * half
    low = (seen[:, :2] + slope * seen[:, 2:]).min(axis=0)
    high = (seen[:, :2] - slope * seen[:, 2:]).max(axis=0)
    back = ((high - low) / (2.0 * slope)).max()
    origin = np.array([*(0.5 * (low + high)), -back])
    return Camera(rotation @ origin, rotation, float(half[0]), *size_px)


def _render(scene: Scene, camera: Camera, samples: int = 2) -> NDArray[np.uint8]:
    """The shaded image (height, width, 3), each pixel the mean of samples x samples rays."""
    width, height = samples * camera.width_px, samples * camera.height_px
    half_height = camera.half_width * height / width
    right = camera.half_width * (2.0 * (np.arange(width) + 0.5) / width - 1.0)
    down = half_height * (2.0 * (np.arange(height) + 0.5) / height - 1.0)
    image = np.empty((height, width, 3))
    surface = np.empty((height, width), dtype=np.int64)
    band = 64  # rows at a time, so that memory stays small
    for first in range(0, height, band):
        rows = slice(first, min(first + band, height))
        local = np.stack(
            [*np.meshgrid(right, down[rows]), np.ones((rows.stop - first, width))], axis=2
        )
        rays = local.reshape(1, -1, 3) @ camera.rotation.T
        distance, met = cast_fans(scene, camera.origin_m[None], rays)
        points_m = camera.origin_m + distance[0, :, None] * rays[0]
        image[rows] = _shade(scene, camera, points_m, met[0]).reshape(-1, width, 3)
        surface[rows] = met[0].reshape(-1, width)
    return inked(image, surface, camera, samples)


def inked(
    image: FloatArray, part: NDArray[np.int64], camera: Camera, samples: int
) -> NDArray[np.uint8]:
    """A picture (height, width, 3) with lines where parts meet, from one samples times as large.

    image: colours from 0 to 1, which is drawn into. part: what is seen at each of its pixels.
    """
    edge = np.zeros(part.shape, dtype=bool)
    edge[1:] |= part[1:] != part[:-1]
    edge[:, 1:] |= part[:, 1:] != part[:, :-1]
    image[edge] = 0.35 * image[edge] + 0.65 * INK
    image = image.reshape(camera.height_px, samples, camera.width_px, samples, 3).mean(axis=(1, 3))
    pixels: NDArray[np.uint8] = np.rint(255.0 * image).astype(np.uint8)
    return pixels


def _shade(
    scene: Scene, camera: Camera, points_m: FloatArray, surface: NDArray[np.int64]
) -> FloatArray:
    """Colours (n, 3): a lamp that casts shadows, high at the camera's right, and a bright sky."""
    met = np.flatnonzero(surface >= 0)
    colour = np.repeat(SKY[None], len(surface), axis=0)
    if len(met) == 0:
        return colour
    palette = np.array([MATERIALS[s.material].rgb for s in scene.surfaces])
    lamp_m = camera.origin_m + camera.rotation @ [1.2, -1.4, 0.2]
    to_point = points_m[met] - lamp_m
    distance, lit = cast_fans(scene, lamp_m[None], to_point[None])
    bright = (lit[0] == surface[met]) | (distance[0] > 1.0 - 1e-4)
    normal = ray_target(scene).normal[surface[met]]
    facing = -np.einsum("ni,ni->n", normal, to_point) / np.linalg.norm(to_point, axis=1)
    light = 0.52 + 0.13 * normal[:, 2] + 0.48 * np.clip(facing, 0.0, 1.0) * bright
    colour[met] = np.clip(palette[surface[met]] * light[:, None], 0.0, 1.0)
    return colour


def _draw_view(
    axes: Axes, scene: Scene, camera: Camera, name: str, lines: list[FloatArray], colour: str
) -> None:
    for number, line in enumerate(lines):
        pixels, hidden = _projected(scene, camera, line)
        width = 2.6 if number == 0 else 1.2
        for mask, alpha in ((hidden, 0.25), (~hidden, 0.95)):
            drawn = np.where(mask[:, None], pixels, np.nan)
            axes.plot(*drawn.T, color=colour, lw=width, alpha=alpha, solid_capstyle="butt")
        if number:
            axes.fill(*camera.pixels(line).T, color=colour, alpha=0.05, lw=0)
    start, end = camera.pixels(lines[0][[0, -1]])
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.6})
    axes.plot(*start, "o", color=colour, ms=6)
    axes.annotate(
        name,
        end,
        (0, 7),
        textcoords="offset points",
        ha="center",
        va="bottom",
        color=colour,
        fontsize=13,
        fontweight="bold",
        bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.75},
    )


def points_along(line_m: FloatArray, samples: int) -> FloatArray:
    """(n, 3) points along a polyline (k, 3), so many to each of its parts, and its end."""
    shares = np.linspace(0.0, len(line_m) - 1.0, samples * (len(line_m) - 1) + 1)
    knots = np.arange(len(line_m))
    return np.stack([np.interp(shares, knots, axis) for axis in line_m.T], axis=1)


def _projected(
    scene: Scene, camera: Camera, line_m: FloatArray, samples: int = 120
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Points along a polyline in the image, and whether the scene hides each."""
    points_m = points_along(line_m, samples)
    rays = points_m - camera.origin_m
    distance, _ = cast_fans(scene, camera.origin_m[None], rays[None])
    return camera.pixels(points_m), distance[0] < 1.0 - 1e-6
