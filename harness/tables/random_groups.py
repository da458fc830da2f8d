"""How the rows on random pairs are grouped, and at which tolerances they are judged."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from harness.scoring.poses import Tolerance
from harness.trials.random_pairs import family_of


class Band(NamedTuple):
    """A range of overlap, the smaller share of the two views; the low end belongs to it."""

    name: str
    low: float
    high: float


# Each pair is in one of these, and in some of the others.
PARTS = (
    Band("below 0.2", 0.0, 0.2),
    Band("0.2 to 0.4", 0.2, 0.4),
    Band("0.4 to 0.6", 0.4, 0.6),
    Band("0.6 to 1", 0.6, 1.01),
)
BANDS = (*PARTS, Band("over 0.4", 0.4, 1.01), Band("any", 0.0, 1.01))

# From 0.1 deg and 0.3 mm over 1 deg and 5 mm to 5 deg and 30 mm, even on a logarithmic scale.
THRESHOLDS = tuple(
    Tolerance(float(angle), float(length))
    for angles, lengths in (
        (np.geomspace(0.1, 1.0, 9), np.geomspace(0.3, 5.0, 9)),
        (np.geomspace(1.0, 5.0, 7)[1:], np.geomspace(5.0, 30.0, 7)[1:]),
    )
    for angle, length in zip(angles, lengths, strict=True)
)


def with_family(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the columns family and overlap, the smaller share of the two views.

    A row without an overlap, as its process was ended, has that of the others on its pair.
    """
    known = rows.copy()
    known["family"] = [family_of(pair) for pair in rows["pair"]]
    known["overlap"] = rows[["overlap_target", "overlap_source"]].min(axis=1)
    if known["overlap"].isna().any():
        of_pair = known.groupby("pair")["overlap"]
        low, high = of_pair.transform("min"), of_pair.transform("max")
        known["overlap"] = known["overlap"].fillna(low.where(low == high))
    return known


def in_band(rows: pd.DataFrame, band: Band) -> pd.DataFrame:
    """The rows whose overlap lies in the band."""
    return rows[(rows["overlap"] >= band.low) & (rows["overlap"] < band.high)]


def grouped(rows: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Family, method and their rows; all families together first, if there are several."""
    families = list(rows["family"].unique())
    for family in ["all", *families] if len(families) > 1 else families:
        of_family = rows if family == "all" else rows[rows["family"] == family]
        for method in rows["method"].unique():
            yield family, str(method), of_family[of_family["method"] == method]


def banded(rows: pd.DataFrame) -> Iterator[tuple[str, str, Band, pd.DataFrame]]:
    """Family, method, band of overlap and its rows, where there are any."""
    for family, method, of_method in grouped(rows):
        for band in BANDS:
            group = in_band(of_method, band)
            if len(group):
                yield family, method, band, group
