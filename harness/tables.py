"""The tables of an experiment, from its rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from harness.multiview import loop_tables
from harness.pair_tables import pair_tables
from harness.schema import Experiment
from harness.scoring import COARSE, FINE, PoseError, Tolerance, is_success, wilson_interval
from harness.table_files import Table
from harness.view_tables import compaction_table

ENTRIES = {
    "": "scans (the whole method)",
    "segments": "true segments",
    "patches": "true patches",
    "shared_patches": "true patches, only what both views see",
    "rotation": "true rotation, found patches",
}


def all_tables(experiment: Experiment, rows: pd.DataFrame) -> list[Table]:
    """Every table there are rows for: stages, successes, accuracy, failures, views, pairs, times.

    rows: as store.load gives them.
    """
    whole = rows[rows["given"] == ""]
    tables = [success_table(whole), accuracy_table(whole)]
    if len(rows) > len(whole):
        tables.insert(0, stage_table(rows))
    failures = failure_table(rows)
    if len(failures.frame):
        tables.append(failures)
    compaction = compaction_table(experiment, whole)
    if compaction is not None:
        tables.append(compaction)
    tables += loop_tables(experiment, whole)
    return [*tables, *pair_tables(experiment, whole), timing_table(whole)]


def success_table(rows: pd.DataFrame) -> Table:
    """How often each method is right, by pair, with Wilson's interval."""
    records = []
    for (pair, method), group in rows.groupby(["pair", "method"], sort=False):
        record: dict[str, Any] = {"Pair": pair, "Method": method, "Trials": len(group)}
        record["Answered"] = int((group["status"] == "ok").sum())
        for tolerance in (COARSE, FINE):
            successes = int(_successes(group, tolerance).sum())
            low, high = wilson_interval(successes, len(group))
            column = f"Within {tolerance.rotation_deg:g} deg and {tolerance.translation_mm:g} mm"
            record[column] = f"{successes}/{len(group)} [{low:.0%}, {high:.0%}]"
        records.append(record)
    return Table(
        "success",
        "Successes",
        "Answers of status ok within both tolerances, of all trials, with Wilson's 95 % interval "
        "of the rate.",
        pd.DataFrame(records),
        {"Trials": "d", "Answered": "d"},
    )


def accuracy_table(rows: pd.DataFrame) -> Table:
    """Quantiles of the errors, over the successes and over all trials."""
    records = []
    for (pair, method), group in rows.groupby(["pair", "method"], sort=False):
        errors = group[["rotation_error_deg", "translation_error_mm"]].astype(np.float64)
        for over, chosen in (
            ("successes", errors[_successes(group, COARSE)]),
            ("all trials", errors.fillna(np.inf)),
        ):
            record: dict[str, Any] = {
                "Pair": pair,
                "Method": method,
                "Over": over,
                "n": len(chosen),
            }
            for column, unit in (("rotation_error_deg", "deg"), ("translation_error_mm", "mm")):
                kind = column.split("_")[0]
                for name, q in (("median", 0.5), ("90 %", 0.9)):
                    values = chosen[column].to_numpy()
                    # An observed value, not one between two: half of infinity means nothing.
                    record[f"{kind} {name} ({unit})".capitalize()] = (
                        float(np.quantile(values, q, method="higher")) if len(values) else np.nan
                    )
            records.append(record)
    frame = pd.DataFrame(records)
    return Table(
        "accuracy",
        "Errors",
        "Angle and length of the error, median and 90 % quantile. A success is within "
        f"{COARSE.rotation_deg:g} deg and {COARSE.translation_mm:g} mm; over all trials, one "
        "without an estimate counts as infinite and prints as none.",
        frame,
        {"n": "d"} | dict.fromkeys(frame.columns[4:], ".2f"),
    )


def stage_table(rows: pd.DataFrame) -> Table:
    """Where accuracy is lost: the method entered with the truth at one stage after the other."""
    records = []
    for (pair, method, given), group in rows.groupby(["pair", "method", "given"], sort=False):
        record: dict[str, Any] = {
            "Pair": pair,
            "Method": method,
            "Entered with": ENTRIES[str(given)],
        }
        answered = group[group["status"] == "ok"]
        record["Answered"] = f"{len(answered)}/{len(group)}"
        record["Rotation error (deg)"] = answered["rotation_error_deg"].astype(np.float64).median()
        record["Translation error (mm)"] = (
            answered["translation_error_mm"].astype(np.float64).median()
        )
        for what in ("patches", "normals"):
            counts = [group.get(f"n_{what}_{role}", pd.Series(dtype=float)).median()
                      for role in ("source", "target")]  # fmt: skip
            known = not any(np.isnan(counts))
            record[what.capitalize()] = f"{counts[0]:.0f}, {counts[1]:.0f}" if known else ""
        reasons = group.loc[group["status"] != "ok", "reason"]
        record["If not answered, why"] = reasons.iloc[0] if len(reasons) else ""
        records.append(record)
    return Table(
        "stages",
        "Where accuracy is lost",
        "The method with the truth in place of what its stages find: what one row loses against "
        "the next deeper entry is lost in between. Medians over the trials answered; patches and "
        "normals of source, target. True segments and patches hold no noise: one trial tells. The "
        "method lays centroids on each other, and those of the parts of a face that two views see "
        "differ; cut to what both see, they nearly agree.",
        pd.DataFrame(records),
        {"Rotation error (deg)": ".3f", "Translation error (mm)": ".2f"},
    )


def failure_table(rows: pd.DataFrame) -> Table:
    """Every trial without a success, each to be replayed by its id."""
    failed = rows[~_successes(rows, COARSE)]
    records = [
        {
            "Trial": row["id"],
            "Pair": row["pair"],
            "Method": row["method"],
            "Entered with": ENTRIES[row["given"]],
            "Repeat": row["repeat"],
            "Status": row["status"],
            "Reason": row["reason"]
            or f"off by {row['rotation_error_deg']:.2f} deg, {row['translation_error_mm']:.1f} mm",
        }
        for _, row in failed.iterrows()
    ]
    return Table(
        "failures",
        "Trials without a success",
        "Replay one with --trial and its id.",
        pd.DataFrame(records),
        {"Repeat": "d"},
    )


def timing_table(rows: pd.DataFrame) -> Table:
    """Wall time of each stage, by pair and method, in ms."""
    stages = [column for column in rows.columns if column.startswith("ms_")]
    stages.sort(key=lambda column: column == "ms_registration")  # the total comes last
    columns: dict[str, Any] = {"Stage": [name[3:].replace("_", " ") for name in stages]}
    for (pair, method), group in rows.groupby(["pair", "method"], sort=False):
        columns[f"{pair} {method} (ms)"] = [
            float(group[name].astype(np.float64).median()) for name in stages
        ]
    frame = pd.DataFrame(columns)
    return Table(
        "timings",
        "Time by stage",
        "Median over the repeats, one core; registration is the whole method. Scan and overlap are "
        "the simulation's, and next to nothing where another trial had made them.",
        frame,
        dict.fromkeys(frame.columns[1:], ".1f"),
    )


def _successes(rows: pd.DataFrame, tolerance: Tolerance) -> pd.Series[bool]:
    """Which rows are answered and within the tolerance."""
    flags = [
        status == "ok" and is_success(PoseError(float(np.deg2rad(angle)), float(length)), tolerance)
        for status, angle, length in zip(
            rows["status"], rows["rotation_error_deg"], rows["translation_error_mm"], strict=True
        )
    ]
    return pd.Series(flags, index=rows.index, dtype=bool)
