"""What scans: sensors by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from sensors.card import CardRow, measure_card
from sensors.jupiter import Jupiter, JupiterParams
from sensors.sensor import Sensor


class SensorEntry(NamedTuple):
    """A sensor: factory(params) makes one, params of type params_type.

    card: measures the sensor's published numbers on its own scans, or None where there are none.
    """

    factory: Callable[[Any], Sensor]
    params_type: type
    card: Callable[[Any], tuple[CardRow, ...]] | None = None


SENSORS: dict[str, SensorEntry] = {
    "jupiter": SensorEntry(Jupiter, JupiterParams, measure_card),
}
