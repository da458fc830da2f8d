"""A study for the page: what a sweep found at every point, with the trials behind it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.scoring.chance import wilson_interval
from harness.scoring.poses import COARSE, FINE
from harness.scoring.row_scores import within
from harness.tables.sweeps import PREFIX, plain_value, swept_keys
from harness.trials.points import short_names

MOST_POINTS = 1500  # that a reader and a browser can tell apart
LISTED_TRIALS = 60  # behind a point
SPREADS = {"deg": "rotation_error_deg", "mm": "translation_error_mm", "ms": "ms_registration"}
# Of the values of each group, the median and the ends of its bar.
Bars = Callable[
    ["pd.Series[float]", NDArray[np.integer[Any]]], Mapping[int, Sequence[float | None]]
]


def quartiles(values: pd.Series[float], places: NDArray[np.integer[Any]]) -> dict[int, list[float]]:
    """By group, median and quartiles; no entry where there is nothing.

    values: whose index counts the rows. places: by row, its group.
    """
    groups = values.groupby(places[values.index.to_numpy()])
    found = groups.quantile(np.array([0.5, 0.25, 0.75])).unstack()
    return {
        int(place): list(three)
        for place, three in zip(found.index, found.to_numpy().tolist(), strict=True)
    }


def study(rows: pd.DataFrame, design: str, bars: Bars = quartiles) -> dict[str, Any]:
    """The points of a sweep as plain values; studies.js draws them.

    rows: as store.load gives those of a sweep. design: of the sweep. Each point has its values in
    the order of the keys, what was varied, the method, shares with Wilson's interval, medians of
    the errors of those within the coarse tolerance with the ends of their bars, and the ids of its
    first trials. Of a large sweep an even part of the points: shown, of.
    """
    keys = swept_keys(rows)
    names = short_names(keys)
    known = rows[rows["given"] == ""].reset_index(drop=True)
    flags = {"fine": within(known, FINE), "coarse": within(known, COARSE)}
    known = known.assign(**flags)
    n_points = known["sweep.point"].nunique()
    if n_points > MOST_POINTS:
        # Evenly over the sweep: what is drawn of a design looks as the whole does.
        every = -(-n_points // MOST_POINTS)
        known = known[known["sweep.point"].rank(method="dense") % every == 1].reset_index(drop=True)
    by_point = known.groupby(["sweep.point", "method"], sort=False)
    places = by_point.ngroup().to_numpy(np.int64)
    counts = np.bincount(places)
    rights = {name: np.bincount(places, known[name]).astype(int) for name in flags}
    good = known["coarse"].to_numpy()
    spreads = {
        short: bars(known.loc[good & known[column].notna().to_numpy(), column], places)
        for short, column in SPREADS.items()
    }
    ids = known["id"].groupby(places).agg(list)
    shares = functools.cache(wilson_interval)
    points = []
    for place, first in enumerate(by_point.first().reset_index().to_dict("records")):
        n = int(counts[place])
        point: dict[str, Any] = {
            "values": [plain_value(first[PREFIX + key]) for key in keys],
            "varied": names.get(first["sweep.varied"], ""),
            "method": first["method"],
            "n": n,
            "ids": ids[place][:LISTED_TRIALS],
        }
        for name, right in rights.items():
            point[name] = [int(right[place]) / n, *shares(int(right[place]), n)]
        point |= {short: spread.get(place) for short, spread in spreads.items()}
        points.append(point)
    return {
        "keys": [names[key] for key in keys],
        "full": keys,
        "design": design,
        "methods": list(known["method"].unique()),
        "points": points,
        "of": int(n_points),
        "shown": int(known["sweep.point"].nunique()),
        "tolerances": {
            name: f"{t.rotation_deg:g}° and {t.translation_mm:g} mm"
            for name, t in (("fine", FINE), ("coarse", COARSE))
        },
    }
