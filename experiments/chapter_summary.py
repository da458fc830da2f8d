"""The tables that sum up several experiments of chapter 6 beside what the thesis printed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from experiments.medians import Median, median_of
from experiments.profile_summary import profile_seconds, profile_summary
from harness.config.schema import Experiment, Pair
from harness.scoring.chance import rate
from harness.scoring.poses import COARSE, PARAMETERS
from harness.scoring.row_scores import ERRORS, within
from harness.tables.pairs import NAMES, printed_six, theoretical_error, thesis_values
from harness.tables.table import Table
from harness.trials.specs import Trial
from harness.trials.views import LABEL_ORDER
from registration.scan import FloatArray

ERROR_NAMES = ("Error, rotation angle (deg)", "Error, translation norm (mm)")
# Sections 6.3 to 6.5, "about": Matlab on a Pentium III at 933 MHz.
THESIS_SECONDS = {"6.1": 16.0, "6.2": 6.0, "6.3": 6.0, "6.4": 60.0, "6.5": 60.0}


@dataclass(frozen=True)
class PartResult:
    """What one part of a run left: its own tables, and its rows where it has any.

    experiment, trials, rows: of pairs of views (as store.load gives them) or of profiles (as
    profile_pairs.measure); None, empty and None for a part without rows.
    """

    name: str
    tables: tuple[Table, ...]
    experiment: Experiment | None = None
    trials: Sequence[Trial] = ()
    rows: pd.DataFrame | None = field(default=None, repr=False)


class PrintedPair(NamedTuple):
    """A pair that the thesis prints a table of, with the rows of whole trials."""

    name: str
    pair: Pair
    experiment: Experiment
    rows: pd.DataFrame

    @property
    def methods(self) -> list[str]:
        """Labels in the order of the config."""
        return [str(label) for label in self.rows["method"].unique()]

    def of(self, method: str) -> pd.DataFrame:
        """The rows of one method."""
        return self.rows[self.rows["method"] == method]


def summary_tables(parts: Sequence[PartResult]) -> tuple[list[Table], list[Table]]:
    """The tables to show, and those that only their files are for.

    parts: what each left; those without rows add their own tables to the second.
    """
    pairs = list(printed_pairs(parts))
    shown = [comparison_table(pairs), estimate_table(pairs)] if pairs else []
    seconds = [row for pair in pairs for row in _seconds(pair)]
    for part in parts:
        if part.rows is not None and part.experiment is not None and "profile" in part.rows:
            shown += profile_summary(part.experiment, part.trials, part.rows)
            seconds = profile_seconds(part.rows) + seconds
    if seconds:
        shown.append(seconds_table(seconds))
    for name in ("stages", "compaction", "loops"):
        shown += _joined(name, parts)
    quiet = [number_table(pairs)] if pairs else []
    quiet += [table for part in parts if part.experiment is None for table in part.tables]
    return shown, quiet


def printed_pairs(parts: Sequence[PartResult]) -> Iterator[PrintedPair]:
    """The pairs of the tables 6.1 to 6.5, in their order."""
    found = [
        PrintedPair(name, pair, part.experiment, rows)
        for part in parts
        if part.experiment is not None and part.rows is not None and "given" in part.rows
        for name, pair in part.experiment.pairs.items()
        if pair.printed is not None and pair.estimated is not None
        for rows in [part.rows[(part.rows["pair"] == name) & (part.rows["given"] == "")]]
    ]
    yield from sorted(found, key=lambda each: each.name)


def comparison_table(pairs: Sequence[PrintedPair]) -> Table:
    """Table by table, whether a method's median error is smaller than the one printed."""
    records = []
    for each in pairs:
        theirs = thesis_values(each.pair, each.experiment.rotation_labels)
        assert theirs is not None
        for method in each.methods:
            rows = each.of(method)
            record: dict[str, Any] = {"Table": each.name, "Method": method}
            answered = rows["status"] == "ok"
            record["Answered"] = rate(int(answered.sum()), len(rows))
            limits = f"{COARSE.rotation_deg:g} deg, {COARSE.translation_mm:g} mm"
            record[f"Within {limits}"] = rate(int(within(rows, COARSE).sum()), len(rows))
            for column, what, unit, limit in zip(
                ERRORS, ("Rotation", "Translation"), ("deg", "mm"), theirs[1][6:],
                strict=True,
            ):  # fmt: skip
                errors = rows[column].where(answered, np.inf).to_numpy(dtype=np.float64)
                middle = median_of(errors)
                record[f"{what} error ({unit})"] = middle.text(".2f")
                record[f"Thesis's ({unit})"] = limit
                record[f"{what} smaller"] = "yes" if middle.middle < limit else "no"
            records.append(record)
    formats = {"Thesis's (deg)": ".2f", "Thesis's (mm)": ".2f"}
    return Table(
        "against_thesis",
        "Errors beside those the thesis printed",
        "Median angle and length of the error over all trials, one without an answer counting as "
        "infinitely wrong (none), with the median's 95 % interval by order statistics; rates with "
        "Wilson's 95 % interval. The thesis's error is that of its one estimate against its own "
        "theoretical values, ours is against the exact pose.",
        pd.DataFrame(records),
        formats,
        in_full=True,
    )


