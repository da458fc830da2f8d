"""A measured bias is taken out of the planes, whatever it goes with."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plane_scans import Plates, plates_from, scan_plates

from registration import Scan, register
from registration.calibration import Calibration, CalibrationError, Table
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.fan.beams import Fan
from registration.gauss_sphere.fan.calibrated import bias_and_noise, known_of, read_known
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.planes.points import Grouped
from registration.gauss_sphere.planes.straightening import straightened
from registration.gauss_sphere.view import View

DEPTH_MM = np.linspace(200.0, 1200.0, 11)


def calibration(form: str) -> Calibration:
    """A bulge of up to 5 mm towards the sensor, half as high at 0.14 of the field or incidence."""
    at = np.linspace(0.0 if form == "incidence" else -0.3, 3.0 if form == "incidence" else 0.3, 61)
    if form == "incidence":
        at = np.concatenate([np.linspace(0.0, 0.4, 41), np.linspace(0.5, 3.0, 11)])
    value = -5.0 * (DEPTH_MM[:, None] / 1000.0) * np.exp(-0.5 * (at / 0.12) ** 2)[None, :]
    sigma = Table(DEPTH_MM, np.array([0.0, 3.0]), np.full((DEPTH_MM.size, 2), 0.5))
    apex_mm = np.array([0.0, 0.0, -60.0])
    return Calibration(form, apex_mm, Table(DEPTH_MM, at, value), sigma)  # type: ignore[arg-type]  # a str parameter


def biased(made: Plates, form: str, noise: float, seed: int = 0) -> Scan:
    """Exact points of plates, each moved along its beam by the bias there, with noise."""
    exact = scan_plates(made)
    points_mm = exact.points_mm.copy()
    model = calibration(form)
    slope = points_mm[..., 1] / (points_mm[..., 2] + 60.0)
    rng = np.random.default_rng(seed)
    for centre, axes in zip(made.centre_mm, made.axes, strict=True):
        on = np.abs((points_mm - centre) @ axes[2]) < 1e-6
        cos = np.abs(axes[2, 1] * slope + axes[2, 2]) / np.sqrt(1.0 + slope**2)
        off = model.bias_mm(points_mm[..., 2], slope, cos) + rng.normal(0.0, noise, slope.shape)
        points_mm[on, 1] += (slope * off)[on]
        points_mm[on, 2] += off[on]
    return replace(exact, points_mm=points_mm)


@pytest.fixture
def made() -> Plates:
    normals = np.array([[0.05, 0.0, -1.0], [0.3, 0.2, -1.0], [0.1, -0.6, -1.0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centres = np.array([[70.0, -90.0, 800.0], [230.0, 0.0, 850.0], [70.0, 110.0, 820.0]])
    return plates_from(normals, centres, np.array([[65.0, 80.0], [60.0, 150.0], [65.0, 70.0]]))


def worst(scan: Scan, made: Plates, params: GaussSphereParams) -> tuple[float, float]:
    """Largest error of the three largest patches: tilt in rad, offset in mm at their centroid."""
    patches = describe(scan, params).patches
    tilts, offsets = [], []
    for normal, centroid in zip(patches.normal[:3], patches.centroid_mm[:3], strict=True):
        n = made.axes[:, 2] * -np.sign(made.axes[:, 2, 2:])
        i = np.argmin(np.linalg.norm(n - normal, axis=1))
        tilts.append(np.linalg.norm(n[i] - normal))
        offsets.append(abs(n[i] @ (centroid - made.centre_mm[i])))
    return max(tilts), max(offsets)


@pytest.mark.parametrize("form", ["incidence", "lateral"])
def test_planes_are_straight_again(form: str, made: Plates, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    calibration(form).write(path)
    scan = biased(made, form, noise=0.3)
    tilt, offset = worst(scan, made, GaussSphereParams(calibration=str(path)))
    assert tilt < 0.003
    assert offset < 0.15
    assert worst(scan, made, GaussSphereParams())[1] > 1.0


def fan_without_bias(view: View, model: Calibration) -> Fan:
    label = view.patches.label.ravel()
    place = np.argsort(label, kind="stable")[np.count_nonzero(label < 0) :].astype(np.int32)
    start = np.searchsorted(label[place], np.arange(view.patches.n_points.size + 1))
    points = Grouped(start[:-1], start[1:], place // np.int32(view.patches.label.shape[1]), place)
    return straightened(view.fan, points, known_of(model), turns=3)


@pytest.mark.parametrize("reach", [1.0, 3.0, 12.0])  # farther than the bias, or less far
@pytest.mark.parametrize("form", ["incidence", "lateral"])
def test_the_fast_table_is_the_calibration(form: str, reach: float) -> None:
    model = calibration(form)
    rng = np.random.default_rng(0)
    slope, z = rng.uniform(-0.3, 0.3, 500), rng.uniform(150.0, 1250.0, 500)
    normal = np.array([0.1, -0.3, -np.sqrt(0.9)])
    apex_z = -60.0
    growing = np.outer(DEPTH_MM / 1000.0, [0.3, 0.9])
    model = replace(model, sigma=Table(DEPTH_MM, np.array([0.0, reach]), growing))
    bias, sigma = np.empty((2, 500))
    bias_and_noise(slope, z - apex_z, normal, apex_z, known_of(model), bias, sigma)
    cos = -(normal[1] * slope + normal[2]) / np.sqrt(1.0 + slope**2)
    expected = model.bias_mm(z, slope, cos)
    np.testing.assert_allclose(bias, expected, atol=2e-3)
    tangent = np.sqrt(1.0 / cos**2 - 1.0)
    np.testing.assert_allclose(sigma, model.sigma.value(z, tangent), rtol=1e-9)


@pytest.mark.parametrize("form", ["incidence", "lateral", "none"])
def test_one_step_on_all_points_is_enough(form: str, made: Plates, tmp_path: Path) -> None:
    """The bias follows a plane that tilts: the step of a fit foresees where both come to rest."""
    path = tmp_path / "calibration.json"
    if form == "none":
        params, scan = (
            GaussSphereParams(),
            scan_plates(made, noise=1.0, rng=np.random.default_rng(0)),
        )
    else:
        calibration(form).write(path)
        params, scan = GaussSphereParams(calibration=str(path)), biased(made, form, noise=0.3)
    once = describe(scan, params).patches
    often = describe(scan, replace(params, patches=replace(params.patches, fit_rounds=8))).patches
    assert once.n_points[:3].min() > 1500  # many more than those from which a fit starts
    for i in range(3):
        assert np.abs(once.basis[i] @ once.normal[i]).max() < 1e-12
        sigma = np.sqrt(np.diag(often.covariance[i]))
        tilt = often.basis[i] @ once.normal[i]
        offset = once.normal[i] @ often.centroid_mm[i] - once.offset_mm[i]
        assert (np.abs([*tilt, offset]) < 0.3 * sigma).all()


@pytest.mark.parametrize("aside", [0.05, 0.15, 0.3])
def test_covariances_hold_where_the_bias_follows_the_plane(aside: float, tmp_path: Path) -> None:
    """A plane that tilts takes its bias along, so its errors are larger than its points' noise."""
    path = tmp_path / "calibration.json"
    calibration("incidence").write(path)
    params = GaussSphereParams(calibration=str(path))
    normal = np.array([0.05, aside, -1.0]) / np.linalg.norm([0.05, aside, 1.0])
    one = plates_from(normal[None], np.array([[150.0, 0.0, 800.0]]), np.array([[60.0, 60.0]]))
    errors = []
    for seed in range(40):
        found = describe(biased(one, "incidence", 0.5, seed), params).patches
        sigma = np.sqrt(np.diag(found.covariance[0]))[:2]
        errors.append(found.basis[0] @ normal / sigma)
    # The deviation of 40 values is known to a ninth.
    assert np.std(errors, axis=0).max() < 1.4
    assert np.std(errors, axis=0).min() > 0.7
    assert np.abs(np.mean(errors, axis=0)).max() < 0.5


