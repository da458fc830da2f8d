import pytest

from harness.tables.card import as_table, card_table, geometry_table
from sensors import SENSORS, SensorEntry
from sensors.calibration import PUBLISHED
from sensors.card import CardRow
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import NoiseParams


def test_differences_are_of_the_measured_from_the_published_number() -> None:
    row = CardRow(PUBLISHED[0], 1.1 * PUBLISHED[0].value_mm)
    (shown,) = as_table([row], "jupiter").frame.to_dict("records")
    assert shown["Difference (mm)"] == pytest.approx(0.1 * PUBLISHED[0].value_mm)
    assert shown["Difference (%)"] == pytest.approx(10.0)
    assert shown["Z' (mm)"] == pytest.approx(1389.6 - PUBLISHED[0].depth_mm)


def test_the_card_is_of_the_sensor_as_it_is_set() -> None:
    params = JupiterParams(noise=NoiseParams.only("quantised", step_far_mm=4.0))
    table = card_table("jupiter", params)
    assert table is not None
    step = table.frame.query("Number == 'depth step'").iloc[-1]
    assert step["Measured (mm)"] == pytest.approx(4.0, rel=0.05)


def test_a_sensor_without_published_numbers_has_no_card(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SENSORS, "plain", SensorEntry(Jupiter, JupiterParams))
    assert card_table("plain", JupiterParams()) is None


def test_both_fits_are_shown_number_by_number() -> None:
    frame = geometry_table().frame
    kept = frame[frame["Number"] == "width"]
    assert kept["Keeping the field (%)"].abs().max() < 1e-9
    assert kept["Keeping the spacings (%)"].min() > 5.0
    spacings = frame[frame["Number"] != "width"]
    assert spacings["Keeping the spacings (%)"].abs().max() < 5.0
    assert spacings["Keeping the field (%)"].abs().max() > 5.0


@pytest.mark.parametrize(
    ("params", "kept", "given_up"),
    [
        (JupiterParams(), "width", "spacing"),
        (
            JupiterParams(near_width_mm=114.8, far_width_mm=618.2, widening=0.292),
            "spacing",
            "width",
        ),
    ],
)
def test_the_card_says_which_of_the_contradictory_numbers_the_sensor_keeps(
    params: JupiterParams, kept: str, given_up: str
) -> None:
    table = card_table("jupiter", params)
    assert table is not None
    words = table.frame.set_index("Number")["Contradicted"]
    assert set(words[words.index.str.contains(kept)]) == {"kept"}
    assert set(words[words.index.str.contains(given_up)]) == {"given up"}
    assert set(words[["depth step", "bulge"]]) == {""}
    limits = table.frame.groupby("Contradicted")["Difference (%)"].agg(lambda d: d.abs().max())
    assert limits["kept"] < 5.0
    assert limits["given up"] < 10.0


def test_a_sensor_that_keeps_neither_is_not_said_to_keep_one() -> None:
    table = card_table("jupiter", JupiterParams(near_width_mm=200.0, far_width_mm=400.0))
    assert table is not None
    assert set(table.frame["Contradicted"]) == {""}
