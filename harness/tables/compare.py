"""Two runs of the same trials beside each other: did a change help, and is the difference real?"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import bootstrap, wilcoxon

from harness.scoring.chance import FEWEST, LEVEL, sign_test
from harness.scoring.poses import COARSE
from harness.scoring.row_scores import ERRORS, within
from harness.tables.sweeps import PREFIX, plain_value, swept_keys
from harness.tables.table import Table
from registration.scan import FloatArray

RESAMPLES = 2000
NAMED = ["pair", "method", "given", "repeat"]  # of a trial, besides what determines it
MATCHED = ["key", "point", *NAMED]


def matched(one: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """The trials that both runs have, columns of the first ending in _a, of the second in _b.

    one, other: rows as store.load gives them with specs. Trials match when everything but the
    method's parameters is equal: the same scans, and a method of the same label; so a changed
    program and a changed parameter can both be judged. Of sweeps, points match by the keys that
    both sweep. Raises ValueError where a trial would have several partners.
    """
    keys = swept_keys(one), swept_keys(other)
    shared = [key for key in keys[0] if key in keys[1]]
    left, right = (_keyed(rows, shared) for rows in (one, other))
    if any(rows.duplicated(MATCHED).any() for rows in (left, right)):
        differing = ", ".join(sorted(set(keys[0]) ^ set(keys[1])))
        raise ValueError(f"several trials of one of them differ in {differing} only")
    pairs = left.merge(right, on=MATCHED, suffixes=("_a", "_b"), validate="one_to_one")
    # Where a swept key says nothing to a method, its points have one trial, not as many.
    names = ["id_a", "id_b", *NAMED]
    return pairs.drop_duplicates(names, ignore_index=True)


def trial_count(rows: pd.DataFrame) -> int:
    """How many different trials there are, those that points of a sweep share counted once."""
    return len(rows.drop_duplicates(["id", *NAMED]))


def _keyed(rows: pd.DataFrame, swept: Sequence[str]) -> pd.DataFrame:
    known = rows.copy()
    known["right"] = within(known, COARSE)
    known["key"] = [_without_method(spec) for spec in known["spec"]]
    # Of a method's parameters only the sweep tells, as the spec is without them.
    values = [[plain_value(value) for value in known[PREFIX + key]] for key in swept]
    varied = known["sweep.varied"] if "sweep.varied" in known else [""] * len(known)
    known["point"] = [json.dumps(point) for point in zip(varied, *values, strict=True)]
    names = [*MATCHED, "id", "status", "reason", "right", "ms_registration", *ERRORS]
    return known[names].drop_duplicates([*MATCHED, "id"])


def _without_method(spec: str) -> str:
    data = json.loads(spec)
    data.pop("method", None)
    return json.dumps(data, sort_keys=True)


def median_difference(differences: FloatArray) -> tuple[float, float, float, float]:
    """Median of paired differences (n,), the ends of its bootstrap interval, and Wilcoxon's p.

    The interval and p are NaN for fewer than FEWEST; without any difference p is 1.
    """
    if len(differences) == 0:
        return np.nan, np.nan, np.nan, np.nan
    middle = float(np.median(differences))
    if len(differences) < FEWEST:
        return middle, np.nan, np.nan, np.nan
    if not differences.any():
        return 0.0, 0.0, 0.0, 1.0
    ends = bootstrap(
        (differences,), np.median, confidence_level=LEVEL, n_resamples=RESAMPLES,
        method="percentile", rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    p = wilcoxon(differences, zero_method="zsplit").pvalue
    return middle, float(ends.low), float(ends.high), float(p)


def comparison_table(pairs: pd.DataFrame, names: tuple[str, str]) -> Table:
    """Method by method, how often each run was right and how the errors differ.

    pairs: as of `matched`. names: what to call both runs.
    """
    records = [_compared(label, group, names) for label, group in _groups(pairs)]
    frame = pd.DataFrame(records)
    formats = {"Trials": "d", "both": "d", "McNemar p": ".2g"}
    formats |= {f"only {name}": "d" for name in names}
    for unit in ERRORS.values():
        formats |= {f"Median difference ({unit})": "+.3f", f"Wilcoxon p ({unit})": ".2g"}
    formats |= {"Time ratio": ".2f"}
    return Table(
        "comparison",
        f"{names[1]} against {names[0]}, method by method",
        f"Right: marked ok and within {COARSE}. The p of McNemar's exact test is how often as "
        "large a difference would come about if both runs were as good. Differences of errors are "
        f"{names[1]} less {names[0]}, below 0 is better, over the trials that both got right, "
        "with the bootstrap interval (95 %) of the median and the p of Wilcoxon's signed-rank "
        f"test; neither is given for fewer than {FEWEST}. Time ratio: median of the times of "
        f"{names[1]} over those of {names[0]}, which other load on the machine changes.",
        frame,
        {column: text for column, text in formats.items() if column in frame},
        in_full=True,
    )


def _groups(pairs: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for (method, given), group in pairs.groupby(["method", "given"], sort=False):
        yield f"{method}, given {given}" if given else str(method), group


def _compared(label: str, group: pd.DataFrame, names: tuple[str, str]) -> dict[str, Any]:
    a, b = group["right_a"].to_numpy(bool), group["right_b"].to_numpy(bool)
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    record: dict[str, Any] = {
        "Method": label,
        "Trials": len(group),
        "both": int((a & b).sum()),
        f"only {names[0]}": only_a,
        f"only {names[1]}": only_b,
        "McNemar p": sign_test(only_a, only_b),
    }
    good = group[a & b]
    for column, unit in ERRORS.items():
        differences = (good[f"{column}_b"] - good[f"{column}_a"]).to_numpy(np.float64)
        middle, low, high, p = median_difference(differences)
        record[f"Median difference ({unit})"] = middle
        record[f"95 % interval ({unit})"] = "" if np.isnan(low) else f"[{low:+.3f}, {high:+.3f}]"
        record[f"Wilcoxon p ({unit})"] = p
    ratios = (group["ms_registration_b"] / group["ms_registration_a"]).dropna()
    record["Time ratio"] = float(ratios.median()) if len(ratios) else np.nan
    return record


def changed_table(pairs: pd.DataFrame, names: tuple[str, str]) -> Table:
    """Every trial that only one of both runs got right."""
    changed = pairs[pairs["right_a"] != pairs["right_b"]].sort_values("right_b", kind="stable")
    columns: dict[str, Any] = {"Pair": changed["pair"], "Method": changed["method"]}
    columns |= {"Entered with": changed["given"], "Repeat": changed["repeat"]}
    for name, end in zip(names, ("a", "b"), strict=True):
        columns |= {
            f"Trial in {name}": changed[f"id_{end}"],
            f"Status in {name}": changed[f"status_{end}"],
            f"Error in {name} (deg)": changed[f"rotation_error_deg_{end}"],
            f"Error in {name} (mm)": changed[f"translation_error_mm_{end}"],
        }
    formats = {"Repeat": "d"}
    formats |= {f"Error in {name} ({unit})": ".2f" for name in names for unit in ("deg", "mm")}
    return Table(
        "changed",
        "Trials that only one run got right",
        "First those that were lost, then those that were won. Replay one with --trial and its id "
        "and the config of its run.",
        pd.DataFrame(columns).reset_index(drop=True),
        formats,
    )


def summary(pairs: pd.DataFrame, names: tuple[str, str]) -> str:
    """The difference in a sentence a method."""
    sentences = []
    groups = list(_groups(pairs))
    # With the truth in place of a stage is for the table; a sentence is about whole methods.
    whole = [(label, group) for label, group in groups if ", given " not in label]
    for label, group in whole or groups:
        found = _compared(label, group, names)
        right = [int(group[f"right_{end}"].sum()) for end in ("a", "b")]
        text = f"{label}: {right[0]} of {len(group)} right in {names[0]}, {right[1]} in {names[1]}"
        text += f" (p {found['McNemar p']:.2g})"
        middle, p = found["Median difference (mm)"], found["Wilcoxon p (mm)"]
        if np.isfinite(middle):
            text += f"; errors where both are right differ by {middle:+.3g} mm in the median"
            text += "" if np.isnan(p) else f" (p {p:.2g})"
        sentences.append(text + ".")
    return " ".join(sentences)
