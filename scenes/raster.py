"""Draws convex polygons with a depth buffer: pictures in a moment, without a graphics driver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.picture import SKY, Camera, inked
from scenes.scene import FloatArray, IntArray

SAMPLES = 2  # along each side of a pixel
NEAR_M = 0.01  # what is nearer to the camera is not drawn
LIGHT = np.array([-0.45, 0.35, 0.82])  # where the lamp stands, far away, in the world


@dataclass(frozen=True)
class Polygons:
    """Flat convex faces in world coordinates.

    corners_m: (k, 3) of each, counter-clockwise seen from outside; the rear is not drawn.
    rgb: (n, 3) from 0 to 1.
    body: (n,) faces of one number meet without a line between them.
    """

    corners_m: tuple[FloatArray, ...]
    rgb: FloatArray
    body: IntArray


@dataclass(frozen=True)
class Shot:
    """A picture and how deep it is.

    image: (height, width, 3).
    depth_m: (height, width) along the optical axis of the nearest face in each pixel, inf for none.
    """

    image: NDArray[np.uint8]
    depth_m: FloatArray


def joined(parts: Sequence[Polygons]) -> Polygons:
    """Several sets of polygons as one, their bodies kept apart."""
    first = np.cumsum([0, *(int(part.body.max(initial=-1)) + 1 for part in parts)])
    return Polygons(
        tuple(corners_m for part in parts for corners_m in part.corners_m),
        np.concatenate([part.rgb for part in parts]),
        np.concatenate([part.body + start for part, start in zip(parts, first, strict=False)]),
    )


def draw(polygons: Polygons, camera: Camera) -> Shot:
    """Draw the faces as the camera sees them, shaded, with a line where two bodies meet.

    What is out of the picture or behind the camera is cut off.
    """
    width, height = SAMPLES * camera.width_px, SAMPLES * camera.height_px
    depth = np.full((height, width), np.inf)
    face = np.full((height, width), -1)
    scale = 0.5 * width / camera.half_width
    middle = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
    normals = np.array([_normal(corners_m) for corners_m in polygons.corners_m])
    for index, corners_m in enumerate(polygons.corners_m):
        local = (corners_m - camera.origin_m) @ camera.rotation
        normal = normals[index] @ camera.rotation
        offset_m = normal @ local[0]
        local = _in_front(local)
        if offset_m >= 0.0 or len(local) < 3:  # seen from behind, or not at all
            continue
        corners = local[:, :2] / local[:, 2:] * scale + middle
        low = np.maximum(np.ceil(corners.min(axis=0)), 0).astype(int)
        high = np.minimum(np.floor(corners.max(axis=0)), [width - 1, height - 1]).astype(int) + 1
        if (high <= low).any():
            continue
        x, y = np.arange(low[0], high[0]), np.arange(low[1], high[1])[:, None]
        inside = np.ones((len(y), len(x)), dtype=bool)
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along = end - start
            # Outside looks counter-clockwise, and Y of an image points down.
            inside &= along[0] * (y - start[1]) - along[1] * (x - start[0]) <= 0.0
        slope = normal[0] * (x - middle[0]) / scale + normal[1] * (y - middle[1]) / scale
        with np.errstate(divide="ignore"):
            here = offset_m / (slope + normal[2])
        window = np.s_[low[1] : high[1], low[0] : high[0]]
        nearer = inside & (here > 0.0) & (here < depth[window])
        depth[window][nearer] = here[nearer]
        face[window][nearer] = index
    light = 0.62 + 0.38 * np.clip(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    palette = np.concatenate([np.clip(polygons.rgb * light[:, None], 0.0, 1.0), SKY[None]])
    body = np.append(polygons.body, -1)[face]
    blocks = (camera.height_px, SAMPLES, camera.width_px, SAMPLES)
    pixels = inked(palette[face], body, camera, SAMPLES)
    return Shot(pixels, depth.reshape(blocks).min(axis=(1, 3)))


def _in_front(corners_m: FloatArray) -> FloatArray:
    """The part of a convex face, in the camera's frame, that lies in front of it."""
    depth_m = corners_m[:, 2] - NEAR_M
    if (depth_m >= 0.0).all():
        return corners_m
    kept: list[FloatArray] = []
    for i, here in enumerate(depth_m):
        if here >= 0.0:
            kept.append(corners_m[i])
        j = (i + 1) % len(depth_m)
        if here * depth_m[j] < 0.0:
            share = here / (here - depth_m[j])
            kept.append(corners_m[i] + share * (corners_m[j] - corners_m[i]))
    return np.array(kept).reshape(-1, 3)


def _normal(corners_m: FloatArray) -> FloatArray:
    about = corners_m - corners_m.mean(axis=0)
    area: FloatArray = np.cross(about, np.roll(about, -1, axis=0)).sum(axis=0)
    return area / np.linalg.norm(area)
