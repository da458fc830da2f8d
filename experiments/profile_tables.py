"""The tables of an experiment on pairs of profiles (section 6.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from experiments.profile_means import CUTOFF, MOTION, mean_motion, middle, wrapped_deg
from experiments.profile_pairs import ProfilesExperiment
from harness.config.schema import Experiment, Pair, PrintedPose
from harness.file_names import file_slug
from harness.tables.table import Table
from harness.trials.views import relabelled
from registration.scan import FloatArray

NAMES = ("Rotation X (deg)", "Translation Y (mm)", "Translation Z (mm)")
ERRORS = ("Rotation error (deg)", "Y error (mm)", "Z error (mm)")
RULE = (
    f"An outlier has a rotation, Y or Z beyond {CUTOFF:g} / 0.6745 median absolute deviations from "
    "the median of the answers."
)
THESIS_KEPT, THESIS_PAIRS, THESIS_SECONDS = 42, 44, 8.0  # section 6.2


def profile_tables(experiment: ProfilesExperiment, rows: pd.DataFrame) -> list[Table]:
    """Means of each pair of views beside the thesis's, their spread over repeats, and what fails.

    rows: as profile_pairs.measure gives them.
    """
    tables = []
    for name, pair in experiment.pairs.items():
        of_pair = rows[rows["pair"] == name]
        tables.append(mean_table(name, pair, experiment, of_pair))
        if experiment.repeats > 1:
            tables.append(repeat_table(name, of_pair))
        tables.append(outcome_table(name, of_pair))
    return tables


def mean_table(name: str, pair: Pair, experiment: ProfilesExperiment, rows: pd.DataFrame) -> Table:
    """The mean motion of repeat 0 by method, beside the exact one and the thesis's."""
    exact = middle(rows[[f"exact_{m}" for m in MOTION]].to_numpy(dtype=np.float64))
    records = [_record("exact", exact, None)]
    if pair.printed is not None and pair.estimated is not None:
        printed, estimated = (printed_motion(p, experiment) for p in (pair.printed, pair.estimated))
        records.append(_record("thesis, experiment", estimated, estimated - printed))
        records[-1]["In the mean"] = f"{THESIS_KEPT} of {THESIS_PAIRS}"
        records[-1]["All pairs (s)"] = THESIS_SECONDS
    for method, group in rows[rows["repeat"] == 0].groupby("method", sort=False):
        mean = mean_motion(group)
        record = _record(str(method), mean, mean - exact)
        record["Answered"] = f"{_answered(group).sum()} of {len(group)}"
        record["In the mean"] = f"{_used(group).sum()} of {len(group)}"
        # The first repeat waits for compiled code to be loaded.
        of_method = rows[rows["method"] == method]
        record["All pairs (s)"] = float(of_method.groupby("repeat")["ms"].sum().median()) / 1e3
        records.append(record)
    frame = pd.DataFrame(records)[
        ["", "Answered", "In the mean", *NAMES, *ERRORS, "All pairs (s)"]
    ].rename(columns={"": "Source"})
    formats = dict.fromkeys(NAMES, ".2f") | dict.fromkeys(ERRORS, "+.2f")
    return Table(
        f"profiles_{file_slug(name)}",
        f"Pair {name}: {pair.source} to {pair.target} by single profiles, mean",
        "Each pair of profiles is registered by itself in its laser plane; mean over those "
        f"answered and no outliers, repeat 0. {RULE} The thesis's error is against its own "
        "encoders; it does not say by which rule it left two pairs out.",
        frame,
        formats | {"All pairs (s)": ".2f"},
    )


