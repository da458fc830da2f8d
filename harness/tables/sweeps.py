"""The table of a sweep: at every point and for every method, how often and how well it worked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from harness.scoring.chance import wilson_interval
from harness.scoring.poses import COARSE, FINE
from harness.scoring.row_scores import within
from harness.tables.table import Table
from harness.trials.points import short_names

PREFIX = "sweep."


def swept_keys(rows: pd.DataFrame) -> list[str]:
    """The dotted keys that a sweep changes, from the columns of store.load."""
    columns = (str(name) for name in rows.columns if str(name).startswith(PREFIX))
    keys = [name.removeprefix(PREFIX) for name in columns]
    return [key for key in keys if key not in ("point", "varied")]


def plain_value(value: object) -> float | str:
    """A swept value as a number, or as text where it is none."""
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        return float(value)
    return str(value)


def sweep_table(rows: pd.DataFrame) -> Table:
    """One row a point and method, all its pairs and repeats together.

    rows: as store.load gives those of a sweep.
    """
    keys = swept_keys(rows)
    names = short_names(keys)
    known = rows[rows["given"] == ""].copy()
    known["fine"], known["coarse"] = within(known, FINE), within(known, COARSE)
    records = []
    for (_, method), group in known.groupby(["sweep.point", "method"], sort=False):
        first = group.iloc[0]
        record: dict[str, Any] = {"Varied": names.get(first["sweep.varied"], "")}
        record |= {names[key]: first[PREFIX + key] for key in keys}
        record |= {"Method": method, "Trials": len(group)}
        for name in ("fine", "coarse"):
            low, high = wilson_interval(int(group[name].sum()), len(group))
            record |= {name.title(): group[name].mean(), f"{name} low": low, f"{name} high": high}
        good = group[group["coarse"]]
        record["Rotation error (deg)"] = float(good["rotation_error_deg"].median())
        record["Translation error (mm)"] = float(good["translation_error_mm"].median())
        record["Errors"] = int((group["status"] == "error").sum())
        records.append(record)
    frame = pd.DataFrame(records)
    if frame.empty or not frame["Varied"].any():
        frame = frame.drop(columns="Varied", errors="ignore")
    formats = {"Trials": "d", "Errors": "d", "Rotation error (deg)": ".3f",
               "Translation error (mm)": ".2f"}  # fmt: skip
    for key in keys:
        if names[key] in frame and pd.api.types.is_float_dtype(frame[names[key]]):
            formats[names[key]] = ".4g"  # a drawn value has sixteen digits
    for name in ("fine", "coarse"):
        formats |= dict.fromkeys((name.title(), f"{name} low", f"{name} high"), ".0%")
    return Table(
        "sweep",
        "All points of the sweep",
        f"Fine: answered within {FINE}; coarse: within {COARSE}; shares of all trials, with the "
        "ends of Wilson's 95 % interval. Errors are medians over the coarse.",
        frame,
        formats,
    )
