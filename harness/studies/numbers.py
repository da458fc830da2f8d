"""What studies count: which trials are right, errors that failures take part in, intervals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from harness.scoring.chance import LEVEL, median_interval, sign_test, wilson_interval
from harness.scoring.poses import COARSE
from harness.scoring.row_scores import within
from registration.scan import BoolArray, FloatArray

ROTATION, TRANSLATION = "Rotation error (deg)", "Translation error (mm)"
ERRORS = {ROTATION: "rotation_cut_deg", TRANSLATION: "translation_cut_mm"}
ERROR_FORMATS = {ROTATION: ".2f", TRANSLATION: ".1f"}
MEDIANS = {
    "Median rotation error (deg)": "rotation_error_deg",
    "Median translation error (mm)": "translation_error_mm",
}
RESAMPLES = 1000
RIGHT = f"Right: answered ok, within {COARSE}, with Wilson's 95 % interval."
CUT = (
    f"Errors are means over all trials, cut at {COARSE}, no answer counting as that, with "
    "bootstrap 95 % intervals."
)


def outcomes(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of whole trials with the columns right, rotation_cut_deg and translation_cut_mm.

    Errors are cut at the coarse tolerance; a trial without an answer marked ok has both at the cut,
    so that a failure is never better than an answer and none is left out.
    """
    known = rows[rows["given"] == ""].copy()
    known["right"] = within(known, COARSE)
    answered = (known["status"] == "ok").to_numpy(dtype=bool)
    for column, name, cut in (
        ("rotation_error_deg", "rotation_cut_deg", COARSE.rotation_deg),
        ("translation_error_mm", "translation_cut_mm", COARSE.translation_mm),
    ):
        error = known[column].to_numpy(dtype=float)
        known[name] = np.where(answered & np.isfinite(error), np.fmin(error, cut), cut)
    return known


def record_of(group: pd.DataFrame) -> dict[str, Any]:
    """How many trials, the share that is right and the mean errors, each with its interval."""
    record = {"Trials": len(group), **share_of("Right", group["right"])}
    for name, column in ERRORS.items():
        values = group[column].to_numpy(dtype=float)
        bounds = mean_interval(values)
        record |= {name: values.mean(), f"{name} low": bounds[0], f"{name} high": bounds[1]}
    return record


def share_of(name: str, flags: pd.Series[bool]) -> dict[str, Any]:
    """The share of trials that have a flag, and Wilson's interval, under a name; NaN of none."""
    count, total = int(flags.sum()), len(flags)
    low, high = wilson_interval(count, total)
    share = count / total if total else float("nan")
    return {name: share, f"{name} low": low, f"{name} high": high}


def record_formats() -> dict[str, str]:
    """How the columns of record_of are printed."""
    formats = {"Trials": "d"}
    for column, form in {"Right": ".0%", **ERROR_FORMATS}.items():
        formats |= dict.fromkeys((column, f"{column} low", f"{column} high"), form)
    return formats


def medians_of(right: pd.DataFrame) -> dict[str, float]:
    """Median errors of the rows that are right, and their intervals by order statistics.

    NaN where there are too few.
    """
    record = {}
    for name, column in MEDIANS.items():
        values = right[column].to_numpy(dtype=float)
        low, high = median_interval(values) or (np.nan, np.nan)
        record[name] = float(np.median(values)) if len(values) else np.nan
        record |= {f"{name} low": low, f"{name} high": high}
    return record


def median_formats() -> dict[str, str]:
    """How the columns of medians_of are printed."""
    formats: dict[str, str] = {}
    for name, form in zip(MEDIANS, (".3f", ".2f"), strict=True):
        formats |= dict.fromkeys((name, f"{name} low", f"{name} high"), form)
    return formats


def mean_interval(values: FloatArray) -> tuple[float, float]:
    """The 95 % interval of a mean by the percentile bootstrap, the same for the same values."""
    if not len(values):
        return float("nan"), float("nan")
    picks = np.random.default_rng(0).integers(len(values), size=(RESAMPLES, len(values)))
    low, high = np.quantile(values[picks].mean(axis=1), [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return float(low), float(high)


def paired(ours: pd.DataFrame, theirs: pd.DataFrame, columns: Sequence[str]) -> list[FloatArray]:
    """For each column (pairs, 2) what both have on the pairs and repeats that are in both."""
    key = ["pair", "repeat"]
    both = ours[[*key, *columns]].merge(theirs[[*key, *columns]], on=key, how="inner")
    return [both[[f"{c}_x", f"{c}_y"]].to_numpy(dtype=float) for c in columns]


def gained_lost(ours: pd.DataFrame, theirs: pd.DataFrame) -> tuple[int, int, float]:
    """Pairs that only ours, or only theirs, has right; the chance of so uneven a split."""
    (right,) = paired(ours, theirs, ["right"])
    gained = int((right[:, 0] > right[:, 1]).sum())
    lost = int((right[:, 0] < right[:, 1]).sum())
    return gained, lost, sign_test(gained, lost)


def smaller_p(ours: pd.DataFrame, theirs: pd.DataFrame, column: str) -> float:
    """The chance of so uneven a split of the pairs on which ours or theirs has less of a column.

    Over the pairs that both have right.
    """
    (both,) = paired(ours[ours["right"]], theirs[theirs["right"]], [column])
    less, more = int((both[:, 0] < both[:, 1]).sum()), int((both[:, 0] > both[:, 1]).sum())
    return sign_test(less, more)


def beyond_chance(p_values: Sequence[float], level: float = 1.0 - LEVEL) -> BoolArray:
    """(n,) which tests hold at this level for all together (Holm, Scand. J. Stat. 6 (1979) 65)."""
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    passed = p[order] <= level / np.arange(len(p), 0, -1)
    first_failed = int(np.argmin(passed)) if not passed.all() else len(p)
    held = np.zeros(len(p), dtype=bool)
    held[order[:first_failed]] = True
    return held


def without_unit(name: object) -> str:
    """What a parameter or an error is called, its unit in brackets left out."""
    return str(name).partition(" (")[0]


def listed(names: Iterable[str]) -> str:
    """Names as a sentence has them; "none" of none."""
    entries = list(names)
    if len(entries) < 2:
        return entries[0] if entries else "none"
    return f"{', '.join(entries[:-1])} and {entries[-1]}"
