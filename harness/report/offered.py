"""Which trials the page shows in 3D: those that are drawn, and the worst ones."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas as pd

from harness.scoring.poses import COARSE
from harness.scoring.row_scores import within

WORST = 6  # trials that are no success, of each experiment
OF_A_KIND = 2  # of these, of one pair and method
RANK = {"ok": 0, "error": 1, "ambiguous": 2, "underdetermined": 2, "failed": 3, "no_overlap": 4}


def worst_first(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows that are no success: wrong answers by falling error, then those that gave none."""
    bad = rows[~within(rows, COARSE)]
    size = np.maximum(
        bad["rotation_error_deg"].to_numpy(float) / COARSE.rotation_deg,
        bad["translation_error_mm"].to_numpy(float) / COARSE.translation_mm,
    )
    order = np.lexsort((-np.nan_to_num(size), bad["status"].map(RANK).fillna(5)))
    return bad.iloc[order]


def offered(rows: pd.DataFrame, drawn: Collection[str], main: str = "") -> list[str]:
    """Ids of the trials to show, the worst first, then those that are drawn.

    rows: as store.load gives them. drawn: labels of the methods whose repeat 0 is drawn. main: the
    label of a method that is to be seen at least once, where it can be.
    """
    whole = rows[rows["given"] == ""]
    # Without any overlap or with an error of the program there is nothing to look at.
    there = whole[~whole["status"].isin(["no_overlap", "error"])]
    bad = worst_first(there)
    turn = bad.groupby(["pair", "method"]).cumcount()
    kinds = bad[turn < OF_A_KIND].assign(turn=turn).sort_values("turn", kind="stable")
    chosen = list(kinds["id"][:WORST])
    seen = there[(there["repeat"] == 0) & there["method"].isin(list(drawn))]
    chosen += [identity for identity in seen["id"] if identity not in chosen]
    of_main = there[there["method"] == main]
    if len(of_main) and not of_main["id"].isin(chosen).any():
        chosen.append(str(of_main["id"].iloc[0]))
    return chosen or list(there["id"][:1])
