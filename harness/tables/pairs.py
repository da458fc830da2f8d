"""Tables 6.1 to 6.5: the six parameters of a pair, exact, as the thesis found them, and ours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from harness.config.schema import Experiment, Pair, PrintedPose, RotationLabels
from harness.file_names import file_slug
from harness.scoring.poses import PARAMETERS, parameter_errors, pose_error, pose_from_parameters
from harness.tables.table import Table, printed
from harness.trials.views import LABEL_ORDER, relabelled

NAMES = ("Rotation X (deg)", "Rotation Y (deg)", "Rotation Z (deg)",
         "Translation X (mm)", "Translation Y (mm)", "Translation Z (mm)")  # fmt: skip


def pair_tables(experiment: Experiment, rows: pd.DataFrame) -> Iterator[Table]:
    """Tables 6.1 to 6.5: the six parameters of each pair, exact, the thesis's and ours."""
    for name, pair in experiment.pairs.items():
        of_pair = rows[rows["pair"] == name]
        for label in of_pair["method"].unique():
            yield _pair_table(experiment, name, pair, of_pair[of_pair["method"] == label], label)


def _pair_table(
    experiment: Experiment, name: str, pair: Pair, rows: pd.DataFrame, label: str
) -> Table:
    first = rows.iloc[0]
    exact, theoretical, estimated, error = (
        first[[f"{kind}_{column}" for column in PARAMETERS]].to_numpy(dtype=np.float64)
        for kind in ("exact", "theoretical", "estimated", "error")
    )
    columns: dict[str, Any] = {
        "Parameter": [*NAMES, "Rotation angle (deg)", "Translation norm (mm)"]
    }
    labels = experiment.rotation_labels
    if pair.printed is not None and labels != "printed":
        printed_as = [f"Rotation ({'XYZ'[index]})" for index in LABEL_ORDER[labels]]
        columns["Label in the thesis"] = [
            *printed_as,
            *(f"Translation ({c})" for c in "XYZ"),
            "",
            "",
        ]
    columns["Exact"] = [*exact, np.nan, np.nan]
    if not np.isnan(theoretical).any():
        columns["Theoretical"] = [*theoretical, np.nan, np.nan]
    theirs = thesis_values(pair, labels)
    if theirs is not None:
        columns["Thesis's estimate"] = [*theirs[0], np.nan, np.nan]
    ours = [float(first["rotation_error_deg"]), float(first["translation_error_mm"])]
    columns["Our estimate"] = [*estimated, np.nan, np.nan]
    columns["Our error"] = [*error, *ours]
    if theirs is not None:
        columns["Thesis's error"] = theirs[1]
    known = rows.dropna(subset=["rotation_error_deg"])
    if len(rows) > 1:
        columns["Our error, all repeats"] = [
            _spread(known[column], sign)
            for column, sign in (
                *((f"error_{c}", "+") for c in PARAMETERS),
                ("rotation_error_deg", ""),
                ("translation_error_mm", ""),
            )
        ]
    caption = _pair_caption(experiment, pair, len(rows))
    if "Theoretical" in columns:
        caption += (
            " Theoretical is what the arm's encoders and the nominal tool centre point say, by "
            "(3-1), as in the thesis; what is wrong with the bracket is in the exact values only."
        )
    poses = ("Exact", "Theoretical", "Thesis's estimate", "Our estimate")
    signed = dict.fromkeys(poses, ".2f")
    signed |= dict.fromkeys(("Our error", "Thesis's error"), "+.2f")
    frame = pd.DataFrame(columns)
    kind = "Table" if pair.printed else "Pair"
    title = f"{kind} {name}: {pair.source} to {pair.target}, method {label}"
    return Table(
        f"table_{file_slug(name)}_{file_slug(label)}",
        title,
        caption,
        frame,
        {column: signed[column] for column in frame.columns if column in signed},
        _pair_note(rows, len(known)),
        norms=(len(NAMES), len(NAMES) + 1),
    )


def _pair_caption(experiment: Experiment, pair: Pair, repeats: int) -> str:
    text = (
        "Pose of the source view in the frame of the target view. Our estimate and error are those "
        "of repeat 0, the one that the figures show; an error is estimate minus exact value, the "
        "last two rows are the angle and the length of the whole error."
    )
    if repeats > 1:
        text += " All repeats: median [smallest, largest] of those with an estimate."
    if pair.printed is not None and experiment.rotation_labels != "printed":
        text += (
            " The thesis prints its large turn under a label that names another axis; its values "
            "stand beside the axis that was turned "
            f"(rotation_labels: {experiment.rotation_labels})."
        )
    return text


def _pair_note(rows: pd.DataFrame, n_known: int) -> str:
    first = rows.iloc[0]
    text = f"{n_known} of {len(rows)} repeats have an estimate."
    if not np.isnan(first["overlap_source"]):
        text += f" The target view sees {first['overlap_source']:.0%} of the source's points."
    if first["T_theoretical"] is not None:
        off_deg, off_mm = theoretical_error(first)
        text += f" The theoretical pose is {off_deg:.3f} deg and {off_mm:.2f} mm off the exact one."
    if first["status"] != "ok":
        text += f" Repeat 0: {first['status']}: {first['reason']}."
    return text


def theoretical_error(row: Mapping[Any, Any] | pd.Series[Any]) -> tuple[float, float]:
    """How far the encoders' pose of a row is off the exact one, degrees and mm.

    NaN without an arm. row: of whole rows, as store.load gives them.
    """
    if row["T_theoretical"] is None:
        return np.nan, np.nan
    poses = (RigidTransform.from_matrix(row[f"T_{kind}"]) for kind in ("exact", "theoretical"))
    error = pose_error(*poses)
    return float(np.rad2deg(error.rotation_rad)), error.translation_mm


def thesis_values(pair: Pair, labels: RotationLabels) -> tuple[list[float], list[float]] | None:
    """The six values it estimated, and its errors: six, the angle and the norm."""
    if pair.printed is None or pair.estimated is None:
        return None
    exact, estimated = (printed_six(pose, labels) for pose in (pair.printed, pair.estimated))
    poses = [pose_from_parameters(six[:3], six[3:]) for six in (exact, estimated)]
    error = pose_error(*poses)
    whole = [float(np.rad2deg(error.rotation_rad)), error.translation_mm]
    return estimated.tolist(), [*parameter_errors(exact, estimated).tolist(), *whole]


def printed_six(pose: PrintedPose, labels: RotationLabels) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(6,) the printed angles about the sensor's X, Y, Z in degrees and the translation in mm."""
    rotation_deg, translation_mm = relabelled(pose, labels)
    return np.array([*rotation_deg, *translation_mm])


def _spread(values: pd.Series[float], sign: str) -> str:
    numbers = values.astype(np.float64)
    if numbers.empty:
        return "none"
    quantiles = (numbers.min(), numbers.median(), numbers.max())
    low, middle, high = (printed(float(value), f"{sign}.2f") for value in quantiles)
    return f"{middle} [{low}, {high}]"
