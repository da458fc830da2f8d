"""Section 6.2 in the summary of chapter 6: the mean over the pairs of profiles, by method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from experiments.medians import median_of
from experiments.profile_losses import loss_table
from experiments.profile_means import MOTION, mean_motion, middle
from experiments.profile_tables import (
    NAMES,
    THESIS_KEPT,
    THESIS_PAIRS,
    THESIS_SECONDS,
    printed_motion,
)
from harness.config.schema import Experiment
from harness.scoring import six_parameters
from harness.tables.table import Table
from harness.trials.specs import Trial, full_specs
from registration.scan import FloatArray
from sensors.arm import ArmPath


def profile_summary(
    experiment: Experiment, trials: Sequence[Trial], rows: pd.DataFrame
) -> list[Table]:
    """Two tables: exact, by encoders, the thesis's and each method's mean; what is left out.

    rows: as profile_pairs.measure gives them.
    """
    frames: list[pd.DataFrame] = []
    for name, pair in experiment.pairs.items():
        of_pair = rows[rows["pair"] == name]
        exact = middle(of_pair[[f"exact_{m}" for m in MOTION]].to_numpy(dtype=np.float64))
        columns: dict[str, list[str]] = {
            "Exact": ["", *_numbers(exact)],
            "Encoders": ["", *_numbers(_encoder_motion(name, trials))],
        }
        if pair.printed is not None and pair.estimated is not None:
            printed, estimated = (
                printed_motion(p, experiment) for p in (pair.printed, pair.estimated)
            )
            columns["Thesis, theoretical"] = ["", *_numbers(printed)]
            kept = f"{THESIS_KEPT} of {THESIS_PAIRS}"
            columns["Thesis, estimate"] = [kept, *_numbers(estimated)]
        for method, group in of_pair.groupby("method", sort=False):
            means = np.array([mean_motion(of_repeat) for _, of_repeat in group.groupby("repeat")])
            known = means[np.isfinite(means).all(axis=1)]
            in_mean = (group["rotation_x_deg"].notna() & ~group["outlier"]).groupby(group["repeat"])
            kept = f"{in_mean.sum().median():.0f} of {in_mean.size().iloc[0]}"
            columns[str(method)] = [kept, *(median_of(c).text(".2f") for c in known.T)]
        frame = pd.DataFrame(columns)
        frame.insert(0, "Parameter", ["Pairs in the mean", *NAMES])
        frame.insert(0, "Pair", name)
        frames.append(frame)
    repeats = int(rows["repeat"].nunique())
    first = trials[0]
    of_first = (rows["pair"] == first.pair) & (rows["method"] == first.label)
    losses = loss_table(first, rows[of_first & (rows["repeat"] == first.spec.repeat)])
    mean = [
        Table(
            "section_6.2",
            "Section 6.2, the mean over pairs of profiles",
            f"Medians over {repeats} repeats of the mean over the pairs that are answered and no "
            "outliers, with the median's 95 % interval by order statistics. The thesis kept 42 of "
            "its 44 pairs, and does not say by which rule.",
            pd.concat(frames, ignore_index=True),
            in_full=True,
        )
    ]
    return mean if losses is None else [*mean, losses]


def profile_seconds(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """A record for the table of seconds from each method."""
    records = []
    for method, group in rows.groupby("method", sort=False):
        total = group.groupby(["pair", "repeat"])["ms"].sum().median()
        count = int(group.groupby(["pair", "repeat"]).size().median())
        records.append(
            {
                "What": f"Section 6.2, {count} pairs of profiles",
                "Method": str(method),
                "Thesis (s)": THESIS_SECONDS if count == THESIS_PAIRS else np.nan,
                "Ours (s)": float(total) / 1e3,
            }
        )
    return records


def _encoder_motion(pair: str, trials: Sequence[Trial]) -> FloatArray:
    """(3,) the middle of what the encoders say of the pairs of profiles; NaN without an arm."""
    spec = full_specs(trial for trial in trials if trial.pair == pair)[0]
    target, source = spec.paths
    if not (isinstance(target, ArmPath) and isinstance(source, ArmPath)):
        return np.full(3, np.nan)
    between = target.T_world_encoder.inv() * source.T_world_encoder
    motions = [six_parameters(between[k])[[0, 4, 5]] for k in range(len(between))]
    return middle(np.array(motions))


def _numbers(values: FloatArray) -> list[str]:
    return ["" if np.isnan(value) else f"{value:.2f}" for value in values]