def estimate_table(pairs: Sequence[PrintedPair]) -> Table:
    """Every row of the tables 6.1 to 6.5: exact, by encoders, the thesis's, and by each method."""
    methods = list(dict.fromkeys(method for each in pairs for method in each.methods))
    records: list[dict[str, Any]] = []
    for each in pairs:
        assert each.pair.printed is not None
        labels = each.experiment.rotation_labels
        theirs = thesis_values(each.pair, labels)
        assert theirs is not None
        first = each.rows.iloc[0]
        exact, encoders = (_six(first, kind) for kind in ("exact", "theoretical"))
        known = [exact, encoders, printed_six(each.pair.printed, labels), np.array(theirs[0])]
        answered = {m: each.of(m)[each.of(m)["status"] == "ok"] for m in each.methods}
        records.append(
            {"Table": each.name, "Parameter": "Answered"}
            | {m: rate(len(answered[m]), len(each.of(m))) for m in each.methods}
        )
        for place, (name, column) in enumerate(zip(NAMES, PARAMETERS, strict=True)):
            label = "XYZ"[LABEL_ORDER[labels][place]] if place < 3 else ""
            if label not in name[:10]:
                name += f", printed as {label}"
            record: dict[str, Any] = {"Table": each.name, "Parameter": name}
            record |= dict(zip(KNOWN, (float(six[place]) for six in known), strict=True))
            for method, rows in answered.items():
                record[method] = _median(rows, f"estimated_{column}").text(".2f")
            records.append(record)
        off = theoretical_error(first)
        for place, (name, column) in enumerate(zip(ERROR_NAMES, ERRORS, strict=True)):
            record = {"Table": each.name, "Parameter": name}
            record |= {KNOWN[1]: off[place], KNOWN[3]: theirs[1][6 + place]}
            for method, rows in answered.items():
                record[method] = _median(rows, column).text(".2f")
            records.append(record)
    frame = pd.DataFrame(records)[["Table", "Parameter", *KNOWN, *methods]]
    return Table(
        "summary",
        "Tables 6.1 to 6.5, all rows",
        "Encoders: what the arm's encoders and the nominal tool centre point say, by (3-1), the "
        "thesis's theoretical values. Of a method: median over the trials that it answered, their "
        "number above, and the median's 95 % interval by order statistics; without noise there is "
        "one trial. Where the thesis's label names another axis than the one that was turned, it "
        "stands as printed. Errors are against the exact pose, the thesis's own against its "
        "theoretical one.",
        frame,
        dict.fromkeys(KNOWN, ".2f"),
        in_full=True,
    )


