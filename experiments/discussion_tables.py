"""What the rows of the discussion say: a table a question, and a sentence computed from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from experiments.discussion_trials import STAGES, DiscussionExperiment
from harness.config.schema import MethodChoice
from harness.scoring.chance import median_text, rate
from harness.scoring.poses import COARSE
from harness.scoring.row_scores import within
from harness.tables.table import Table
from harness.tables.variants import variant_tables
from registration.scan import FloatArray

# Shares of overlap; the low end belongs to its range.
EDGES = (0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.01)
ENOUGH = 0.5  # success rate from which an overlap is called enough
ON_TOP = ("gauss_sphere", "gauss_sphere, ICP on top")
RESAMPLED = 2000


def discussion_tables(
    experiment: DiscussionExperiment, rows: pd.DataFrame, turned: pd.DataFrame
) -> list[Table]:
    """The tables of all questions."""
    of = {name: rows[rows["question"] == name] for name in rows["question"].unique()}
    return [
        turned_table(turned),
        *stage_tables(of["stages"]),
        moved_table(of["moved"], experiment.moved.shift_mm),
        overlap_table(of["overlap"]),
        bracket_table(of["bracket"]),
    ]


def turned_table(turned: pd.DataFrame) -> Table:
    """Translation error against the error of the rotation it is estimated on."""
    records = []
    for (method, angle_deg), group in turned.groupby(["method", "angle_deg"], sort=False):
        known = group.dropna(subset=["translation_error_mm"])
        records.append(
            {
                "Method": method,
                "Turned by (deg)": angle_deg,
                "Trials": len(group),
                "With a translation": len(known),
                "Error (mm)": _median(known["translation_error_mm"]),
                "Error at the middle (mm)": _median(known["middle_error_mm"]),
                "Lever (mm)": float(known["lever_mm"].median()),
            }
        )
    return Table(
        "rotation_error",
        "What a rotation error does to the translation",
        "The translation stage of each method on the true rotation, turned about random axes: "
        "median and its 95 % interval. At the middle: by how much the middle of the scene is off. "
        "Lever: median by which the turn alone moves the middle, about the sensor.",
        pd.DataFrame(records),
        {"Turned by (deg)": "g", "Trials": "d", "With a translation": "d", "Lever (mm)": ".1f"},
        note=_turned_conclusion(turned),
        in_full=True,
    )


def _turned_conclusion(turned: pd.DataFrame) -> str:
    least, most = turned["angle_deg"].min(), turned["angle_deg"].max()
    sentences = []
    for method, group in turned.groupby("method", sort=False):
        medians = group.groupby("angle_deg")[
            ["translation_error_mm", "middle_error_mm", "lever_mm"]
        ].median()
        low, high = medians.loc[least], medians.loc[most]
        sentences.append(
            f"{method}: from {least:g} to {most:g} deg the translation error rises from "
            f"{low.iloc[0]:.1f} to {high.iloc[0]:.1f} mm and that at the middle of the scene from "
            f"{low.iloc[1]:.1f} to {high.iloc[1]:.1f} mm; the lever is {high.iloc[2]:.1f} mm"
        )
    share = _lever_share(turned)
    verdict = "almost all lever" if share > 0.8 else "lever in part"
    return (
        f"\n{'. '.join(sentences)}.\nWhat a rotation error adds to the translation is {verdict}: "
        f"{share:.0%} of the growth of the error is gone at the middle of the scene."
    )


def _lever_share(turned: pd.DataFrame) -> float:
    """Share of the growth of the median error that is not there at the middle of the scene."""
    grown = []
    for column in ("translation_error_mm", "middle_error_mm"):
        medians = turned.groupby(["method", "angle_deg"])[column].median().unstack("angle_deg")
        grown.append(float((medians.iloc[:, -1] - medians.iloc[:, 0]).sum()))
    return 1.0 - grown[1] / grown[0] if grown[0] > 0.0 else 0.0


def stage_tables(rows: pd.DataFrame) -> Iterator[Table]:
    """The variants of the last stages: on scans, on the true rotation; and ICP on gauss_sphere."""
    choices = [MethodChoice(name="thesis", label=label) for label in STAGES]
    for entered, title in ((False, ""), (True, ", entered with the true rotation")):
        chosen = rows[(rows["given"] != "") == entered].assign(given="")
        present = [c for c in choices if c.label in set(chosen["method"])]
        for table in variant_tables(present, chosen, random=False):
            name = "stages_true_rotation" if entered else "stages"
            yield replace(table, name=name, title=table.title + title)
    choices = [MethodChoice(name="gauss_sphere", label=label) for label in ON_TOP]
    for table in variant_tables(choices, rows, random=False):
        yield replace(table, name="icp_on_gauss_sphere")


def moved_table(rows: pd.DataFrame, shift_mm: float) -> Table:
    """Errors along X, Y and Z of views moved along Y and along Z."""
    records = []
    for method, moved, where, known in moved_errors(rows):
        record: dict[str, Any] = {"Method": method, "Moved along": moved, "Error": where}
        record["Trials"] = int(((rows["method"] == method) & (rows["value"] == moved)).sum())
        record["Answered"] = len(known)
        for axis, values in zip("XYZ", known.T, strict=True):
            low, high = rms_interval(values)
            record[f"{axis} (mm)"] = (
                f"{rms(values):.2f} [{low:.2f}, {high:.2f}]" if len(known) else ""
            )
        records.append(record)
    return Table(
        "y_against_z",
        "Error along Y against along Z",
        f"Two views of the desk, {shift_mm:g} mm apart along the axis that is named; root mean "
        "square errors with a 95 % bootstrap interval, over the answers of status ok. Of the "
        "translation as it is printed, and of where the middle of the scene comes to lie.",
        pd.DataFrame(records),
        {"Trials": "d", "Answered": "d"},
        note=_moved_conclusion(rows),
        in_full=True,
    )


def moved_errors(rows: pd.DataFrame) -> Iterator[tuple[str, str, str, FloatArray]]:
    """Method, axis moved along, where the error is taken, and (n, 3) errors in mm."""
    for (method, moved), group in rows.groupby(["method", "value"], sort=False):
        answered = group[group["status"] == "ok"]
        for where, prefix in (("translation", "error"), ("middle of the scene", "middle")):
            columns = [f"{prefix}_{axis}_mm" for axis in "xyz"]
            yield str(method), str(moved), where, answered[columns].to_numpy(dtype=np.float64)


def rms(values: FloatArray) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def rms_interval(values: FloatArray) -> tuple[float, float]:
    """The 95 % percentile interval over resampled values; NaN of fewer than two."""
    if len(values) < 2:
        return float("nan"), float("nan")
    picks = np.random.default_rng(0).integers(len(values), size=(RESAMPLED, len(values)))
    low, high = np.quantile(np.sqrt(np.mean(values[picks] ** 2, axis=1)), [0.025, 0.975])
    return float(low), float(high)


def _moved_conclusion(rows: pd.DataFrame) -> str:
    ratios: dict[tuple[str, str], list[str]] = {}
    for method, moved, where, known in moved_errors(rows):
        if len(known):
            ratio = rms(known[:, 1]) / rms(known[:, 2])
            ratios.setdefault((method, where), []).append(f"{ratio:.1f} moved along {moved}")
    said = "; ".join(
        f"{method}, {where}: {', '.join(values)}" for (method, where), values in ratios.items()
    )
    return (
        f"\nThe error along Y is so many times that along Z: {said}.\nSection 6.6 puts it down to "
        "the larger movement along Y and the finer resolution along Z; the same ratio whichever "
        "way the sensor moved speaks against the former, one that falls at the middle of the "
        "scene for the lever of the rotation error."
    )


def overlap_table(rows: pd.DataFrame) -> Table:
    """Success against the exact overlap."""
    records = []
    for scene, method, low, high, group in by_overlap(rows):
        right = int(within(group, COARSE).sum())
        records.append(
            {
                "Scene": scene,
                "Method": method,
                "Overlap": f"{low:.0%} to {min(high, 1.0):.0%}",
                "Trials": len(group),
                "Right": rate(right, len(group)),
                "Answered, but wrong": int((group["status"] == "ok").sum()) - right,
            }
        )
    return Table(
        "overlap",
        "How much overlap is needed",
        "Two views turned against each other about the vertical, which look past each other. "
        "Overlap: the smaller of the two views' exact shares of points that the other sees. "
        f"Right: of status ok, within {COARSE}, with Wilson's 95 % interval.",
        pd.DataFrame(records),
        {"Trials": "d", "Answered, but wrong": "d"},
        note=_overlap_conclusion(rows),
        in_full=True,
    )


def by_overlap(rows: pd.DataFrame) -> Iterator[tuple[str, str, float, float, pd.DataFrame]]:
    """Scene, method, range of overlap and its rows, where there are any."""
    for (scene, method), group in rows.groupby(["scene", "method"], sort=False):
        for low, high in pairwise(EDGES):
            chosen = group[(group["overlap"] >= low) & (group["overlap"] < high)]
            if len(chosen):
                yield str(scene), str(method), low, high, chosen


def enough(rows: pd.DataFrame, scene: str, method: str) -> float | None:
    """The least overlap from which on every range has at least half of its trials right."""
    least = None
    for s, m, low, _, group in reversed(list(by_overlap(rows))):
        if (s, m) == (scene, method):
            if within(group, COARSE).mean() < ENOUGH:
                break
            least = low
    return least


def _overlap_conclusion(rows: pd.DataFrame) -> str:
    said = []
    for scene in rows["scene"].unique():
        for method in rows["method"].unique():
            least = enough(rows, scene, method)
            text = "no overlap is enough" if least is None else f"from {least:.0%} on"
            said.append(f"{scene}, {method}: {text}")
    return (
        f"\nHalf of the trials and more are right: {'; '.join(said)}.\nSection 6.6 expects up to "
        "50 % for symmetric objects of few surfaces, as the foam, and much less for common ones."
    )


def bracket_table(rows: pd.DataFrame) -> Table:
    """Errors of the theoretical poses and of the estimates, against the error of the bracket."""
    records = []
    for (pair, method, times), group in rows.assign(table=table_of(rows)).groupby(
        ["table", "method", "value"], sort=False
    ):
        answered = group[group["status"] == "ok"]
        record: dict[str, Any] = {"Pair": pair, "Method": method, "Bracket times": times}
        record["Trials"], record["Answered"] = len(group), len(answered)
        for unit in ("deg", "mm"):
            record[f"Theoretical ({unit})"] = float(group[f"theoretical_{unit}"].median())
            kind = {"deg": "rotation", "mm": "translation"}[unit]
            record[f"Estimate ({unit})"] = _median(answered[f"{kind}_error_{unit}"])
        records.append(record)
    formats = {"Bracket times": "g", "Trials": "d", "Answered": "d"}
    return Table(
        "bracket",
        "What the bracket does to the theoretical values",
        "Distance from the exact pose of the theoretical one, by the encoders and the nominal tool "
        "centre point, and of the estimates of status ok: medians, those of the estimates with "
        "their 95 % interval. Bracket times: how many times as far off as in the config of the "
        "desk.",
        pd.DataFrame(records),
        formats | {"Theoretical (deg)": ".3f", "Theoretical (mm)": ".2f"},
        note=_bracket_conclusion(rows),
        in_full=True,
    )


def table_of(rows: pd.DataFrame) -> pd.Series:
    """The table of the thesis that a pair of the bracket's question is of."""
    return rows["pair"].str.partition(",")[0]


def _bracket_conclusion(rows: pd.DataFrame) -> str:
    nearer, grown = [], []
    answered = rows[rows["status"] == "ok"].assign(table=table_of(rows))
    for (method, pair), group in answered.groupby(["method", "table"], sort=False):
        medians = group.groupby("value")[["theoretical_mm", "translation_error_mm"]].median()
        better = medians["theoretical_mm"] > medians["translation_error_mm"]
        times = ", ".join(f"{value:g}" for value in medians.index[better]) or "none"
        nearer.append(f"{method}, table {pair}: {times}")
        first, last = medians["translation_error_mm"].iloc[[0, -1]]
        grown.append(f"{method}, table {pair}: {first:.1f} to {last:.1f} mm")
    return (
        "\nTimes the bracket at which the estimate is nearer to the truth than the theoretical "
        f"pose: {'; '.join(nearer)}.\nThe estimates suffer too, as the turned bracket shears the "
        f"scans; from the least to the largest that is answered, {'; '.join(grown)}."
    )


def _median(values: pd.Series) -> str:
    return median_text(values.dropna().to_numpy(dtype=np.float64))