def repeat_table(name: str, rows: pd.DataFrame) -> Table:
    """Median and 95 % interval of the error of the mean, over the repeats."""
    records = []
    for method, of_method in rows.groupby("method", sort=False):
        groups = [group for _, group in of_method.groupby("repeat")]
        exact = middle(groups[0][[f"exact_{m}" for m in MOTION]].to_numpy(dtype=np.float64))
        errors = np.array([mean_motion(group) for group in groups]) - exact
        errors[:, 0] = wrapped_deg(errors[:, 0])
        single = of_method[_used(of_method)]
        record: dict[str, Any] = {"Method": method, "Repeats": len(groups)}
        record["Answered"] = f"{_answered(of_method).mean():.0%}"
        record["In the mean"] = f"{_used(of_method).mean():.0%}"
        for column, values in zip(ERRORS, errors.T, strict=True):
            known = values[np.isfinite(values)]
            if len(known):
                low, median, high = np.quantile(known, [0.025, 0.5, 0.975])
                record[column] = f"{median:+.2f} [{low:+.2f}, {high:+.2f}]"
            else:
                record[column] = "none"
        record["Single pair, rotation (deg)"] = single["rotation_error_deg"].median()
        record["Single pair, translation (mm)"] = single["translation_error_mm"].median()
        records.append(record)
    return Table(
        f"profiles_{file_slug(name)}_repeats",
        f"Pair {name}: error of the mean over the repeats",
        "Median and 95 % interval over the repeats, each with noise of its own; what the interval "
        "leaves of 0 is bias. Single pair: median error of one pair of profiles in the mean, with "
        "what an arm's bracket tilts and shifts out of the plane. "
        "Shares are of all pairs of profiles.",
        pd.DataFrame(records),
        {"Repeats": "d", "Single pair, rotation (deg)": ".2f",
         "Single pair, translation (mm)": ".2f"},
    )  # fmt: skip


def outcome_table(name: str, rows: pd.DataFrame) -> Table:
    """What became of the pairs of profiles of repeat 0 that are not in the mean, and where."""
    records = []
    first = rows[rows["repeat"] == 0]
    far = "far from the others"
    why = first["reason"].where(~first["outlier"], far).where(~_used(first), "")
    # Shares and angles differ from pair to pair; the kind of failure does not.
    kind = why.str.replace(r"\d+%|\d+ mm|\d+ degrees", "...", regex=True)
    for (method, _), group in first[why != ""].groupby(["method", kind], sort=False):
        heights, reason = group["elevation_mm"], why[group.index[0]]
        records.append(
            {
                "Method": method,
                "Status": "outlier" if reason == far else group["status"].iloc[0],
                "Pairs": len(group),
                "Profiles": ranges(group["profile"].tolist()),
                "Elevation (mm)": f"{heights.min():.0f} to {heights.max():.0f}",
                "Reason (of the first)": reason,
            }
        )
    columns = ["Method", "Status", "Pairs", "Profiles", "Elevation (mm)", "Reason (of the first)"]
    return Table(
        f"profiles_{file_slug(name)}_left_out",
        f"Pair {name}: pairs of profiles that are not in the mean, repeat 0",
        RULE,
        pd.DataFrame(records, columns=columns),
        {"Pairs": "d"},
    )


def _record(source: str, motion: FloatArray, error: FloatArray | None) -> dict[str, Any]:
    record: dict[str, Any] = {"": source, "Answered": "", "In the mean": ""}
    record |= dict(zip(NAMES, motion.tolist(), strict=True))
    if error is not None:
        turned = [wrapped_deg(error[0]), *error[1:]]
        record |= dict(zip(ERRORS, map(float, turned), strict=True))
    return record


def printed_motion(pose: PrintedPose, experiment: Experiment) -> FloatArray:
    """(3,) turn about X in degrees, Y and Z in mm of a printed pose."""
    rotation_deg, translation_mm = relabelled(pose, experiment.rotation_labels)
    return np.array([rotation_deg[0], *translation_mm[1:]])


def _answered(rows: pd.DataFrame) -> pd.Series[bool]:
    return rows[MOTION[0]].notna()


def _used(rows: pd.DataFrame) -> pd.Series[bool]:
    return _answered(rows) & ~rows["outlier"]


def ranges(numbers: list[int]) -> str:
    """Sorted whole numbers with runs written as first-last."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1][1:] = [number]
        else:
            parts.append([number])
    return ", ".join("-".join(map(str, part)) for part in parts)
