"""What happens beside depth steps, compared with rays cast the plain way and with geometry."""

import numpy as np
import pytest

from registration.scan import BoolArray
from scenes import SCENES
from scenes.rays import cast_rays
from scenes.scene import Scene
from scenes.solids import assemble, box, plate, turned
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import NoiseParams
from sensors.paths import ViewPath, aimed_view, straight_line

EXACT = Jupiter(JupiterParams(noise=NoiseParams.exact()))
SLOPES = JupiterParams().slopes
APEX_MM = JupiterParams().apex_depth_mm


def _path(distance_mm: float = 900.0, profiles: int = 20, pitch_deg: float = 0.0) -> ViewPath:
    aim_mm = [0.0, 0.0, 100.0 if pitch_deg else 0.0]
    view = aimed_view(aim_mm, distance_mm, 0.1, np.radians(pitch_deg), 0.0, profiles, 12.0)
    return straight_line(view, profiles, 12.0)


def _facing(profiles: int = 20) -> ViewPath:
    return straight_line(aimed_view([0.0] * 3, 900.0, 0.0, 0.0, 0.0, profiles, 2.0), profiles, 2.0)


def _post_before_wall(wall: str = "white_paper", yaw_deg: float = 0.0) -> Scene:
    """A post 300 mm before a wall, its sides at the sensor's Y = -40 and 40 mm."""
    post = box("post", [0.01, 0.08, 3.0], [-0.3, 0.0, -1.5])
    return assemble("post", [post, plate("wall", (2.0, 3.0), [0.0] * 3, turned(yaw_deg), wall)])


def _hidden_by_every_ray(scene: Scene, path: ViewPath, baseline_mm: float) -> BoolArray:
    """Shadows with a ray from the receiver to each and every point."""
    hits = EXACT.hits(scene, path)
    points_mm = path.T_world_view.apply(hits.points_mm[hits.valid])
    profile = np.nonzero(hits.valid)[0]
    receivers_mm = path.T_world_profile.apply([0.0, baseline_mm, -APEX_MM])
    rays_mm = points_mm - receivers_mm[profile]
    distance, met = cast_rays(scene, receivers_mm / 1000.0, rays_mm / 1000.0, profile)
    hidden = np.zeros(hits.valid.shape, bool)
    hidden[hits.valid] = (met != hits.surface[hits.valid]) & (np.abs(distance - 1.0) > 1e-9)
    return hidden


@pytest.mark.parametrize("baseline_mm", [120.0, -200.0])
@pytest.mark.parametrize("name", SCENES)
def test_shadows_are_those_that_rays_to_every_point_find(name: str, baseline_mm: float) -> None:
    builder, params_type = SCENES[name]
    scene, path = builder(params_type()), _path(pitch_deg=25.0)
    sensor = Jupiter(JupiterParams(noise=NoiseParams.only("shadow", baseline_mm=baseline_mm)))
    scan = sensor.scan(scene, path, np.random.default_rng(0))
    expected = _hidden_by_every_ray(scene, path, baseline_mm)
    np.testing.assert_array_equal(EXACT.hits(scene, path).valid & ~scan.valid, expected)
    if name == "desk":
        assert 0.01 < expected.mean() < 0.2


@pytest.mark.parametrize("baseline_mm", [120.0, -120.0])
def test_a_post_throws_a_shadow_as_wide_as_geometry_says(baseline_mm: float) -> None:
    sensor = Jupiter(JupiterParams(noise=NoiseParams.only("shadow", baseline_mm=baseline_mm)))
    scene, path = _post_before_wall(), _facing()
    lost = EXACT.hits(scene, path).valid & ~sensor.scan(scene, path, np.random.default_rng(0)).valid
    y_mm = EXACT.hits(scene, path).points_mm[..., 1][lost]
    # From the receiver at b past the post's edge e, reach 660.4, to the wall at 960.4.
    near, far = 600.0 + APEX_MM, 900.0 + APEX_MM
    side = -np.sign(baseline_mm)  # the shadow falls away from the receiver
    ends_mm = np.array([40.0 * far / near, 40.0 + (40.0 + 120.0) * (far - near) / near])
    spacing_mm = 3.0
    assert (side * y_mm).min() == pytest.approx(ends_mm[0], abs=spacing_mm)
    assert (side * y_mm).max() == pytest.approx(ends_mm[1], abs=spacing_mm)


def test_without_base_line_there_is_no_shadow() -> None:
    sensor = Jupiter(JupiterParams(noise=NoiseParams.only("shadow", baseline_mm=0.0)))
    scan = sensor.scan(_post_before_wall(), _facing(), np.random.default_rng(0))
    assert scan.valid.all()


