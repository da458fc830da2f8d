import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from registration.scan import Scan
from scenes import SCENES
from scenes.flat_target import FlatTargetParams, flat_target
from scenes.scene import Scene, moved
from scenes.solids import assemble, box
from sensors import SENSORS
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import NoiseParams
from sensors.paths import ViewPath, aimed_view, straight_line
from sensors.sensor import Hits

EXACT = Jupiter(JupiterParams(noise=NoiseParams.exact()))
NOISY = Jupiter()
BOARD = flat_target(FlatTargetParams())


def _scene(name: str) -> Scene:
    builder, params_type = SCENES[name]
    return builder(params_type())


def _path(profiles: int = 20, step_mm: float = 15.0, pitch_deg: float = 25.0) -> ViewPath:
    aim_mm = [0.0, 0.0, 100.0]
    view = aimed_view(aim_mm, 900.0, 0.1, np.radians(pitch_deg), 0.05, profiles, step_mm)
    return straight_line(view, profiles, step_mm)


def _facing_board(distance_mm: float) -> ViewPath:
    view = aimed_view([0.0, 0.0, 0.0], distance_mm, 0.0, 0.0, 0.0, 3, 5.0)
    return straight_line(view, 3, 5.0)


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("scene_name", SCENES)
def test_every_sensor_scans_every_scene(name: str, scene_name: str) -> None:
    factory, params_type, _ = SENSORS[name]
    scan = factory(params_type()).scan(_scene(scene_name), _path(), np.random.default_rng(0))
    assert isinstance(scan, Scan)
    assert scan.points_mm.shape[0] == 20
    assert scan.step_mm == 15.0
    assert scan.n_valid > 0.1 * scan.valid.size


@pytest.mark.parametrize("name", SCENES)
def test_hits_lie_on_their_surfaces_and_see_them_from_outside(name: str) -> None:
    scene, path = _scene(name), _path()
    hits = EXACT.hits(scene, path)
    assert (hits.surface == -1).tolist() == np.isnan(hits.points_mm[..., 0]).tolist()
    world_mm = path.T_world_view.apply(hits.points_mm[hits.valid])
    met = hits.surface[hits.valid]
    normal = np.array([s.normal for s in scene.surfaces])[met]
    corner_mm = 1000.0 * np.array([s.polygon_m[0] for s in scene.surfaces])[met]
    assert np.abs(np.einsum("ni,ni->n", world_mm - corner_mm, normal)).max() < 1e-6
    assert path.T_world_view.rotation.apply(hits.normal[hits.valid]) == pytest.approx(normal)
    profile_mm = np.zeros((path.profiles, 1, 3))
    profile_mm[:, 0, 0] = path.step_mm * np.arange(path.profiles)
    beams = (hits.points_mm - profile_mm - EXACT.apex_mm)[hits.valid]
    assert (np.einsum("ni,ni->n", beams, hits.normal[hits.valid]) < 0.0).all()


def test_points_lie_on_their_beams_in_profiles_a_step_apart() -> None:
    path = _path()
    for points_mm in (
        EXACT.hits(_scene("desk"), path).points_mm,
        EXACT.scan(_scene("desk"), path, np.random.default_rng(0)).points_mm,
        NOISY.scan(_scene("desk"), path, np.random.default_rng(0)).points_mm,
    ):
        x_mm, y_mm, z_mm = np.moveaxis(points_mm, 2, 0)
        valid = np.isfinite(z_mm)
        expected = np.broadcast_to(15.0 * np.arange(20)[:, None], x_mm.shape)
        assert x_mm[valid] == pytest.approx(expected[valid], abs=1e-9)
        slopes = y_mm / (z_mm + NOISY.params.apex_depth_mm)
        beam = np.broadcast_to(NOISY.params.slopes, slopes.shape)
        assert slopes[valid] == pytest.approx(beam[valid], abs=1e-12)


def test_the_field_has_its_published_size() -> None:
    params = JupiterParams()
    assert params.apex_depth_mm == pytest.approx(60.4, abs=0.05)
    assert np.degrees(np.arctan(params.edge_slope)) == pytest.approx(13.19, abs=0.005)
    unlimited = Jupiter(JupiterParams(range_limits=False))  # the limits themselves round off
    for depth_mm, width_mm in ((170.0, 108.0), (1175.0, 579.0)):
        hits = unlimited.hits(BOARD, _facing_board(depth_mm))
        assert hits.points_mm[..., 2] == pytest.approx(depth_mm, abs=1e-9)
        assert np.ptp(hits.points_mm[0, :, 1]) == pytest.approx(width_mm, abs=1e-9)


def test_nothing_returns_from_outside_the_range_unless_limits_are_off() -> None:
    unlimited = Jupiter(JupiterParams(range_limits=False))
    for distance_mm in (169.9, 1175.1):
        path = _facing_board(distance_mm)
        assert not EXACT.hits(BOARD, path).valid.any()
        assert unlimited.hits(BOARD, path).valid.all()
        assert NOISY.scan(BOARD, path, np.random.default_rng(0)).n_valid == 0


