"""The tables of an experiment, from its rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from harness.config.schema import Experiment, Pair
from harness.scoring.chance import rate
from harness.scoring.face_gaps import FaceGaps, gaps_in_words
from harness.scoring.multiview import loop_tables
from harness.scoring.poses import COARSE, FINE
from harness.scoring.row_scores import ERRORS, error_quantiles, within
from harness.tables.notes import with_notes
from harness.tables.pairs import pair_tables, thesis_values
from harness.tables.table import Table
from harness.tables.views import compaction_table

WRONG = "Answered, but wrong"

ENTRIES = {
    "": "scans (the whole method)",
    "segments": "true segments",
    "patches": "true patches",
    "shared_patches": "true patches, only what both views see",
    "rotation": "true rotation, found patches",
}


def all_tables(
    experiment: Experiment, rows: pd.DataFrame, gaps: Mapping[str, FaceGaps] | None = None
) -> list[Table]:
    """Every table there are rows for: stages, successes, accuracy, failures, views, pairs, times.

    rows: as store.load gives them. gaps: by pair, how far apart its views see the same faces.
    """
    whole = rows[rows["given"] == ""]
    tables = [success_table(whole), accuracy_table(whole)]
    if len(rows) > len(whole):
        tables.insert(0, stage_table(experiment, rows, gaps or {}))
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
        answered = group["status"] == "ok"
        record["Answered"] = int(answered.sum())
        record[WRONG] = int((answered & ~within(group, COARSE)).sum())
        for tolerance in (COARSE, FINE):
            successes = int(within(group, tolerance).sum())
            record[f"Within {tolerance}"] = rate(successes, len(group))
        records.append(record)
    return Table(
        "success",
        "Successes",
        "Answers of status ok within both tolerances, of all trials, with Wilson's 95 % interval "
        f"of the rate. {WRONG}: of status ok, yet beyond {COARSE.rotation_deg:g} deg or "
        f"{COARSE.translation_mm:g} mm.",
        pd.DataFrame(records),
        {"Trials": "d", "Answered": "d", WRONG: "d"},
        in_full=True,
    )


def accuracy_table(rows: pd.DataFrame) -> Table:
    """Quantiles of the errors, over the successes and over all trials."""
    records = []
    for (pair, method), group in rows.groupby(["pair", "method"], sort=False):
        errors = group[list(ERRORS)].astype(np.float64)
        for over, chosen in (
            ("successes", errors[within(group, COARSE)]),
            ("all trials", errors.fillna(np.inf)),
        ):
            record = {"Pair": pair, "Method": method, "Over": over, "n": len(chosen)}
            records.append(record | error_quantiles(chosen))
    frame = pd.DataFrame(records)
    return Table(
        "accuracy",
        "Errors",
        f"Angle and length of the error, median and 90 % quantile. A success is within {COARSE}; "
        "over all trials, one without an estimate counts as infinite and prints as none.",
        frame,
        {"n": "d"} | dict.fromkeys(frame.columns[4:], ".2f"),
        in_full=True,
    )


def stage_table(experiment: Experiment, rows: pd.DataFrame, gaps: Mapping[str, FaceGaps]) -> Table:
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
        "The method with the truth in place of what its stages find. An error that falls with a "
        "deeper entry points at the stages left out; it may also rise, as the stages that remain "
        "then work on other patches, and errors of several stages may have cancelled. Medians over "
        "the trials answered; patches and normals of source, target. True segments and patches "
        "hold no noise: one trial tells. The method lays centroids on each other, so what parts "
        "those of one face goes into its translation.",
        pd.DataFrame(records),
        {"Rotation error (deg)": ".3f", "Translation error (mm)": ".2f"},
        "".join(
            f"\nPair {name}: {text}"
            for name, pair in experiment.pairs.items()
            if (text := _why(experiment, pair, rows[rows["pair"] == name], gaps.get(name)))
        ),
        in_full=True,
    )


def _why(experiment: Experiment, pair: Pair, rows: pd.DataFrame, gaps: FaceGaps | None) -> str:
    """What parts the centroids of a pair, and which methods entered are worse than the thesis."""
    sentences = [] if gaps is None else [gaps_in_words(gaps)]
    theirs = thesis_values(pair, experiment.rotation_labels)
    if theirs is not None:
        printed_mm = theirs[1][-1]
        for method in rows.loc[rows["given"] != "", "method"].unique():
            whole = rows[(rows["method"] == method) & (rows["given"] == "")]
            answered = whole.loc[whole["status"] == "ok", "translation_error_mm"]
            off_mm = float(answered.astype(np.float64).median()) if len(answered) else np.nan
            if off_mm > printed_mm:
                sentences.append(
                    f"On scans, {method} is {off_mm:.1f} mm off, more than the thesis printed "
                    f"({printed_mm:.1f} mm)."
                )
    return " ".join(sentence for sentence in sentences if sentence)


def failure_table(rows: pd.DataFrame) -> Table:
    """Every trial without a success, each to be replayed by its id."""
    failed = rows[~within(rows, COARSE)]
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
        with_notes(pd.DataFrame(records), failed),
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
