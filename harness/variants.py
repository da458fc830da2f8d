"""Variants of one method beside its plain form, trial by trial."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, binomtest

from harness.random_groups import with_family, within
from harness.schema import MethodChoice
from harness.scoring import COARSE, wilson_interval
from harness.table_files import Table
from registration.scan import FloatArray

LEVEL = 0.95
FEWEST = 6  # pairs of trials below which a median has no interval at that level
RATIOS = (
    ("Rotation error", "rotation_error_deg"),
    ("Translation error", "translation_error_mm"),
    ("Time", "ms_registration"),
)


def variant_tables(
    methods: Sequence[MethodChoice], rows: pd.DataFrame, random: bool
) -> list[Table]:
    """A table for every method that stands in the config several times; the first is the plain one.

    rows: as store.load gives them. random: whether they are of an experiment on random pairs.
    """
    whole = rows[rows["given"] == ""]
    tables = []
    for name in dict.fromkeys(method.name for method in methods):
        labels = [m.label or m.name for m in methods if m.name == name]
        if len(labels) > 1:
            tables.append(_variant_table(name, labels, whole[whole["method"].isin(labels)], random))
    return tables


def _variant_table(name: str, labels: list[str], rows: pd.DataFrame, random: bool) -> Table:
    records = [
        {"Pairs": group, **_record(of_group, label, labels[0])}
        for group, of_group in _groups(rows, random)
        for label in labels
    ]
    frame = pd.DataFrame(records)
    return Table(
        f"variants_{name}",
        f"Method {name}: variants beside {labels[0]}",
        f"Right: of status ok, within {COARSE}, with Wilson's 95 % interval. Gained, lost: trials "
        f"on the same scans that only this variant, or only {labels[0]}, got right; p: chance of "
        "so uneven a split if both were alike (exact sign test). Ratios to the plain form on the "
        "trials that both got right, times on all: median and its 95 % interval, free of any "
        f"assumption about their distribution, where there are {FEWEST} or more.",
        frame.drop(columns=["variant", "over", *(f"bounds_{c}" for _, c in RATIOS)]),
        {"Trials": "d", "Gained": ".0f", "Lost": ".0f", "p": ".2g", "Both right": "d"},
        note=_conclusion(frame, labels),
        in_full=True,
    )


def _groups(rows: pd.DataFrame, random: bool) -> Iterator[tuple[str, pd.DataFrame]]:
    """All rows; then, where there are several, those of each pair or family of random pairs."""
    yield "all", rows
    key = "family" if random else "pair"
    groups = (with_family(rows) if random else rows).groupby(key, sort=False)
    if groups.ngroups > 1:
        for name, group in groups:
            yield str(name), group


def _record(rows: pd.DataFrame, label: str, plain: str) -> dict[str, Any]:
    """One line, with what the conclusion needs beside."""
    key = ["pair", "repeat"]
    ours, theirs = (rows[rows["method"] == m].set_index(key) for m in (label, plain))
    theirs = theirs.loc[ours.index]
    right, before = within(ours, COARSE), within(theirs, COARSE)
    gained, lost = int((right & ~before).sum()), int((~right & before).sum())
    low, high = wilson_interval(int(right.sum()), len(ours))
    record: dict[str, Any] = {
        "variant": label,
        "over": gained - lost,
        "Method": label,
        "Trials": len(ours),
        "Right": f"{int(right.sum())}/{len(ours)} [{low:.0%}, {high:.0%}]",
    }
    record |= {"Gained": np.nan, "Lost": np.nan, "p": np.nan}
    if label != plain:
        p = binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
        record |= {"Gained": gained, "Lost": lost, "p": float(p)}
    record["Both right"] = int((right & before).sum())
    for title, column in RATIOS:
        taken = right & before if title != "Time" else np.ones(len(ours), dtype=bool)
        top, base = ours.loc[taken, column], theirs.loc[taken, column]
        ratio = (top.astype(float) / base.astype(float)).dropna().to_numpy()
        bounds = median_interval(ratio)
        record[f"{title}, ratio"] = "" if label == plain else _printed(ratio, bounds)
        record[f"bounds_{column}"] = bounds
    return record


def median_interval(values: FloatArray) -> tuple[float, float] | None:
    """The interval of a median by order statistics, or None of too few values.

    Between the values of ranks k and n + 1 - k, where k - 1 is the largest number of heads that n
    tosses stay below with at most half of 1 - LEVEL.
    """
    n = len(values)
    if n < FEWEST:
        return None
    k = int(binom.ppf((1.0 - LEVEL) / 2.0, n, 0.5))
    k = k if binom.cdf(k - 1, n, 0.5) <= (1.0 - LEVEL) / 2.0 else k - 1
    ordered = np.sort(values)
    return float(ordered[k - 1]), float(ordered[n - k])


def _printed(ratio: FloatArray, bounds: tuple[float, float] | None) -> str:
    if not len(ratio):
        return ""
    text = f"{np.median(ratio):.2f}"
    return text if bounds is None else f"{text} [{bounds[0]:.2f}, {bounds[1]:.2f}]"


def _conclusion(frame: pd.DataFrame, labels: list[str]) -> str:
    """What the lines over all pairs say, in two sentences."""
    lines = frame[(frame["Pairs"] == "all") & (frame["variant"] != labels[0])]
    sure = lines[lines["p"] < 1.0 - LEVEL]
    more = _names(sure.loc[sure["over"] > 0, "variant"])
    fewer = _names(sure.loc[sure["over"] < 0, "variant"])
    plain = labels[0]
    parts = [f"more trials right than {plain}: {more}", f"fewer: {fewer}"]
    for title, column in RATIOS:
        bounds = lines[["variant", f"bounds_{column}"]].itertuples(index=False)
        known = [(variant, limits) for variant, limits in bounds if limits is not None]
        less = _names(v for v, limits in known if limits[1] < 1.0)
        greater = _names(v for v, limits in known if limits[0] > 1.0)
        parts.append(f"{title} smaller: {less}; larger: {greater}")
    return (
        f"\nOver all {int(lines['Trials'].max())} trials a variant, beyond chance at 5 % each: "
        f"{parts[0]}; {parts[1]}.\n{'. '.join(parts[2:])}."
    )


def _names(variants: Any) -> str:
    return ", ".join(variants) or "none"
