"""The tables of an experiment on random pairs: how often right, how exact, how sure, how fast."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import chi2

from harness.scoring.chance import wilson_interval
from harness.scoring.normalised_errors import COUNTED, bound_ratios, squared_distances
from harness.scoring.poses import COARSE, FINE
from harness.scoring.row_scores import ERRORS, error_quantiles, within
from harness.tables.notes import with_notes
from harness.tables.pairs import NAMES
from harness.tables.random_groups import THRESHOLDS, banded, grouped, with_family
from harness.tables.table import Table

LEVELS = (0.5, 0.9, 0.99)


def random_tables(rows: pd.DataFrame) -> list[Table]:
    """Every table of a run; rows as store.load gives them."""
    known = with_family(rows)
    tables = [
        success_table(known),
        accuracy_table(known),
        curve_table(known),
        bound_table(known),
        calibration_table(known),
        time_table(known),
        status_table(known),
        wrong_table(known),
    ]
    return [table for table in tables if len(table.frame)]


def success_table(rows: pd.DataFrame) -> Table:
    """How often each method is right, by family and overlap, with Wilson's interval."""
    records = []
    for family, method, band, group in banded(rows):
        record: dict[str, Any] = {"Scenes": family, "Method": method, "Overlap": band.name}
        record["Pairs"] = len(group)
        for tolerance in (FINE, COARSE):
            right = int(within(group, tolerance).sum())
            low, high = wilson_interval(right, len(group))
            record[f"Within {tolerance}"] = f"{right / len(group):.1%} [{low:.1%}, {high:.1%}]"
        record["Marked ok"] = int((group["status"] == "ok").sum())
        record["of these wrong"] = record["Marked ok"] - int(within(group, COARSE).sum())
        records.append(record)
    return Table(
        "success",
        "Successes",
        "Answers marked ok and within both tolerances, of all pairs, with Wilson's 95 % interval. "
        "Overlap is the smaller of the two views' shares of points that the other sees. A wrong "
        f"answer marked ok is beyond {COARSE.rotation_deg:g} deg or {COARSE.translation_mm:g} mm.",
        pd.DataFrame(records),
        dict.fromkeys(("Pairs", "Marked ok", "of these wrong"), "d"),
        note=_left_out(rows),
    )


def _left_out(rows: pd.DataFrame) -> str:
    """How many trials stand in no band, as nobody knows their overlap."""
    count = int(rows["overlap"].isna().sum())
    told = f"{count} of {len(rows)} trials are not counted: they ended before their pair was drawn."
    return told if count else ""


def curve_table(rows: pd.DataFrame) -> Table:
    """Success rate against the tolerance, by family, method and overlap."""
    records = []
    for family, method, band, group in banded(rows):
        for tolerance in THRESHOLDS:
            right = int(within(group, tolerance).sum())
            low, high = wilson_interval(right, len(group))
            records.append(
                {
                    "Scenes": family, "Method": method, "Overlap": band.name,
                    "Pairs": len(group), "Within (deg)": tolerance.rotation_deg,
                    "and (mm)": tolerance.translation_mm, "Rate": right / len(group),
                    "Low": low, "High": high,
                }
            )  # fmt: skip
    formats = dict.fromkeys(("Rate", "Low", "High"), ".3f")
    return Table(
        "curves",
        "Success against the tolerance",
        "The points of the figure random_success.png, with Wilson's 95 % interval.",
        pd.DataFrame(records),
        {"Pairs": "d", "Within (deg)": ".3g", "and (mm)": ".3g"} | formats,
    )


def accuracy_table(rows: pd.DataFrame) -> Table:
    """Quantiles of the errors, over the successes and over all pairs."""
    records = []
    for family, method, group in grouped(rows):
        errors = group[list(ERRORS)].astype(np.float64)
        answered = errors.where(group["status"] == "ok", np.inf).fillna(np.inf)
        for over, values in (("successes", errors[within(group, COARSE)]), ("all", answered)):
            record = {"Scenes": family, "Method": method, "Over": over, "Pairs": len(values)}
            records.append(record | error_quantiles(values))
    frame = pd.DataFrame(records)
    return Table(
        "accuracy",
        "Errors",
        f"Median and 90 % quantile over the successes within {COARSE}, and over all pairs, where "
        "one without an answer marked ok counts as infinite and prints as none.",
        frame,
        {"Pairs": "d"} | dict.fromkeys(frame.columns[4:], ".3f"),
    )


def bound_table(rows: pd.DataFrame) -> Table:
    """Errors against the Cramer-Rao bound, parameter by parameter."""
    records = []
    for family, method, of_method in grouped(rows):
        right = of_method[within(of_method, COARSE)]
        for which, counted in enumerate(COUNTED):
            ratios = bound_ratios(right, which)
            if not len(ratios):
                continue
            for statistic, values in (
                ("root mean square", np.sqrt(np.mean(ratios**2, axis=0))),
                # Of a normal distribution the median of |x| is 0.6745 standard deviations.
                ("by the median", np.median(np.abs(ratios), axis=0) / 0.674489750196),
            ):
                record: dict[str, Any] = {
                    "Scenes": family, "Method": method, "Bound from": counted,
                    "Error": statistic, "Pairs": len(ratios),
                }  # fmt: skip
                records.append(record | dict(zip(NAMES, values.tolist(), strict=True)))
    return Table(
        "bound",
        "Errors in units of the Cramer-Rao bound",
        f"1 is what no unbiased method can beat. Over the successes within {COARSE}, each error "
        "divided by the bound of its own pair: the root of the mean square, which single outliers "
        "decide, and the median, scaled to be the same for normal errors. The bound counts the "
        "noise, not the sensor's bulge.",
        pd.DataFrame(records),
        {"Pairs": "d"} | dict.fromkeys(NAMES, ".2f"),
    )