def test_what_stands_too_near_hides_what_is_behind_it() -> None:
    post = box("post", [0.02, 0.04, 0.4], [-0.75, 0.0, -0.2])
    wall = box("wall", [0.02, 1.0, 1.0], [0.0, 0.0, -0.5])
    hits = EXACT.hits(assemble("hidden", [post, wall]), _facing_board(850.0))
    blocked = ~hits.valid[0]
    inner = np.abs(EXACT.params.slopes) < 20.0 / (90.0 + EXACT.params.apex_depth_mm)
    np.testing.assert_array_equal(blocked, inner)


def test_without_noise_a_scan_is_the_hits() -> None:
    scene, path = _scene("desk"), _path()
    hits, scan = EXACT.hits(scene, path), EXACT.scan(scene, path, np.random.default_rng(0))
    assert scan.points_mm == pytest.approx(hits.points_mm, abs=1e-9, nan_ok=True)
    assert scan.apex_mm is None  # a real sensor's files do not tell where its beams meet


@pytest.mark.parametrize("name", SCENES)
def test_no_effect_measures_where_nothing_returns(name: str) -> None:
    scene, path = _scene(name), _path()
    hits, scan = EXACT.hits(scene, path), NOISY.scan(scene, path, np.random.default_rng(0))
    assert not (scan.valid & ~hits.valid).any()
    assert 0.7 * hits.valid.sum() < scan.n_valid <= hits.valid.sum()
    assert scan.intensity is not None
    assert ((scan.intensity > 0) == scan.valid).all()


def test_the_same_generator_state_gives_the_same_scan() -> None:
    scene, path = _scene("desk"), _path()
    first, same, other = (
        NOISY.scan(scene, path, np.random.default_rng(seed)).points_mm for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, same)
    assert not np.array_equal(first, other, equal_nan=True)


@pytest.mark.parametrize("name", ["desk", "clutter", "separated_planes"])
def test_moving_the_whole_world_changes_no_scan(name: str) -> None:
    scene, path = _scene(name), _path()
    rng = np.random.default_rng(9)
    T_world = RigidTransform.from_components(
        rng.uniform(-2000.0, 2000.0, 3), Rotation.random(rng=rng)
    )
    moved_path = ViewPath(T_world * path.T_world_profile, path.step_mm)
    hits, again = EXACT.hits(scene, path), EXACT.hits(moved(scene, T_world), moved_path)
    np.testing.assert_array_equal(again.surface, hits.surface)
    assert again.points_mm == pytest.approx(hits.points_mm, abs=1e-6, nan_ok=True)
    assert again.normal == pytest.approx(hits.normal, abs=1e-9, nan_ok=True)


def test_a_crooked_path_shows_in_the_hits_but_not_in_the_x_of_the_scan() -> None:
    path = _path()
    shake_mm = np.random.default_rng(3).normal(0.0, 0.5, (path.profiles, 3))
    shake_mm[0] = 0.0
    crooked = ViewPath(path.T_world_profile * RigidTransform.from_translation(shake_mm), 15.0)
    hits: Hits = EXACT.hits(BOARD, crooked)
    scan = EXACT.scan(BOARD, crooked, np.random.default_rng(0))
    x_mm = 15.0 * np.arange(20)[:, None]
    expected = np.broadcast_to(x_mm + shake_mm[:, :1], hits.valid.shape)
    assert hits.points_mm[..., 0][hits.valid] == pytest.approx(expected[hits.valid], abs=1e-9)
    assert (scan.points_mm[..., 0] - x_mm)[scan.valid] == pytest.approx(0.0, abs=1e-9)
    assert scan.points_mm[..., 2] + shake_mm[:, 2:] == pytest.approx(
        hits.points_mm[..., 2], abs=1e-9, nan_ok=True
    )


def test_512_pixels_cover_the_same_field() -> None:
    fine = Jupiter(JupiterParams(pixels=512))
    hits = fine.hits(BOARD, _facing_board(800.0))
    assert hits.points_mm.shape == (3, 512, 3)
    coarse = EXACT.hits(BOARD, _facing_board(800.0))
    assert hits.points_mm[:, [0, -1]] == pytest.approx(coarse.points_mm[:, [0, -1]], abs=1e-9)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"pixels": 300}, "pixels is 300; the sensor measures 256 or 512"),
        ({"near_mm": 1200.0}, "expected depths above 0 mm, the far one larger"),
        ({"near_width_mm": -1.0}, "expected widths above 0 mm, the far one larger"),
        ({"widening": -0.1}, "widening is -0.1; expected 0 to 10"),
    ],
)
def test_an_impossible_sensor_is_refused(wrong: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        JupiterParams(**wrong)