def test_ghosts_lie_on_the_glossy_inclined_surface_beyond_its_edge() -> None:
    noise = NoiseParams.only("ghosts", ghost_pixels=5)
    scene, path = _post_before_wall("specular_plastic", yaw_deg=30.0), _facing(100)
    hits = EXACT.hits(scene, path)
    scan = Jupiter(JupiterParams(noise=noise)).scan(scene, path, np.random.default_rng(0))
    moved = np.abs(scan.points_mm - hits.points_mm)[..., 2] > 1e-9
    on_post = np.array([s.name.startswith("post") for s in scene.surfaces])[hits.surface]
    assert moved.any()
    assert on_post[moved].all()
    # They are on the wall's plane, though the post stands before it: they overlap along Y.
    wall = hits.normal[~on_post][0]
    offset_mm = hits.points_mm[~on_post][0] @ wall
    assert scan.points_mm[moved] @ wall == pytest.approx(offset_mm, abs=1e-6)
    y_mm = scan.points_mm[..., 1]
    assert (np.diff(y_mm, axis=1) < 0.0).any(axis=1).mean() > 0.5
    # At most that many beams on each side, and as often as the wall is glossy.
    edges = [np.flatnonzero(row)[[0, -1]] for row in on_post]
    beside = np.zeros_like(moved)
    for row, (first, last) in zip(beside, edges, strict=True):
        row[first : first + 5] = row[last - 4 : last + 1] = True
    assert not (moved & ~beside).any()
    assert moved[beside].mean() == pytest.approx(0.7, abs=4.0 * np.sqrt(0.21 / beside.sum()))


@pytest.mark.parametrize(
    ("material", "yaw_deg", "noise"),
    [
        ("rough_foam", 30.0, NoiseParams.only("ghosts")),  # no gloss
        ("specular_plastic", 0.0, NoiseParams.only("ghosts")),  # not inclined
        ("specular_plastic", 30.0, NoiseParams.only("ghosts", ghost_step_mm=500.0)),
        ("specular_plastic", 30.0, NoiseParams.only("ghosts", ghost_pixels=0)),
    ],
)
def test_without_gloss_inclination_or_step_there_are_no_ghosts(
    material: str, yaw_deg: float, noise: NoiseParams
) -> None:
    scene, path = _post_before_wall(material, yaw_deg), _facing()
    scan = Jupiter(JupiterParams(noise=noise)).scan(scene, path, np.random.default_rng(0))
    assert scan.points_mm == pytest.approx(EXACT.hits(scene, path).points_mm, abs=1e-9)


@pytest.mark.parametrize("spot_pixels", [0.1, 0.3, 0.5])
def test_mixed_points_lie_between_both_sides_of_an_edge(spot_pixels: float) -> None:
    noise = NoiseParams.only("mixed", spot_pixels=spot_pixels, mixed_step_mm=400.0)
    scene, path = _post_before_wall(), _facing(300)
    hits = EXACT.hits(scene, path)
    scan = Jupiter(JupiterParams(noise=noise)).scan(scene, path, np.random.default_rng(0))
    shift_mm = (scan.points_mm - hits.points_mm)[..., 2]
    gaps = np.diff(hits.surface, axis=1) != 0
    beside = np.zeros(hits.valid.shape, bool)
    beside[:, 1:] |= gaps
    beside[:, :-1] |= gaps
    assert (np.abs(shift_mm[~beside]) < 1e-9).all()
    assert np.abs(shift_mm).max() < 0.51 * 300.0  # the side of the post makes the step a bit larger
    # The spot of a beam on either side of the gap is cut when the edge is that near.
    share = (np.abs(shift_mm[beside]) > 1e-9).sum() / gaps.sum()
    assert share == pytest.approx(2.0 * spot_pixels, abs=4.0 * 0.5 / np.sqrt(gaps.sum()))
    assert np.abs(shift_mm[np.abs(shift_mm) > 1e-9]).mean() == pytest.approx(75.0, rel=0.15)


def test_steps_larger_than_the_image_blends_stay_sharp() -> None:
    noise = NoiseParams.only("mixed", mixed_step_mm=200.0)
    scene, path = _post_before_wall(), _facing()
    scan = Jupiter(JupiterParams(noise=noise)).scan(scene, path, np.random.default_rng(0))
    assert scan.points_mm == pytest.approx(EXACT.hits(scene, path).points_mm, abs=1e-9)