def test_points_are_weighted_by_the_noise_of_their_inclination(made: Plates) -> None:
    level = calibration("incidence")
    steep = np.array([[0.5, 0.5, 2.0, 2.0]] * DEPTH_MM.size)  # four times the noise on a slant
    model = replace(level, sigma=Table(DEPTH_MM, np.array([0.0, 0.28, 0.36, 3.0]), steep))
    view = describe(scan_plates(made), GaussSphereParams())
    fan = fan_without_bias(view, model)
    sigma = []
    for plate in (0, 2):
        normal = made.axes[plate, 2] * -np.sign(made.axes[plate, 2, 2])
        i = np.argmin(np.linalg.norm(view.patches.normal - normal, axis=1))
        sigma.append(np.median(fan.sigma_mm[view.patches.label == i]))
    assert sigma[1] / sigma[0] == pytest.approx(4.0, rel=0.05)
    uniform = fan_without_bias(view, level)
    on = view.patches.label >= 0
    np.testing.assert_allclose(uniform.sigma_mm[on], view.fan.sigma_mm[on], rtol=0.3)


def test_a_broken_calibration_is_named(exact_pair, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text("{}")
    params = GaussSphereParams(calibration=str(path))
    with pytest.raises(CalibrationError, match=r"calibration\.json"):
        register(exact_pair.target, exact_pair.source, params=params)


def test_another_file_of_the_same_name_and_age_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, known_to_mm in (("a", 0.1), ("b", 0.7)):
        (tmp_path / name).mkdir()
        file = tmp_path / name / "sensor.json"
        replace(calibration("lateral"), known_to_mm=known_to_mm).write(file)
        os.utime(file, (1e9, 1e9))
        monkeypatch.chdir(tmp_path / name)
        assert read_known("sensor.json").known_to_mm == known_to_mm


def test_an_answer_without_a_calibration_says_so(exact_pair, tmp_path: Path) -> None:
    result = register(exact_pair.target, exact_pair.source)
    assert (result.status, result.reason) == ("ok", "")
    (note,) = result.notes
    assert note.startswith("no calibration was given")
    assert "\n" not in note
    nothing = Scan.from_points(np.full((5, 8, 3), np.nan), step_mm=5.0)
    assert register(nothing, nothing).notes == (note,)


def test_the_bias_of_a_flat_scan_goes_by_the_apex_that_was_measured(tmp_path: Path) -> None:
    calibration("incidence").write(tmp_path / "sensor.json")
    params = GaussSphereParams(calibration=str(tmp_path / "sensor.json"))
    flat = plates_from(
        np.array([[0.0, 0.0, -1.0]]), np.array([[150.0, 0.0, 800.0]]), np.array([[300.0, 300.0]])
    )
    scan = biased(flat, "incidence", 0.5)
    found = describe(replace(scan, apex_mm=None), params).patches
    as_given = describe(scan, params).patches
    assert found.n_points.size == as_given.n_points.size == 1
    np.testing.assert_array_equal(found.covariance, as_given.covariance)
    np.testing.assert_array_equal(found.normal, as_given.normal)
