import numpy as np
import pytest

from sensors.calibration import (
    FIELD,
    PIXELS,
    PUBLISHED,
    SPACINGS,
    FanGeometry,
    fan_of_field,
    fit_geometry,
    misfits,
)
from sensors.jupiter import JupiterParams


def test_the_default_sensor_is_the_fit_that_holds_the_field() -> None:
    fitted, default = fit_geometry("field"), JupiterParams().fan
    assert default.widening == pytest.approx(fitted.widening, abs=5e-4)
    assert misfits(fitted, FIELD) == pytest.approx(0.0, abs=1e-12)
    assert np.abs(misfits(default, SPACINGS)).max() < 0.09


def test_without_the_field_the_spacings_fit_and_the_field_does_not() -> None:
    fitted = fit_geometry("spacings")
    assert np.abs(misfits(fitted, SPACINGS)).max() < 0.035
    assert 0.05 < misfits(fitted, FIELD).min() < misfits(fitted, FIELD).max() < 0.1
    # The numbers that the documentation of JupiterParams gives for it.
    documented = JupiterParams(near_width_mm=114.8, far_width_mm=618.2, widening=0.292).fan
    assert misfits(documented, SPACINGS) == pytest.approx(misfits(fitted, SPACINGS), abs=1e-3)


def test_a_fan_is_found_again_from_its_own_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    true = FanGeometry(0.21, 75.0, 0.4)
    numbers = tuple(type(n)(n.quantity, n.depth_mm, true.predict(n), n.source) for n in SPACINGS)
    monkeypatch.setattr("sensors.calibration.SPACINGS", numbers)
    found = fit_geometry("spacings")
    assert found.edge_slope == pytest.approx(true.edge_slope, rel=1e-3)
    assert found.apex_depth_mm == pytest.approx(true.apex_depth_mm, abs=0.5)
    assert found.widening == pytest.approx(true.widening, rel=1e-2)


@pytest.mark.parametrize("widening", [0.0, 0.3])
def test_spacings_grow_by_the_widening_towards_both_edges(widening: float) -> None:
    slopes = FanGeometry(0.2, 0.0, widening).slopes(4096)
    spacing = np.diff(slopes)
    assert spacing[0] / spacing[len(spacing) // 2] == pytest.approx(1.0 + widening, rel=1e-3)
    assert slopes == pytest.approx(-slopes[::-1], abs=1e-15)
    assert slopes[[0, -1]] == pytest.approx([-0.2, 0.2], abs=1e-15)


def test_predictions_are_what_a_plane_parallel_to_the_profile_shows() -> None:
    fan = fan_of_field(170.0, 1175.0, 108.0, 579.0, 0.25)
    for number in FIELD + SPACINGS:
        y_mm = fan.slopes(PIXELS) * (number.depth_mm + fan.apex_depth_mm)
        spacing_mm = np.diff(y_mm)
        expected = {
            "width": np.ptp(y_mm),
            "mean spacing": spacing_mm.mean(),
            "centre spacing": spacing_mm.min(),
            "edge spacing": spacing_mm.max(),
        }[number.quantity]
        assert fan.predict(number) == pytest.approx(expected, rel=1e-6)
    with pytest.raises(ValueError, match="says nothing of the bulge"):
        fan.predict(next(n for n in PUBLISHED if n.quantity == "bulge"))


def test_an_unknown_side_to_keep_is_refused() -> None:
    with pytest.raises(ValueError, match="keep is 'both'; expected 'field' or 'spacings'"):
        fit_geometry("both")  # type: ignore[arg-type]  # on purpose


def test_512_beams_lie_between_the_256() -> None:
    coarse, fine = (JupiterParams(pixels=n).slopes for n in (256, 512))
    assert fine[[0, -1]] == pytest.approx(coarse[[0, -1]], abs=1e-15)
    assert np.diff(fine).mean() == pytest.approx(np.diff(coarse).mean() * 255 / 511)
