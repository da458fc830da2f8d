"""The calibration, on a made-up sensor whose bias and noise are known here and nowhere else."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from registration.calibration import Calibration, CalibrationError, Table, read_calibration
from registration.calibration_fit import TargetScan, beam_apex_mm, fit_calibration
from registration.scan import FloatArray, Scan
from sensors.target_scans import as_told

APEX_MM = np.array([0.0, 12.0, -45.0])
SLOPES = np.linspace(-0.22, 0.22, 96)
TURNS_DEG = ((0.0, 0.0), (20.0, 0.0), (0.0, 25.0), (0.0, 45.0))
DEPTHS_MM = np.linspace(300.0, 1100.0, 7)


def _bias(depth_mm: FloatArray, tangent: FloatArray) -> FloatArray:
    return -6.0 * (depth_mm / 1100.0) ** 2 / (1.0 + (tangent / 0.12) ** 2)


def _sigma(depth_mm: FloatArray, tangent: FloatArray) -> FloatArray:
    return 0.9 * (depth_mm / 1100.0) ** 2 * np.sqrt(1.0 + 0.5 * tangent**2)


def _target(
    depth_mm: float, turn_deg: tuple[float, float], form: str, noise: float = 1.0, seed: int = 0
) -> TargetScan:
    """A plane through (0, 0, depth), turned about X and then Y, as the made-up sensor sees it."""
    a, b = np.radians(turn_deg)
    normal = -np.array([np.cos(a) * np.sin(b), np.sin(a), np.cos(a) * np.cos(b)])
    offset_mm = float(normal[2] * depth_mm)
    x_mm = 4.0 * (np.arange(24) - 12.0)[:, None]
    ahead = normal[1] * SLOPES + normal[2]
    reach_mm = (offset_mm - normal[0] * x_mm - normal[1:] @ APEX_MM[1:]) / ahead
    true_mm = reach_mm + APEX_MM[2]
    cosine = np.abs(ahead) / np.sqrt(1.0 + SLOPES**2)
    tangent = np.broadcast_to(np.sqrt(np.maximum(cosine**-2 - 1.0, 0.0)), true_mm.shape)
    at = np.abs(np.broadcast_to(SLOPES, true_mm.shape)) if form == "lateral" else tangent
    draws = np.random.default_rng(seed).standard_normal(true_mm.shape)
    measured = true_mm + _bias(true_mm, at) + noise * _sigma(true_mm, tangent) * draws
    points = np.empty((*measured.shape, 3))
    points[..., 0] = x_mm
    points[..., 1] = APEX_MM[1] + SLOPES * (measured - APEX_MM[2])
    points[..., 2] = measured
    return TargetScan(Scan.from_points(points, 4.0), normal, offset_mm)


def _targets(form: str) -> list[TargetScan]:
    return [
        _target(float(depth), turn, form, seed=10 * i + k)
        for i, depth in enumerate(DEPTHS_MM)
        for k, turn in enumerate(TURNS_DEG)
    ]


FITTED = {form: fit_calibration(_targets(form), "a test") for form in ("incidence", "lateral")}


@pytest.mark.parametrize("form", FITTED)
def test_the_form_of_the_bias_is_found(form: str) -> None:
    calibration = FITTED[form]
    assert calibration.form == form
    assert calibration.apex_mm == pytest.approx(APEX_MM, abs=1e-6)
    other = "lateral" if form == "incidence" else "incidence"
    assert calibration.rms_mm[form] < 0.85 * calibration.rms_mm[other]
    assert calibration.rms_mm[other] < calibration.rms_mm["uncorrected"]


@pytest.mark.parametrize("form", FITTED)
def test_the_fitted_bias_is_the_true_one_between_the_distances_too(form: str) -> None:
    depth_mm, slope = np.linspace(330.0, 1070.0, 9)[:, None], np.linspace(-0.21, 0.21, 41)
    tangent = np.abs(slope)
    fitted = FITTED[form].bias_mm(depth_mm, slope, 1.0 / np.sqrt(1.0 + slope**2))
    assert np.abs(fitted - _bias(depth_mm, tangent)).max() < 0.2
    # On an inclined surface only the one that goes with incidence vanishes.
    inclined = FITTED[form].bias_mm(depth_mm, 0.0, np.cos(np.radians(40.0)))
    true = _bias(depth_mm, np.array(np.tan(np.radians(40.0)) if form == "incidence" else 0.0))
    assert inclined == pytest.approx(true, abs=0.25)


def test_the_fitted_noise_is_the_true_one() -> None:
    depth_mm = np.linspace(350.0, 1050.0, 6)[:, None]
    tangent = np.array([0.05, 0.2, 0.6, 0.95])
    fitted = FITTED["incidence"].sigma.value(depth_mm, tangent)
    assert fitted == pytest.approx(_sigma(depth_mm, tangent), rel=0.08)


@pytest.mark.parametrize("form", FITTED)
@pytest.mark.parametrize("turn_deg", [(0.0, 0.0), (9.0, 0.0), (0.0, 6.0), (12.0, 20.0)])
def test_a_corrected_scan_is_flat(form: str, turn_deg: tuple[float, float]) -> None:
    calibration = FITTED[form]
    target = _target(870.0, turn_deg, form, seed=99)
    corrected = calibration.correct(target.scan)

    def off_plane(scan: Scan) -> float:
        error = (scan.points_mm @ target.normal - target.offset_mm).mean(axis=0)
        return float(np.sqrt(np.mean(error**2)))

    noise = off_plane(_target(870.0, turn_deg, "incidence", seed=99).scan)
    assert off_plane(corrected) < 0.25
    if turn_deg != (12.0, 20.0):  # inclined so much that hardly any bias is left
        assert off_plane(corrected) < 0.15 * max(off_plane(target.scan), noise)
    # Points moved along their beams, and nothing else changed.
    slopes = (corrected.points_mm[..., 1] - APEX_MM[1]) / (corrected.points_mm[..., 2] - APEX_MM[2])
    assert slopes == pytest.approx(np.broadcast_to(SLOPES, slopes.shape), abs=1e-6)
    np.testing.assert_array_equal(corrected.points_mm[..., 0], target.scan.points_mm[..., 0])


def test_no_returns_stay_and_the_scan_given_is_left_alone() -> None:
    points = _target(700.0, (0.0, 0.0), "incidence").scan.points_mm.copy()
    points[3, 10:30] = np.nan
    scan = Scan.from_points(points, 4.0)
    calibration = FITTED["incidence"]
    np.testing.assert_array_equal(calibration.correct(scan).valid, scan.valid)
    np.testing.assert_array_equal(np.isfinite(calibration.sigma_mm(scan)), scan.valid)
    np.testing.assert_array_equal(scan.points_mm, points)
    empty = Scan.from_points(np.full((4, 8, 3), np.nan), 4.0)
    assert calibration.correct(empty).n_valid == 0


def test_sigma_of_a_scan_follows_its_depth_and_incidence() -> None:
    for turn_deg in ((0.0, 0.0), (0.0, 45.0)):
        target = _target(800.0, turn_deg, "incidence")
        depth_mm = target.scan.points_mm[..., 2]
        true = _sigma(depth_mm, np.full_like(depth_mm, np.tan(np.radians(turn_deg[1]))))
        assert FITTED["incidence"].sigma_mm(target.scan) == pytest.approx(true, rel=0.2)


def test_a_table_is_bilinear_inside_and_constant_beyond() -> None:
    table = Table(np.array([0.0, 10.0]), np.array([0.0, 1.0, 3.0]), np.arange(6.0).reshape(2, 3))
    assert table.value([5.0, 5.0], [0.5, 2.0]) == pytest.approx([2.0, 3.0])
    assert table.value([-9.0, 99.0], [-1.0, 9.0]) == pytest.approx([0.0, 5.0])
    assert np.isnan(table.value(np.nan, 0.5))


def test_the_apex_is_where_the_beams_meet_whatever_the_noise() -> None:
    scans = [_target(d, (0.0, 0.0), "incidence", noise=5.0).scan for d in (300.0, 700.0, 1100.0)]
    assert beam_apex_mm(scans) == pytest.approx(APEX_MM, abs=1e-6)


def test_a_calibration_needs_distances_and_a_tilt() -> None:
    facing = [_target(float(d), (0.0, 0.0), "incidence") for d in DEPTHS_MM]
    with pytest.raises(ValueError, match="no target is tilted"):
        fit_calibration(facing)
    with pytest.raises(ValueError, match="one distance"):
        fit_calibration([_target(500.0, (0.0, 0.0), "incidence", noise=0.0)])


@pytest.mark.parametrize(
    ("normal", "offset_mm", "seen", "message"),
    [
        ((0.0, 0.0, 1.0), 500.0, False, "target 2 has no measured point"),
        ((1.0, 0.0, 0.0), 500.0, True, "target 2 stands at .* across Z"),
        ((0.0, 0.0, 2.0), 500.0, True, "expected a unit vector"),
        ((0.0, 0.0, np.nan), 500.0, True, "expected a unit vector"),
        ((0.0, 0.0, 1.0), np.inf, True, "a finite distance"),
    ],
)
def test_a_target_that_tells_nothing_is_named(
    normal: tuple[float, float, float], offset_mm: float, seen: bool, message: str
) -> None:
    first = _target(300.0, (20.0, 0.0), "incidence")
    points_mm = first.scan.points_mm if seen else np.full_like(first.scan.points_mm, np.nan)
    second = TargetScan(Scan.from_points(points_mm, 4.0), np.array(normal), offset_mm)
    with pytest.raises(ValueError, match=message):
        fit_calibration([first, second])


def test_targets_of_too_few_points_are_named() -> None:
    short = [
        TargetScan(Scan.from_points(t.scan.points_mm[:1, ::32], 4.0), t.normal, t.offset_mm)
        for t in _targets("incidence")[:12]
    ]
    with pytest.raises(ValueError, match="points in all, too few to tell the noise"):
        fit_calibration(short)


def test_targets_that_stood_elsewhere_than_told_cost_little_when_the_bench_is_known() -> None:
    def error_mm(calibration: Calibration) -> float:
        depth_mm, tangent = np.linspace(330.0, 1070.0, 9)[:, None], np.linspace(0.0, 0.6, 41)
        fitted = calibration.bias_mm(depth_mm, 0.0, 1.0 / np.sqrt(1.0 + tangent**2))
        return float(np.sqrt(np.mean((fitted - _bias(depth_mm, tangent)) ** 2)))

    told_mm, told_deg = 0.5, 0.05
    ignored, found, known = [], [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        told = [as_told(target, told_mm, told_deg, rng) for target in _targets("incidence")]
        ignored.append(error_mm(fit_calibration(told)))
        calibration = fit_calibration(told, "", told_mm, told_deg)
        found.append(error_mm(calibration))
        known.append(calibration.known_to_mm)
    assert np.all(np.less(found, ignored))
    assert np.mean(found) < 0.7 * np.mean(ignored)
    # What it says of itself is about what it is off by: 5 benches tell a deviation to a third.
    assert 0.5 * np.mean(found) < np.mean(known) < 2.0 * np.mean(found)
    assert FITTED["incidence"].known_to_mm < 0.2 * np.mean(known)


def test_writing_and_reading_give_the_same_calibration(tmp_path: Path) -> None:
    for form, calibration in FITTED.items():
        calibration.write(tmp_path / "c.json")
        again = read_calibration(tmp_path / "c.json")
        assert (again.form, again.measured_by) == (form, "a test")
        assert again.rms_mm == pytest.approx(calibration.rms_mm, abs=1e-4)
        assert again.known_to_mm == pytest.approx(calibration.known_to_mm, abs=1e-4)
        depth_mm, slope = np.linspace(200.0, 1300.0, 30)[:, None], np.linspace(-0.3, 0.3, 20)
        for table in ("bias", "sigma"):
            one, two = (getattr(c, table).value(depth_mm, slope) for c in (calibration, again))
            assert two == pytest.approx(one, abs=5e-3)


def _without(key: str) -> Callable[[dict], object]:
    return lambda data: data.pop(key)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data.update(format="a map"), "format: should be 'profile scanner calib"),
        (lambda data: data.update(version=9), "version: is 9; this program reads 1"),
        (_without("bias"), "bias: is missing"),
        (lambda data: data.update(known_to_mm=-1), "known_to_mm: is -1; expected a number from 0"),
        (_without("apex_mm"), "apex_mm: is missing"),
        (lambda data: data.update(apex_mm=[1, 2]), "apex_mm: expected three coordinates"),
        (lambda data: data["bias"].update(form="both"), "bias.form: is 'both'; expected"),
        (lambda data: data["bias"]["depth_mm"].reverse(), "bias.depth_mm: expected at least two"),
        (lambda data: data["bias"]["value_mm"].pop(), "bias.value_mm: has shape"),
        (lambda data: data["bias"]["value_mm"][0].pop(), "bias.value_mm: expected numbers"),
        (lambda data: data["sigma"].update(value_mm="no"), "sigma.value_mm: expected numbers"),
        (lambda data: data["sigma"]["value_mm"][0].__setitem__(0, 0.0), "not above 0"),
        (
            lambda data: data["sigma"]["depth_mm"].__setitem__(-1, 1e9),
            "bias.depth_mm and sigma.depth_mm: reach from",
        ),
        (
            lambda data: data["sigma"].update(
                tangent_of_incidence=[1e7 + t for t in data["sigma"]["tangent_of_incidence"]]
            ),
            "bias.tangent_of_incidence and sigma.tangent_of_incidence: reach from",
        ),
        (lambda data: data["bias"]["depth_mm"].__setitem__(0, np.nan), "bias.depth_mm: expected a"),
        (lambda data: data.update(rms_mm=[1]), "rms_mm: expected numbers by name"),
    ],
)
def test_a_malformed_file_gets_one_line(
    spoil: Callable[[dict], object], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "c.json"
    FITTED["incidence"].write(path)
    data = json.loads(path.read_text(encoding="utf-8"))
    spoil(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(CalibrationError) as caught:
        read_calibration(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[]", b"3", b"[" * 99_999])
def test_what_is_no_calibration_at_all_is_said_to_be_none(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    path.write_bytes(content)
    with pytest.raises(CalibrationError, match=r"is not JSON|format: should be"):
        read_calibration(path)


def test_no_bias_is_left_as_it_is() -> None:
    nodes = np.array([0.0, 1.0])
    flat = Table(nodes, nodes, np.zeros((2, 2)))
    noise = Table(nodes, nodes, np.ones((2, 2)))
    scan = _target(700.0, (0.0, 0.0), "incidence").scan
    for form in ("incidence", "lateral"):
        corrected = Calibration(form, APEX_MM, flat, noise).correct(scan)
        np.testing.assert_array_equal(corrected.points_mm, scan.points_mm)
