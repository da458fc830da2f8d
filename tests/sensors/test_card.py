"""The card: published numbers, measured on the simulated sensor's own scans."""

import numpy as np
import pytest

from registration.scan import FloatArray, Scan
from sensors.calibration import FAR_MM, FIELD, PUBLISHED, SPACINGS
from sensors.card import bulge_of, depth_steps_mm, mean_depths_mm, measure_card, spacings_mm
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import NoiseParams
from sensors.target_scans import scan_target

CARD = measure_card(JupiterParams())


def _profiles(z_mm: FloatArray, y_mm: FloatArray) -> Scan:
    points = np.stack([np.zeros_like(z_mm), np.broadcast_to(y_mm, z_mm.shape), z_mm], axis=2)
    return Scan.from_points(points, 5.0)


def test_every_published_number_is_on_the_card_and_within_ten_per_cent() -> None:
    assert [row.number for row in CARD] == list(PUBLISHED)
    for row in CARD:
        assert row.measured_mm == pytest.approx(row.number.value_mm, rel=0.10), row


def test_what_the_default_keeps_is_within_five_per_cent() -> None:
    for row in CARD:
        if row.number not in SPACINGS:  # these and the field contradict each other
            assert row.measured_mm == pytest.approx(row.number.value_mm, rel=0.05), row


def test_the_other_choice_keeps_the_spacings_within_five_per_cent() -> None:
    params = JupiterParams(near_width_mm=114.8, far_width_mm=618.2, widening=0.292)
    for row in measure_card(params):
        limit = 0.10 if row.number in FIELD else 0.05
        assert row.measured_mm == pytest.approx(row.number.value_mm, rel=limit), row


def test_512_pixels_measure_the_same_numbers() -> None:
    for row, coarse in zip(measure_card(JupiterParams(pixels=512)), CARD, strict=True):
        assert row.measured_mm == pytest.approx(coarse.measured_mm, rel=0.08), row


def test_without_effects_only_the_geometry_is_left() -> None:
    params = JupiterParams(noise=NoiseParams.exact())
    for row in measure_card(params):
        if row.number.quantity in ("depth step", "bulge"):
            assert row.measured_mm == pytest.approx(0.0, abs=1e-9)
        elif "edge" not in row.number.quantity and "centre" not in row.number.quantity:
            assert row.measured_mm == pytest.approx(params.fan.predict(row.number), rel=1e-9)
        else:  # the mean of a few beams
            assert row.measured_mm == pytest.approx(params.fan.predict(row.number), rel=0.015)


def test_a_sensor_made_otherwise_shows_on_the_card() -> None:
    noise = NoiseParams(step_far_mm=3.0, bulge_far_mm=4.0)
    odd = {row.number: row.measured_mm for row in measure_card(JupiterParams(noise=noise))}
    far = {n.quantity: odd[n] for n in PUBLISHED if n.depth_mm == FAR_MM}
    assert far["depth step"] == pytest.approx(3.0, rel=0.05)
    assert far["bulge"] == pytest.approx(4.0, rel=0.08)


def test_steps_are_found_under_noise_and_none_without() -> None:
    rng = np.random.default_rng(0)
    exact_mm = 600.0 + rng.normal(0.0, 0.9, (60, 5))
    assert depth_steps_mm(_profiles(0.7 * np.rint(exact_mm / 0.7), np.arange(5.0))) == (
        pytest.approx(0.7, rel=1e-6)
    )
    assert (depth_steps_mm(_profiles(exact_mm, np.arange(5.0))) == 0.0).all()
    assert np.isnan(depth_steps_mm(_profiles(np.full((60, 5), np.nan), np.arange(5.0)))).all()


def test_means_leave_out_what_was_not_measured() -> None:
    z_mm = np.full((4, 40), 700.0)
    z_mm[:, 12:28] = 695.0
    z_mm[0, 3] = np.nan
    scan = _profiles(z_mm, 2.0 * np.arange(40.0))
    assert mean_depths_mm(scan)[[3, 20]] == pytest.approx([700.0, 695.0])
    assert spacings_mm(scan) == pytest.approx(2.0)
    assert bulge_of(scan) == pytest.approx(5.0)
    z_mm[:, 7] = np.nan
    assert np.isnan(spacings_mm(_profiles(z_mm, 2.0 * np.arange(40.0)))[6:8]).all()


@pytest.mark.parametrize("turn_deg", [(0.0, 0.0), (20.0, 0.0), (0.0, 60.0), (-10.0, 25.0)])
def test_a_target_stands_where_its_plane_says(turn_deg: tuple[float, float]) -> None:
    exact = Jupiter(JupiterParams(noise=NoiseParams.exact(), range_limits=False))
    angles = np.radians(turn_deg)
    target = scan_target(exact, 800.0, *angles, 20, 5.0, np.random.default_rng(0))
    assert target.scan.valid.all()
    assert target.scan.points_mm @ target.normal == pytest.approx(target.offset_mm, abs=1e-6)
    assert target.normal[2] == pytest.approx(-np.cos(angles[0]) * np.cos(angles[1]))
    middle_mm = target.scan.points_mm[9:11, 127:129, 2].mean()
    assert middle_mm == pytest.approx(800.0, abs=0.1)
