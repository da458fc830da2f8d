"""A study for the page: what a sweep found at every point, with the trials behind it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from harness.random_groups import within
from harness.scoring import COARSE, FINE, wilson_interval
from harness.sweep_tables import PREFIX, short_names, swept_keys


def study(rows: pd.DataFrame, design: str) -> dict[str, Any]:
    """The points of a sweep as plain values; studies.js draws them.

    rows: as store.load gives those of a sweep. design: of the sweep. Each point has its values in
    the order of the keys, what was varied, the method, shares with Wilson's interval, medians of
    the errors of those within the coarse tolerance, and the ids of its trials.
    """
    keys = swept_keys(rows)
    names = short_names(keys)
    known = rows[rows["given"] == ""]
    flags = {"fine": within(known, FINE), "coarse": within(known, COARSE)}
    known = known.assign(**flags)
    points = []
    for (_, method), group in known.groupby(["sweep.point", "method"], sort=False):
        first = group.iloc[0]
        point: dict[str, Any] = {
            "values": [_plain(first[PREFIX + key]) for key in keys],
            "varied": names.get(first["sweep.varied"], ""),
            "method": method,
            "n": len(group),
            "ids": list(group["id"]),
        }
        for name in flags:
            low, high = wilson_interval(int(group[name].sum()), len(group))
            point[name] = [float(group[name].mean()), low, high]
        good = group[group["coarse"]]
        point["deg"] = _quartiles(good["rotation_error_deg"])
        point["mm"] = _quartiles(good["translation_error_mm"])
        if "ms_registration" in group:
            point["ms"] = _quartiles(group["ms_registration"].dropna())
        points.append(point)
    return {
        "keys": [names[key] for key in keys],
        "full": keys,
        "design": design,
        "methods": list(known["method"].unique()),
        "points": points,
        "tolerances": {
            name: f"{t.rotation_deg:g}° and {t.translation_mm:g} mm"
            for name, t in (("fine", FINE), ("coarse", COARSE))
        },
    }


def _quartiles(values: pd.Series[float]) -> list[float] | None:
    """Median and quartiles, as drawn with their bars; None where there is nothing."""
    if not len(values):
        return None
    low, middle, high = np.quantile(values.to_numpy(np.float64), [0.25, 0.5, 0.75])
    return [float(middle), float(low), float(high)]


def _plain(value: object) -> float | str:
    """A swept value as a number, or as text where it is none."""
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        return float(value)
    return str(value)