def calibration_table(rows: pd.DataFrame) -> Table:
    """Whether covariances are as large as the errors."""
    records = []
    for family, method, of_method in grouped(rows):
        answered = of_method[of_method["status"] == "ok"]
        for over, group in (
            ("marked ok", answered),
            ("successes", answered[within(answered, COARSE)]),
        ):
            distances = squared_distances(group)
            if not len(distances):
                continue
            record: dict[str, Any] = {"Scenes": family, "Method": method, "Over": over}
            record["Pairs"] = len(distances)
            record["NEES mean"] = float(distances.mean())
            record["NEES median"] = float(np.median(distances))
            for level in LEVELS:
                record[f"Inside {level:.0%}"] = float((distances <= chi2.ppf(level, 6)).mean())
            records.append(record)
    shares = dict.fromkeys((f"Inside {level:.0%}" for level in LEVELS), ".1%")
    return Table(
        "calibration",
        "Covariances against errors",
        "NEES is the squared error in units of the covariance that the method gave: 6 in the mean "
        "and 5.35 in the median if it is right, less where it is too cautious. Inside: share of "
        "the errors within the ellipsoid that should hold so many.",
        pd.DataFrame(records),
        {"Pairs": "d", "NEES mean": ".3g", "NEES median": ".3g"} | shares,
    )


def time_table(rows: pd.DataFrame) -> Table:
    """Wall time of each stage of a method."""
    stages = [c for c in rows.columns if c.startswith("ms_") and c not in ("ms_scan", "ms_overlap")]
    records = []
    for family, method, group in grouped(rows):
        for stage in sorted(stages, key=lambda column: column == "ms_registration"):
            times = group[stage].dropna().astype(np.float64)
            if times.empty:
                continue
            name = "whole method" if stage == "ms_registration" else stage[3:].replace("_", " ")
            records.append(
                {
                    "Scenes": family, "Method": method, "Stage": name, "Pairs": len(times),
                    "Median (ms)": times.median(), "90 % (ms)": times.quantile(0.9),
                    "Largest (ms)": times.max(),
                }
            )  # fmt: skip
    frame = pd.DataFrame(records)
    formats = dict.fromkeys(("Median (ms)", "90 % (ms)", "Largest (ms)"), ".1f")
    return Table(
        "times",
        "Time by stage",
        "While as many processes ran as the command was given; benchmarks/pairs.py compares "
        "methods on a machine that does nothing else.",
        frame,
        {"Pairs": "d"} | formats,
    )


def status_table(rows: pd.DataFrame) -> Table:
    """What the methods answered, and how often that answer would have been right."""
    records = []
    for family, method, of_method in grouped(rows):
        for status, group in of_method.groupby("status"):
            near = (group["rotation_error_deg"] <= COARSE.rotation_deg) & (
                group["translation_error_mm"] <= COARSE.translation_mm
            )
            reasons = group["reason"].str.replace(r"\d+(\.\d+)?", "N", regex=True).value_counts()
            records.append(
                {
                    "Scenes": family, "Method": method, "Status": status, "Pairs": len(group),
                    "With a pose": int(group["rotation_error_deg"].notna().sum()),
                    "that was right": int(near.sum()),
                    "Most frequent reason": "" if status == "ok" else str(reasons.index[0]),
                }
            )  # fmt: skip
    return Table(
        "statuses",
        "Answers by status",
        f"Right is within {COARSE}; numbers in reasons are replaced by N.",
        pd.DataFrame(records),
        dict.fromkeys(("Pairs", "With a pose", "that was right"), "d"),
    )


def wrong_table(rows: pd.DataFrame) -> Table:
    """Every wrong answer that was marked ok, and every error of the program."""
    wrong = rows[((rows["status"] == "ok") & ~within(rows, COARSE)) | (rows["status"] == "error")]
    frame = wrong[
        ["id", "pair", "method", "overlap", "rotation_error_deg", "translation_error_mm", "reason"]
    ]
    frame = frame.set_axis(
        ["Trial", "Pair", "Method", "Overlap", "Rotation (deg)", "Translation (mm)", "Reason"],
        axis=1,
    )
    return Table(
        "wrong",
        "Wrong answers marked ok",
        f"Beyond {COARSE.rotation_deg:g} deg or {COARSE.translation_mm:g} mm, or an error of the "
        "program. Replay one with --trial and its id.",
        with_notes(frame, wrong),
        {"Overlap": ".2f", "Rotation (deg)": ".2f", "Translation (mm)": ".1f"},
    )
