"""The card of a sensor as a table: published numbers beside what the simulated sensor measures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from harness.tables.table import Table
from sensors import SENSORS
from sensors.calibration import FIELD, SPACINGS, fit_geometry
from sensors.card import CardRow

KEPT_WITHIN = 0.05  # of the published numbers that a sensor is said to keep
CAPTION = (
    "Measured on the simulated sensor's own scans of a flat target, range limits off. The "
    "published field (width) and the published spacings contradict each other: no fan of rays has "
    "both. Of these, the last column says which are kept and which are given up, and come as near "
    "as the others let them; the precision experiment's table of geometry fits shows both choices. "
    "An effect that is switched off shows as 0."
)


def card_table(sensor: str, params: Any) -> Table | None:
    """The card of a sensor of SENSORS; None for one without published numbers."""
    measure = SENSORS[sensor].card
    return None if measure is None else as_table(measure(params), sensor)


def as_table(rows: Sequence[CardRow], sensor: str) -> Table:
    """The rows of a card as a table."""
    frame = pd.DataFrame(
        {
            "Number": [row.number.quantity for row in rows],
            "Z' (mm)": [row.raw_depth_mm for row in rows],
            "Source": [row.number.source for row in rows],
            "Published (mm)": [row.number.value_mm for row in rows],
            "Measured (mm)": [row.measured_mm for row in rows],
            "Difference (mm)": [row.measured_mm - row.number.value_mm for row in rows],
            "Difference (%)": [100.0 * _misfit(row) for row in rows],
            "Contradicted": _kept_or_given_up(rows),
        }
    )
    formats = {
        "Z' (mm)": ".1f", "Published (mm)": ".2f", "Measured (mm)": ".2f",
        "Difference (mm)": "+.2f", "Difference (%)": "+.1f",
    }  # fmt: skip
    return Table("sensor_card", f"Card of the sensor {sensor}", CAPTION, frame, formats)


def _misfit(row: CardRow) -> float:
    return row.measured_mm / row.number.value_mm - 1.0


def _kept_or_given_up(rows: Sequence[CardRow]) -> list[str]:
    """Of every number that others contradict, whether the sensor keeps it; else nothing."""
    worst = {
        side: max((abs(_misfit(row)) for row in rows if row.number in side), default=1.0)
        for side in (FIELD, SPACINGS)
    }
    kept = next((side for side in (FIELD, SPACINGS) if worst[side] <= KEPT_WITHIN), None)
    if kept is None:
        return [""] * len(rows)
    words = dict.fromkeys((*FIELD, *SPACINGS), "given up") | dict.fromkeys(kept, "kept")
    return [words.get(row.number, "") for row in rows]


def geometry_table() -> Table:
    """Both fits of the fan of rays to the contradictory published numbers, number by number."""
    fits = {"field": fit_geometry("field"), "spacings": fit_geometry("spacings")}
    numbers = FIELD + SPACINGS
    columns: dict[str, list[Any]] = {
        "Number": [n.quantity for n in numbers],
        "Z (mm)": [n.depth_mm for n in numbers],
        "Source": [n.source for n in numbers],
        "Published (mm)": [n.value_mm for n in numbers],
    }
    formats = {"Z (mm)": ".1f", "Published (mm)": ".2f"}
    for keep, fit in fits.items():
        values = [fit.predict(n) for n in numbers]
        columns[f"Keeping the {keep} (mm)"] = values
        columns[f"Keeping the {keep} (%)"] = [
            100.0 * (value / n.value_mm - 1.0) for value, n in zip(values, numbers, strict=True)
        ]
        formats[f"Keeping the {keep} (mm)"] = ".2f"
        formats[f"Keeping the {keep} (%)"] = "+.1f"
    note = " ".join(
        f"Keeping the {keep}: half angle's tangent {fit.edge_slope:.4f}, apex "
        f"{fit.apex_depth_mm:.1f} mm behind the front, spacing {100 * fit.widening:.0f} % wider "
        "at the edge."
        for keep, fit in fits.items()
    )
    caption = (
        "Least sum of fourth powers of the relative misfits of the spacings. The sensor's default "
        "keeps the field."
    )
    frame = pd.DataFrame(columns)
    return Table("geometry_fits", "Fits of the beams' geometry", caption, frame, formats, note)
