"""What scans: sensors by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from sensors.jupiter import Jupiter, JupiterParams
from sensors.sensor import Sensor


class SensorEntry(NamedTuple):
    """A sensor: factory(params) makes one, params of type params_type."""

    factory: Callable[[Any], Sensor]
    params_type: type


SENSORS: dict[str, SensorEntry] = {
    "jupiter": SensorEntry(Jupiter, JupiterParams),
}
