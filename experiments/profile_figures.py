"""The figures of pairs of profiles: 4.4 to 4.9 of one pair, 6.2 and 6.3 of all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from experiments import planar_figures as planar
from experiments.profile_means import mean_motion
from experiments.profile_pairs import (
    ProfilePair,
    ProfilesExperiment,
    register_profiles,
)
from harness.figures.looks import GREY, INK, MARK, TARGET
from harness.figures.page import (
    HEAD_IN,
    LEFT_IN,
    WIDTH_IN,
    add_axes,
    amount,
    new_figure,
    page_style,
    save,
)
from harness.file_names import file_slug
from harness.trials.specs import Trial
from registration.planar.pipeline import PlanarEvidence

FOOT_IN = 0.85
SERIES = (
    ("rotation_x_deg", "rotation about X (°)", "°"),
    ("y_mm", "translation along Y (mm)", " mm"),
    ("z_mm", "translation along Z (mm)", " mm"),
)


def draw_profiles(
    experiment: ProfilesExperiment, trials: Sequence[Trial], rows: pd.DataFrame, folder: Path
) -> list[Path]:
    """Draw repeat 0 of every pair of views, by the methods with figures; returns the PNG files."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    drawn = {method.called for method in experiment.methods if method.figures}
    files = []
    for trial in trials:
        if trial.spec.repeat > 0 or trial.label not in drawn:
            continue
        chosen = (rows["pair"] == trial.pair) & (rows["method"] == trial.label)
        slug = file_slug(f"{trial.pair}_{trial.label}")
        for number, draw in _figures(trial, rows[chosen & (rows["repeat"] == 0)]):
            with page_style():
                files.append(save(draw(), folder / f"figure_{number}_{slug}.png"))
    return files


def _figures(trial: Trial, rows: pd.DataFrame) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """What there is to draw of a trial, by number."""
    name = f"Pair {trial.pair}, method {trial.label}"
    yield "6_02", lambda: draw_series(name, rows, SERIES[:1], "6.2")
    yield "6_03", lambda: draw_series(name, rows, SERIES[1:], "6.3")
    shown = telling_pair(list(register_profiles(trial)))
    if shown is None:
        return
    pair, evidence = shown
    where = f"{name}, profile {pair.profile} at {pair.elevation_mm:.0f} mm"
    yield "4_04", lambda: planar.draw_raw(pair, where)
    yield "4_05", lambda: planar.draw_segments(pair, evidence, where)
    yield "4_06", lambda: planar.draw_circles(pair, evidence, where)
    yield "4_07", lambda: planar.draw_turned(pair, evidence, where)
    yield "4_08", lambda: planar.draw_shift(pair, evidence, where)
    yield "4_09", lambda: planar.draw_superposed(pair, where)


def telling_pair(pairs: Sequence[ProfilePair]) -> tuple[ProfilePair, PlanarEvidence] | None:
    """The answered pair in which most segments overlap, the first of equals; None without one."""
    best: tuple[ProfilePair, PlanarEvidence] | None = None
    for pair in pairs:
        evidence = pair.result.evidence.get("planar")
        if pair.result.T_target_source is None or not isinstance(evidence, PlanarEvidence):
            continue
        if best is None or len(evidence.matches.pairs) > len(best[1].matches.pairs):
            best = pair, evidence
    return best


def draw_series(
    name: str, rows: pd.DataFrame, series: Sequence[tuple[str, str, str]], number: str
) -> Figure:
    """What each pair of profiles says about some of the parameters, and their mean."""
    high_in = 3.0
    left_out = int(rows["outlier"].sum())
    open_ = rows[rows["rotation_x_deg"].isna()]
    note = (
        f"{len(rows)} pairs of profiles: {len(rows) - left_out - len(open_)} in the mean, "
        f"{amount(left_out, 'outlier')} (a parameter farther than 5.2 median absolute deviations "
        f"from the median), {len(open_)} without an answer."
    )
    height = HEAD_IN + FOOT_IN + len(series) * high_in + (len(series) - 1) * 0.35
    quantity = "Rotation" if len(series) == 1 else "Translation"
    figure = new_figure(f"{name}\n{quantity} by single profiles, as figure {number}", height, note)
    mean = dict(zip((s[0] for s in SERIES), mean_motion(rows), strict=True))
    for place, (column, label, unit) in enumerate(series):
        bottom = FOOT_IN + (len(series) - 1 - place) * (high_in + 0.35)
        ax = add_axes(figure, LEFT_IN, bottom, WIDTH_IN - LEFT_IN - 2.1, high_in)
        profile, values = rows["profile"], rows[column]
        exact = float(rows[f"exact_{column}"].iloc[0])
        far = rows["outlier"]
        ax.axhline(exact, color=INK, lw=1.0, label=f"exact, {exact:.2f}{unit}")
        ax.axhline(mean[column], color=TARGET, lw=1.0, ls="--",
                   label=f"mean, {mean[column]:.2f}{unit}")  # fmt: skip
        ax.plot(profile[~far], values[~far], "o", ms=4.0, c=TARGET, label="in the mean")
        if far.any():
            ax.plot(profile[far], values[far], "x", ms=6.0, mew=1.6, c=MARK, label="outlier")
        if len(open_):
            ax.plot(open_["profile"], np.full(len(open_), 0.02), "|", ms=8.0, c=GREY,
                    transform=ax.get_xaxis_transform(), label="no answer")  # fmt: skip
        ax.set_xlim(-1.0, len(rows))
        ax.margins(y=0.12)
        ax.set_ylabel(label)
        ax.ticklabel_format(useOffset=False)
        if place == len(series) - 1:
            ax.set_xlabel("profile, from the lowest to the highest")
        else:
            ax.tick_params(labelbottom=False)
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return figure
