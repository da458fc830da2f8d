"""A study of random pairs for the page: ranges of overlap, or methods, as points of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.config.random_schema import RandomPairsExperiment
from harness.report.studies import study
from harness.scoring.chance import FEWEST, median_interval
from harness.studies.overlap import ALL, ranges
from harness.studies.ranking import ranking_table
from harness.tables.random_groups import with_family
from harness.tables.sweeps import PREFIX

OVERLAP, METHOD, SCENES = "overlap (%)", "method", "scenes"


def pair_study(rows: pd.DataFrame, experiment: RandomPairsExperiment) -> dict[str, Any] | None:
    """What studies.study gives of a sweep, of a study of random pairs; None where there is none.

    rows: as store.load gives them. Of "overlap" a point is a range of it, by method and scenes; of
    "ranking" a method, by scenes. The last key are the scenes, and whole is what all together are
    called there; names keep their order.
    """
    asked = experiment.study
    if asked is None or asked.kind not in ("overlap", "ranking"):
        return None
    known = with_family(rows[rows["given"] == ""])
    families = list(known["family"].unique())
    scenes = {ALL: known} if len(families) > 1 else {}
    scenes |= {family: known[known["family"] == family] for family in families}
    groups: list[tuple[float | str, str, pd.DataFrame]] = []
    if asked.kind == "overlap":
        key, axis = OVERLAP, f"{OVERLAP}, middle of its range"
        for name, of_scenes in scenes.items():
            for low, high, group in ranges(of_scenes, experiment.overlap):
                groups.append((round(50.0 * (low + high), 6), name, group))
    else:
        key, axis = METHOD, METHOD
        best_first = ranking_table(rows).frame["Method"]
        for name, of_scenes in scenes.items():
            for method in best_first:
                # The method is where the point stands, not what else tells it from others.
                group = of_scenes[of_scenes["method"] == method].assign(method="")
                groups.append((method, name, group))
    swept = []
    for place, (value, name, group) in enumerate(groups):
        point: dict[str, float | str] = {"point": place, "varied": "", key: value, SCENES: name}
        swept.append(group.assign(**{PREFIX + column: here for column, here in point.items()}))
    found = study(pd.concat(swept, ignore_index=True), "product", _medians)
    return found | {
        "full": [axis, SCENES],
        "methods": [method for method in found["methods"] if method],
        "whole": next(iter(scenes)),
        "bars": f"95 % interval by order statistics, of {FEWEST} right ones or more",
    }


def _medians(
    values: pd.Series[float], places: NDArray[np.integer[Any]]
) -> dict[int, Sequence[float | None]]:
    """By group, the median and its interval, the ends None of too few."""
    groups = values.groupby(places[values.index.to_numpy()])
    return {
        int(place): [float(group.median()), *(median_interval(group.to_numpy()) or (None, None))]
        for place, group in groups
    }
