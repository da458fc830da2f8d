"""A map of failures over the number of profiles and the step between them."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from harness.figures.looks import INK
from harness.figures.page import add_axes, new_figure
from harness.scoring.chance import LEVEL, sign_test
from harness.studies.figures import foot_in, share_map
from harness.studies.numbers import (
    CUT,
    RIGHT,
    gained_lost,
    outcomes,
    record_formats,
    record_of,
)
from harness.tables.table import Table

PROFILES, STEP = "sweep.scan.profiles", "sweep.scan.step_mm"
PANEL_IN = 3.55


def grid_table(rows: pd.DataFrame, profiles_per_s: float) -> Table:
    """One line a method, number of profiles and step, with the time and the length of the scan.

    rows: as store.load gives those of a sweep of scan.profiles and scan.step_mm.
    """
    known = outcomes(rows)
    records = []
    for (method, *cell), group in known.groupby(["method", PROFILES, STEP], sort=False):
        profiles, step = (float(str(value)) for value in cell)
        records.append(
            {
                "Method": method, "Profiles": int(profiles), "XSTEP (mm)": step,
                "Scan time (s)": profiles / profiles_per_s,
                "Length (mm)": (profiles - 1.0) * step,
            }
            | record_of(group)
        )  # fmt: skip
    formats = {"Profiles": "d", "XSTEP (mm)": "g", "Scan time (s)": ".2f", "Length (mm)": ".0f"}
    return Table(
        "study_grid",
        "XSTEP against the number of profiles",
        f"{RIGHT} {CUT} Scan time is that of the sensor at {profiles_per_s:g} profiles a second; "
        "where the arm sets the pace, scans of equal length take equally long.",
        pd.DataFrame(records),
        formats | record_formats(),
    )


def grid_conclusion(rows: pd.DataFrame, frame: pd.DataFrame) -> tuple[str, str]:
    """The best step at each scan time, and what more profiles over one length are worth."""
    known = outcomes(rows)
    steps, lengths = [], []
    for method, group in frame.groupby("Method", sort=False):
        own = known[known["method"] == method]
        told = [
            f"{profiles} profiles {_best(own[own[PROFILES] == profiles])}"
            for profiles in sorted(group["Profiles"].unique())
        ]
        steps.append(f"{method}: {', '.join(told)}")
        lengths.append(f"{method} {_finer(own)}")
    first = f"Best XSTEP at equal scan time (in brackets steps not told apart): {'; '.join(steps)}."
    second = (
        "Twice the profiles at half the step, over one length (sign test over pairs): "
        f"{'; '.join(lengths)}."
    )
    return first, second


def _best(rows: pd.DataFrame) -> str:
    """The step that is most often right, and those that a sign test cannot tell from it."""
    by_step = {float(str(step)): group for step, group in rows.groupby(STEP)}
    best = max(by_step, key=lambda step: float(by_step[step]["right"].mean()))
    alike = [
        f"{step:g}"
        for step, group in by_step.items()
        if step != best and gained_lost(group, by_step[best])[2] >= 1.0 - LEVEL
    ]
    if len(alike) == len(by_step) - 1 > 0:
        return "any of them"
    others = f" [{', '.join(alike)}]" if alike else ""
    return f"{best:g} mm{others}"


def _finer(rows: pd.DataFrame) -> str:
    """Successes won and lost by halving the step over the same length, all such cells together.

    Cells share their pairs, so that chance is judged by what becomes of each pair over all of them.
    """
    cells = {
        (float(str(profiles)), float(str(step))): group.set_index(["pair", "repeat"])["right"]
        for (profiles, step), group in rows.groupby([PROFILES, STEP])
    }
    changes = [
        cells[2.0 * profiles, step / 2.0].astype(int) - right.astype(int)
        for (profiles, step), right in cells.items()
        if (2.0 * profiles, step / 2.0) in cells
    ]
    if not changes:
        return "no such cells"
    change = pd.concat(changes).dropna()
    of_pair = change.groupby(level=[0, 1]).sum()
    better, worse = int((of_pair > 0).sum()), int((of_pair < 0).sum())
    gained, lost = int((change > 0).sum()), int((change < 0).sum())
    sure = "beyond chance" if sign_test(better, worse) < 1.0 - LEVEL else "not beyond chance"
    return f"gains {gained} trials and loses {lost}, {sure}"


def draw_grid(frame: pd.DataFrame, note: str) -> Figure:
    """A map a method; the best step of each column is framed. frame: that of grid_table."""
    methods = list(frame["Method"].unique())
    profiles = sorted(frame["Profiles"].unique())
    steps = sorted(frame["XSTEP (mm)"].unique())
    times = dict(zip(frame["Profiles"], frame["Scan time (s)"], strict=True))
    foot, lines = foot_in(note), -(-len(methods) // 2)
    figure = new_figure(
        "Few profiles far apart, or many close together?\nShare of failures; framed: the fewest in "
        "a column, that is at equal scan time.\nAlong diagonals scans are equally long",
        0.95 + PANEL_IN * lines + foot,
        note,
    )
    for place, method in enumerate(methods):
        line, column = divmod(place, 2)
        bottom = foot + 0.65 + PANEL_IN * (lines - 1 - line)
        ax = add_axes(figure, 0.75 + 4.2 * column, bottom, 3.8, PANEL_IN - 0.95)
        shares, counts = np.zeros((2, len(steps), len(profiles)))
        for record in frame[frame["Method"] == method].to_dict("records"):
            cell = steps.index(record["XSTEP (mm)"]), profiles.index(record["Profiles"])
            shares[cell], counts[cell] = 1.0 - record["Right"], record["Trials"]
        columns = [f"{n}\n{times[n]:.2g} s" for n in profiles]
        share_map(ax, shares, counts, [f"{step:g}" for step in steps], columns)
        ax.invert_yaxis()
        for c in range(len(profiles)):
            fewest = np.min(shares[counts[:, c] > 0, c], initial=1.0)
            for r in np.flatnonzero((counts[:, c] > 0) & (shares[:, c] == fewest)):
                edge = Rectangle((c - 0.48, r - 0.48), 0.96, 0.96, fill=False, ec="#D55E00", lw=2.0)
                ax.add_patch(edge)
        ax.set_title(f"{method}, {int(counts.max())} pairs", color=INK)
        ax.set_xlabel("profiles, and time at the sensor's pace")
        if column == 0:
            ax.set_ylabel("XSTEP (mm)")
    return figure
