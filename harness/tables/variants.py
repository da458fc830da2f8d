"""Variants of one method beside its plain form, trial by trial."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from harness.config.schema import MethodChoice
from harness.scoring.chance import FEWEST, LEVEL, median_interval, median_text, rate, sign_test
from harness.scoring.poses import COARSE
from harness.scoring.row_scores import within
from harness.tables.random_groups import with_family
from harness.tables.table import Table

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
        labels = [m.called for m in methods if m.name == name]
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
    both = ours.index.intersection(theirs.index, sort=False)  # a run may have been interrupted
    ours, theirs = ours.loc[both], theirs.loc[both]
    right, before = within(ours, COARSE), within(theirs, COARSE)
    gained, lost = int((right & ~before).sum()), int((~right & before).sum())
    record: dict[str, Any] = {
        "variant": label,
        "over": gained - lost,
        "Method": label,
        "Trials": len(ours),
        "Right": rate(int(right.sum()), len(ours)),
    }
    record |= {"Gained": np.nan, "Lost": np.nan, "p": np.nan}
    if label != plain:
        record |= {"Gained": gained, "Lost": lost, "p": sign_test(gained, lost)}
    record["Both right"] = int((right & before).sum())
    for title, column in RATIOS:
        taken = right & before if title != "Time" else np.ones(len(ours), dtype=bool)
        top, base = ours.loc[taken, column], theirs.loc[taken, column]
        ratio = (top.astype(float) / base.astype(float)).dropna().to_numpy()
        record[f"{title}, ratio"] = "" if label == plain else median_text(ratio)
        record[f"bounds_{column}"] = median_interval(ratio)
    return record


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