KNOWN = ("Exact", "Encoders", "Thesis, theoretical", "Thesis, estimate")


def number_table(pairs: Sequence[PrintedPair]) -> Table:
    """The medians and intervals of estimates and errors as numbers, a row each."""
    records = []
    for each in pairs:
        for method in each.methods:
            rows = each.of(method)
            answered = rows[rows["status"] == "ok"]
            for name, columns in (
                *((c, (f"estimated_{c}", f"error_{c}")) for c in PARAMETERS),
                *((c, (None, c)) for c in ERRORS),
            ):
                record: dict[str, Any] = {"table": each.name, "method": method, "parameter": name}
                record |= {"trials": len(rows), "answered": len(answered)}
                for what, column in zip(("estimate", "error"), columns, strict=True):
                    middle = Median(np.nan, np.nan, np.nan)
                    if column is not None:
                        middle = _median(answered, column)
                    record |= dict(
                        zip((f"{what}_median", f"{what}_low", f"{what}_high"), middle, strict=True)
                    )
                records.append(record)
    frame = pd.DataFrame(records)
    return Table(
        "summary_numbers",
        "Medians over the answered trials and their 95 % intervals",
        "Estimates in the frame of the target view, errors as estimate minus exact value; degrees "
        "and mm as the parameter's name says.",
        frame,
        {"trials": "d", "answered": "d"} | dict.fromkeys(frame.columns[5:], ".3f"),
    )


def seconds_table(records: Sequence[dict[str, Any]]) -> Table:
    """The seconds of a registration beside those that the thesis tells."""
    frame = pd.DataFrame(records)
    frame["Times faster"] = frame["Thesis (s)"] / frame["Ours (s)"]
    return Table(
        "seconds",
        "Time of a registration beside the thesis's",
        "Thesis: Matlab on a Pentium III at 933 MHz, as sections 6.2 to 6.5 tell. Ours: median "
        "over all trials of the whole method from scans to pose, one core of the machine in "
        "run.json, which computed other trials on the others at the same time.",
        frame,
        {"Thesis (s)": ".0f", "Ours (s)": ".3f", "Times faster": ".0f"},
        in_full=True,
    )


def _seconds(each: PrintedPair) -> Iterator[dict[str, Any]]:
    for method in each.methods:
        ms = each.of(method)["ms_registration"].astype(np.float64).median()
        yield {
            "What": f"Table {each.name}, one pair of views",
            "Method": method,
            "Thesis (s)": THESIS_SECONDS.get(each.name, np.nan),
            "Ours (s)": float(ms) / 1e3,
        }


def _joined(name: str, parts: Sequence[PartResult]) -> list[Table]:
    """The tables of this name of all parts as one, or none."""
    found = [(part.name, table) for part in parts for table in part.tables if table.name == name]
    if not found:
        return []
    first = found[0][1]
    notes = "".join(table.note for _, table in found)
    formats = {column: form for _, table in found for column, form in table.formats.items()}
    frame = part_by_part(found)
    return [Table(name, first.title, first.caption, frame, formats, notes, in_full=True)]


def part_by_part(tables: Sequence[tuple[str, Table]]) -> pd.DataFrame:
    """The frames of tables one below the other, each line with the name of its part."""
    frames = [table.frame.copy() for _, table in tables]
    for frame, (part, _) in zip(frames, tables, strict=True):
        frame.insert(0, "Part", part)
    return pd.concat(frames, ignore_index=True)


def _six(row: pd.Series[Any], kind: str) -> FloatArray:
    six: FloatArray = row[[f"{kind}_{column}" for column in PARAMETERS]].to_numpy(dtype=np.float64)
    return six


def _median(rows: pd.DataFrame, column: str) -> Median:
    return median_of(rows[column].to_numpy(dtype=np.float64))
