"""The answer of an experiment: how often right, how exact, how fast, beside thesis and peers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness.config.reading import AnyExperiment
from harness.config.schema import Experiment
from harness.scoring.chance import rate, wilson_interval
from harness.scoring.poses import COARSE, FINE
from harness.scoring.row_scores import ERRORS, observed_quantile, within
from harness.tables.pairs import thesis_values
from harness.tables.table import Table
from registration.peers import PEERS

OURS = "gauss_sphere"
COUNT, ROTATION, TRANSLATION, TIME = (
    "Trials", "Median rotation error (deg)", "Median translation error (mm)", "Median time (ms)",
)  # fmt: skip


class Score(NamedTuple):
    """What one method achieved; a median over all trials, infinite where most have no answer."""

    label: str
    trials: int
    right: int
    fine: int
    rotation_deg: float
    translation_mm: float
    time_ms: float


def scores(rows: pd.DataFrame) -> list[Score]:
    """By method, over the trials of the whole method; rows as store.load gives them."""
    found = []
    for label, group in rows[rows["given"] == ""].groupby("method", sort=False):
        errors = group[list(ERRORS)].astype(np.float64)
        known = errors.where(group["status"] == "ok", np.inf).fillna(np.inf)
        found.append(
            Score(
                str(label),
                len(group),
                int(within(group, COARSE).sum()),
                int(within(group, FINE).sum()),
                observed_quantile(known["rotation_error_deg"].to_numpy(), 0.5),
                observed_quantile(known["translation_error_mm"].to_numpy(), 0.5),
                float(group["ms_registration"].median()),
            )
        )
    return found


def thesis_score(experiment: AnyExperiment) -> Score | None:
    """What the thesis printed of the same pairs; None where it printed nothing."""
    if not isinstance(experiment, Experiment):
        return None
    values = [thesis_values(pair, experiment.rotation_labels) for pair in experiment.pairs.values()]
    errors = np.array([value[1][-2:] for value in values if value is not None])
    if not len(errors):
        return None
    right, fine = (
        int(((errors[:, 0] <= t.rotation_deg) & (errors[:, 1] <= t.translation_mm)).sum())
        for t in (COARSE, FINE)
    )
    angle_deg, length_mm = (observed_quantile(each, 0.5) for each in errors.T)
    return Score("The thesis, as printed", len(errors), right, fine, angle_deg, length_mm, np.nan)


def answer_table(experiment: AnyExperiment, rows: pd.DataFrame) -> Table:
    """One line a method, and one for what the thesis printed."""
    printed = thesis_score(experiment)
    lines = scores(rows) + ([printed] if printed is not None else [])
    records: list[dict[str, Any]] = []
    for score in lines:
        record: dict[str, Any] = {"Method": score.label, COUNT: score.trials}
        for tolerance, right in ((COARSE, score.right), (FINE, score.fine)):
            record[f"Within {tolerance}"] = rate(right, score.trials)
        record |= {
            ROTATION: score.rotation_deg, TRANSLATION: score.translation_mm, TIME: score.time_ms,
        }  # fmt: skip
        records.append(record)
    return Table(
        "answer",
        "Method by method",
        "Answers marked ok and within both tolerances, of all trials, with Wilson's 95 % interval "
        "of the rate. Medians are over all trials; none where most gave no answer. Time is that of "
        "the registration alone, one core.",
        pd.DataFrame(records),
        {COUNT: "d", ROTATION: ".3f", TRANSLATION: ".2f", TIME: ".0f"},
    )


def main_label(experiment: AnyExperiment) -> str:
    """The method that the answer is about: this project's, else the first one that is no peer."""
    choices = sorted(
        experiment.methods, key=lambda choice: (choice.name != OURS, choice.name in PEERS)
    )
    return choices[0].called


def answer_sentence(experiment: AnyExperiment, rows: pd.DataFrame) -> str:
    """The answer in a sentence: the method of this project, the thesis, the best other library."""
    names = {choice.called: choice.name for choice in experiment.methods}
    found = scores(rows)
    label = main_label(experiment)
    main = next((score for score in found if score.label == label), found[0])
    low, high = wilson_interval(main.right, main.trials)
    text = (
        f"{main.label} registered {main.right} of {main.trials} trials within "
        f"{COARSE.rotation_deg:g}° and {COARSE.translation_mm:g} mm (95 % interval {low:.0%} to "
        f"{high:.0%})"
    )
    if np.isfinite(main.rotation_deg):
        text += f", median error {_error(main)}"
    if np.isfinite(main.time_ms):
        text += f", in {main.time_ms:.0f} ms each"
    others = []
    printed = thesis_score(experiment)
    if printed is not None:
        several = f", the median of {printed.trials} pairs" if printed.trials > 1 else ""
        others.append(f"the thesis printed {_error(printed)}{several}")
    peers = [score for score in found if names.get(score.label) in PEERS and score is not main]
    if peers:
        best = max(peers, key=lambda score: (score.right, -score.translation_mm))
        others.append(
            f"the best of {len(peers)} other libraries, {best.label}, registered {best.right} of "
            f"{best.trials}" if len(peers) > 1
            else f"{best.label}, another library, registered {best.right} of {best.trials}"
        )  # fmt: skip
    return "; ".join([text, *others]) + "."


def _error(score: Score) -> str:
    return f"{score.rotation_deg:.2g}° and {score.translation_mm:.2g} mm"
