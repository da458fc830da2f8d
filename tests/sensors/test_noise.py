"""Each effect switched on alone does what its parameters say, measured on the scans themselves."""

import numpy as np
import pytest
from scipy.stats import kurtosis, norm

from registration.scan import FloatArray, Scan
from scenes.materials import MATERIALS
from scenes.scene import Scene
from scenes.solids import assemble, plate, turned
from sensors.calibration import FAR_MM, NEAR_MM
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import SWITCHES, NoiseParams, quantised_mm, square_law
from sensors.paths import ViewPath, aimed_view, straight_line

PROFILES = 60


def _sensor(noise: NoiseParams, range_limits: bool = False) -> Jupiter:
    return Jupiter(JupiterParams(noise=noise, range_limits=range_limits))


EXACT = _sensor(NoiseParams.exact())
SLOPES = JupiterParams().slopes
EDGE = JupiterParams().edge_slope
MIDDLE = slice(96, 160)


def _board(material: str = "white_paper", pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> Scene:
    board = plate("board", (3.0, 3.0), [0.0] * 3, turned(yaw_deg, pitch_deg), material)
    return assemble("board", [board])


def _path(distance_mm: float, profiles: int = PROFILES) -> ViewPath:
    view = aimed_view([0.0, 0.0, 0.0], distance_mm, 0.0, 0.0, 0.0, profiles, 2.0)
    return straight_line(view, profiles, 2.0)


def _scan(noise: NoiseParams, distance_mm: float, scene: Scene, seed: int = 0) -> Scan:
    return _sensor(noise).scan(scene, _path(distance_mm), np.random.default_rng(seed))


def _errors_mm(noise: NoiseParams, distance_mm: float, scene: Scene | None = None) -> FloatArray:
    scene = _board() if scene is None else scene
    measured, exact = (_scan(n, distance_mm, scene) for n in (noise, NoiseParams.exact()))
    return (measured.points_mm - exact.points_mm)[..., 2]


def _spread(errors_mm: FloatArray) -> tuple[float, float]:
    """Standard deviation and four times its standard error, both for Gaussian values."""
    deviation = float(np.nanstd(errors_mm))
    return deviation, 4.0 * deviation / np.sqrt(2.0 * np.isfinite(errors_mm).sum())


def test_switched_off_or_without_effects_everything_is_exact() -> None:
    none = NoiseParams.only("gaussian", gaussian=False)
    assert (_errors_mm(none, 700.0) == 0.0).all()
    assert not any(none.on(effect) or NoiseParams.exact().on(effect) for effect in SWITCHES)
    assert all(NoiseParams().on(effect) for effect in SWITCHES)


@pytest.mark.parametrize(("depth_mm", "published_mm"), [(NEAR_MM, 2.0), (FAR_MM, 8.0)])
@pytest.mark.parametrize("form", ["incidence", "lateral"])
def test_a_flat_target_bulges_by_the_published_size(
    depth_mm: float, published_mm: float, form: str
) -> None:
    errors_mm = _errors_mm(NoiseParams.only("bulge", bulge=form), depth_mm)[0]
    assert errors_mm[[0, -1]].mean() - errors_mm[127:129].mean() == pytest.approx(
        published_mm, rel=1e-3
    )
    assert (np.diff(errors_mm[:128]) < 0.0).all()  # towards the sensor, most in the middle
    away = NoiseParams.only("bulge", bulge=form, bulge_towards_sensor=False)
    assert _errors_mm(away, depth_mm)[0] == pytest.approx(-errors_mm, abs=1e-9)
    mirrored = (errors_mm + errors_mm[::-1]) / 2.0
    assert errors_mm == pytest.approx(mirrored, abs=1e-9)


def test_only_a_tilted_target_tells_the_two_forms_of_the_bulge_apart() -> None:
    incidence, lateral = (NoiseParams.only("bulge", bulge=f) for f in ("incidence", "lateral"))
    assert _errors_mm(incidence, 900.0) == pytest.approx(_errors_mm(lateral, 900.0), abs=1e-9)
    tilted = _board(yaw_deg=20.0)
    assert np.abs(_errors_mm(incidence, 900.0, tilted)[:, 127:129]).max() < 0.1
    assert _errors_mm(lateral, 900.0, tilted)[:, 127:129].max() < -4.0
    # Tilted about Y it is met nowhere head-on.
    pitched = _board(pitch_deg=30.0)
    assert np.abs(_errors_mm(incidence, 900.0, pitched)).max() < 0.01
    assert _errors_mm(lateral, 900.0, pitched)[:, 127:129].max() < -4.0


@pytest.mark.parametrize(("depth_mm", "sigma_mm"), [(NEAR_MM, 0.3), (FAR_MM, 1.5)])
def test_the_random_error_has_the_spread_asked_for(depth_mm: float, sigma_mm: float) -> None:
    errors_mm = _errors_mm(NoiseParams.only("gaussian", sigma_incidence=0.0), depth_mm)
    deviation, tolerance = _spread(errors_mm)
    assert deviation == pytest.approx(sigma_mm, abs=tolerance)
    assert abs(errors_mm.mean()) < 4.0 * sigma_mm / np.sqrt(errors_mm.size)
    assert abs(kurtosis(errors_mm, axis=None)) < 4.0 * np.sqrt(24.0 / errors_mm.size)


def test_the_random_error_grows_with_incidence_and_by_material() -> None:
    noise = NoiseParams.only("gaussian", sigma_incidence=1.0)
    law = square_law(noise.sigma_near_mm, noise.sigma_far_mm)
    for pitch_deg, material in ((0.0, "rough_foam"), (60.0, "white_paper"), (60.0, "metal")):
        scene = _board(material, pitch_deg)
        depth_mm = _scan(NoiseParams.exact(), 700.0, scene).points_mm[..., 2]
        scaled = _errors_mm(noise, 700.0, scene) / law.at(depth_mm)
        cosine = np.cos(np.radians(pitch_deg)) / np.sqrt(1.0 + SLOPES**2)
        deviation, tolerance = _spread(scaled * cosine)
        assert deviation == pytest.approx(MATERIALS[material].noise, abs=tolerance)


def test_speckle_errors_are_larger_where_the_spot_is_fainter() -> None:
    noise = NoiseParams.only("speckle", speckle_contrast=0.4)
    scene = _board("matt_plastic")
    errors_mm, scan = _errors_mm(noise, FAR_MM, scene), _scan(noise, FAR_MM, scene)
    # The mean of 1 / brightness over a gamma distribution of shape k = 1 / contrast^2.
    k = 1.0 / 0.4**2
    assert errors_mm.std() == pytest.approx(0.3 * np.sqrt(k / (k - 1.0)), rel=0.04)
    assert kurtosis(errors_mm, axis=None) > 0.5
    assert scan.intensity is not None
    faint = scan.intensity < np.median(scan.intensity)
    assert errors_mm[faint].std() > 1.2 * errors_mm[~faint].std()


def test_speckle_shows_in_the_intensity_with_its_contrast() -> None:
    scan = _scan(NoiseParams.only("speckle", speckle_contrast=0.2), 700.0, _board("fabric"))
    assert scan.intensity is not None
    middle = scan.intensity[:, MIDDLE]
    assert middle.std() / middle.mean() == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("material", ["rough_foam", "white_paper", "specular_plastic"])
def test_texture_is_as_rough_as_the_material_at_every_distance(material: str) -> None:
    roughness_mm = MATERIALS[material].roughness_mm
    for distance_mm in (300.0, 1100.0):
        deviation, tolerance = _spread(
            _errors_mm(NoiseParams.only("texture"), distance_mm, _board(material))
        )
        assert deviation == pytest.approx(roughness_mm, abs=tolerance)


def test_depths_are_as_far_apart_as_the_published_resolution() -> None:
    noise = NoiseParams.only("quantised")
    depth_mm = np.linspace(NEAR_MM - 5.0, FAR_MM + 5.0, 200_001)[:, None]
    levels_mm = np.unique(quantised_mm(depth_mm, np.zeros(1), noise))
    steps_mm = np.diff(levels_mm)
    near, far = np.searchsorted(levels_mm, [NEAR_MM, FAR_MM])
    assert [steps_mm[near], steps_mm[far - 1]] == pytest.approx([0.3, 2.0], rel=0.01)
    # With the square of the range: the root of the step grows evenly.
    roots = np.sqrt(steps_mm)
    middle = np.searchsorted(levels_mm, (NEAR_MM + FAR_MM) / 2.0)
    assert roots[middle] == pytest.approx((roots[near] + roots[far]) / 2.0, rel=0.01)
    # A level is its own measurement, and steps are larger off the middle (figure 3.16).
    again = quantised_mm(levels_mm[:, None], np.zeros(1), noise)[:, 0]
    assert again == pytest.approx(levels_mm, abs=1e-9)
    at_edge = np.unique(quantised_mm(depth_mm, np.array([EDGE]), noise))
    assert len(at_edge) == pytest.approx(len(levels_mm) / np.sqrt(1.0 + EDGE**2), abs=2.0)


def test_a_quantised_depth_is_the_nearest_level() -> None:
    noise = NoiseParams.only("quantised")
    scene = _board(yaw_deg=25.0)
    step_mm = square_law(0.3, 2.0).at(_scan(NoiseParams.exact(), 800.0, scene).points_mm[..., 2])
    errors_mm = _errors_mm(noise, 800.0, scene)
    assert (np.abs(errors_mm) <= 0.505 * step_mm * np.sqrt(1.0 + SLOPES**2)).all()
    assert (errors_mm / step_mm).std() == pytest.approx(1.0 / np.sqrt(12.0), rel=0.05)


def test_nothing_is_measured_beyond_the_grazing_angle() -> None:
    noise = NoiseParams.only("dropout", grazing_deg=70.0, threshold=0.0)
    for pitch_deg, seen in ((69.7, True), (70.3, False)):
        scan = _scan(noise, 700.0, _board(pitch_deg=pitch_deg))
        assert scan.valid[:, 127:129].all() == seen
        assert scan.n_valid < scan.valid.size  # the beams at the edge meet it more inclined
        assert scan.intensity is not None
        assert ((scan.intensity > 0) == scan.valid).all()


def test_dark_material_drops_out_where_its_light_is_below_the_threshold() -> None:
    noise = NoiseParams.only("dropout", threshold=0.1, grazing_deg=90.0)
    limit_deg = np.degrees(np.arccos(0.1 / MATERIALS["rough_foam"].albedo))
    for pitch_deg in (limit_deg - 1.0, limit_deg + 1.0):
        valid = _scan(noise, 700.0, _board("rough_foam", pitch_deg)).valid[:, 127:129]
        assert valid.all() == (pitch_deg < limit_deg)
        assert valid.any() == (pitch_deg < limit_deg)


def test_rough_texture_drops_out_by_chance() -> None:
    noise = NoiseParams.only("dropout", texture=True)
    foam = MATERIALS["rough_foam"]
    valid = _scan(noise, 700.0, _board("rough_foam", 45.0)).valid[:, MIDDLE]
    light = foam.albedo * np.cos(np.radians(45.0)) / np.sqrt(1.0 + SLOPES[MIDDLE] ** 2)
    expected = norm.cdf(np.log(noise.threshold / light) / foam.contrast).mean()
    assert expected > 0.02
    tolerance = 4.0 * np.sqrt(expected / valid.size)
    assert 1.0 - valid.mean() == pytest.approx(expected, abs=tolerance)
    assert _scan(noise, 700.0, _board("white_paper", 45.0)).valid.all()


def test_a_glossy_surface_is_bright_only_head_on() -> None:
    middle = {}
    for pitch_deg in (0.0, 40.0):
        scan = _scan(NoiseParams.exact(), 700.0, _board("specular_plastic", pitch_deg))
        assert scan.intensity is not None
        middle[pitch_deg] = scan.intensity[:, 127:129].mean()
    screen = MATERIALS["specular_plastic"]
    assert middle[0.0] == pytest.approx(255.0 * (screen.albedo + screen.gloss), abs=1.0)
    assert middle[40.0] == pytest.approx(255.0 * screen.albedo * np.cos(np.radians(40)), abs=1.0)


def test_a_beam_keeps_its_noise_whatever_the_others_meet() -> None:
    noise = NoiseParams(shadow=False, mixed=False, ghosts=False)
    narrow = assemble("narrow", [plate("board", (0.1, 3.0), [0.0] * 3)])
    whole = _scan(noise, 800.0, _board()).points_mm
    part = _scan(noise, 800.0, narrow).points_mm
    kept = np.isfinite(part[..., 2])
    assert 0.1 < kept.mean() < 0.4
    np.testing.assert_array_equal(part[kept], whole[kept])


@pytest.mark.parametrize("switched", SWITCHES)
def test_switching_an_effect_off_leaves_the_draws_of_the_others(switched: str) -> None:
    off = {switched: "none" if switched == "bulge" else False}
    random = NoiseParams.only("gaussian", speckle=True, texture=True)
    one = _scan(random, 800.0, _board()).points_mm[..., 2]
    without = NoiseParams.only("gaussian", **{"speckle": True, "texture": True, **off})
    other = _scan(without, 800.0, _board()).points_mm[..., 2]
    if switched not in ("gaussian", "speckle", "texture"):
        np.testing.assert_array_equal(one, other)
        return
    alone = _errors_mm(NoiseParams.only(switched), 800.0)
    if switched == "speckle":
        assert np.corrcoef((one - other).ravel(), alone.ravel())[0, 1] > 0.99
    else:
        assert one - other == pytest.approx(alone, abs=1e-9)


def test_the_square_law_meets_its_ends_and_is_a_square() -> None:
    law = square_law(0.3, 2.0, (170.0, 1175.0))
    near, middle, far = np.sqrt(law.at(np.array([170.0, 672.5, 1175.0])))
    assert [near**2, far**2] == pytest.approx([0.3, 2.0], rel=1e-12)
    assert middle == pytest.approx((near + far) / 2.0, rel=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"sigma_near_mm": 0.0}, "expected lengths above 0 mm, the far one larger"),
        ({"step_far_mm": np.inf}, "expected lengths above 0 mm, the far one larger"),
        ({"bulge_far_mm": 1.0}, "expected lengths above 0 mm, the far one larger"),
        ({"grazing_deg": 95.0}, "grazing_deg is 95.0; expected 0.0 to 90.0"),
        ({"spot_pixels": np.nan}, "spot_pixels is nan; expected 0.0 to 0.5"),
        ({"bulge": "lateraal"}, "bulge is 'lateraal'; expected 'incidence', 'lateral' or 'none'"),
        ({"speckle": "no"}, "speckle is 'no'; expected True or False"),
        ({"ghost_pixels": 2.5}, "ghost_pixels is 2.5; expected a whole number"),
    ],
)
def test_impossible_noise_is_refused(wrong: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        NoiseParams(**wrong)
