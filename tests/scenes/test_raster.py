"""The depth buffer against the rays: both see the same faces at the same depth."""

from __future__ import annotations

import numpy as np
import pytest

from scenes import SCENES
from scenes.picture import SKY, camera_on
from scenes.raster import Polygons, draw, joined
from scenes.rays import cast_fans
from sensors.arm_picture import scene_faces


@pytest.mark.parametrize("name", ["desk", "foam_chair", "clutter"])
def test_depths_are_those_of_the_rays(name: str) -> None:
    scene = SCENES[name].builder(SCENES[name].params_type())
    faces = scene_faces(scene)
    camera = camera_on(np.concatenate(faces.corners_m), -25.0, 35.0, (80, 60))
    shot = draw(faces, camera)
    row, column = np.mgrid[0:120, 0:160]  # two samples along each side of a pixel
    scale = 0.5 * 160 / camera.half_width
    local = np.stack([(column - 79.5) / scale, (row - 59.5) / scale, np.ones((120, 160))], axis=2)
    rays = (local.reshape(-1, 3) @ camera.rotation.T)[None]
    reach_m, met = cast_fans(scene, camera.origin_m[None], rays)
    depth_m = np.where(met[0] >= 0, reach_m[0], np.inf).reshape(60, 2, 80, 2).min(axis=(1, 3))
    assert 0.2 < np.isfinite(depth_m).mean() < 1.0
    # A ray along an edge may meet either of its faces, or pass by.
    assert np.isclose(shot.depth_m, depth_m, rtol=0.0, atol=1e-9).mean() > 0.99


def square(depth_m: float, half_m: float, rgb: tuple[float, float, float]) -> Polygons:
    """A square that faces a viewer who looks along the world's X."""
    corners = [(-1, -1), (-1, 1), (1, 1), (1, -1)]
    points = np.array([(depth_m, half_m * y, half_m * z) for y, z in corners])
    return Polygons((points,), np.array([rgb]), np.array([0]))


def test_the_nearer_face_hides_the_farther_and_rears_are_not_drawn() -> None:
    far, near = square(1.0, 1.0, (1.0, 0.0, 0.0)), square(0.0, 0.4, (0.0, 0.0, 1.0))
    both = joined([near, far])
    camera = camera_on(np.concatenate(both.corners_m), 0.0, 0.0, (100, 100))
    shot = draw(both, camera)
    middle, side = shot.image[50, 50].astype(int), shot.image[50, 12].astype(int)
    assert middle[2] > 100 > middle[0]
    assert side[0] > 100 > side[2]
    assert shot.depth_m[50, 50] < shot.depth_m[50, 12] < np.inf
    from_behind = camera_on(np.concatenate(both.corners_m), 180.0, 0.0, (100, 100))
    empty = draw(both, from_behind)
    np.testing.assert_array_equal(np.unique(empty.image), np.unique(np.rint(255 * SKY)))
    assert np.isinf(empty.depth_m).all()


def test_what_is_behind_the_camera_is_cut_off() -> None:
    floor = Polygons(
        (np.array([(-50.0, -50, -1), (50, -50, -1), (50, 50, -1), (-50, 50, -1)]),),
        np.array([(0.5, 0.5, 0.5)]),
        np.array([0]),
    )
    camera = camera_on(np.array([[-1.0, 0, 0], [1, 0, 0]]), 0.0, 0.0, (60, 60), half_width=1.0)
    shot = draw(floor, camera)
    seen = np.isfinite(shot.depth_m)
    assert seen[40:].all()
    assert not seen[:25].any()
    assert shot.depth_m[seen].min() > 0.0
