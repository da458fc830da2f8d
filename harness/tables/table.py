"""A table as a type, and as files: csv with raw numbers, md and tex as one reads them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tabulate import tabulate

if TYPE_CHECKING:  # it takes 0.4 s to import, which the first trial need not wait for
    import pandas as pd


@dataclass(frozen=True)
class Table:
    """Rows with raw values, and how to print them.

    name: the stem of its files. caption: how to read it. note: what only this table has to say.
    formats: a format specification ("+.2f") by column; text columns have none.
    norms: the rows of angles and lengths, whose numbers have no sign.
    in_full: whether a terminal shows it whole, however long. quiet: not at all.
    """

    name: str
    title: str
    caption: str
    frame: pd.DataFrame
    formats: dict[str, str] = field(default_factory=dict)
    note: str = ""
    norms: tuple[int, ...] = ()
    in_full: bool = False
    quiet: bool = False

    @property
    def legend(self) -> str:
        """Caption and note."""
        return f"{self.caption} {self.note}".strip()

    def text(self) -> list[list[str]]:
        """The rows as printed; nothing where there is no number."""
        return [
            [
                printed(value, self._format(column, place))
                for column, value in zip(self.frame.columns, row, strict=True)
            ]
            for place, row in enumerate(self.frame.itertuples(index=False))
        ]

    def csv(self) -> str:
        """The raw numbers; beyond the ninth decimal there is only rounding."""
        return str(self.frame.round(9).to_csv(index=False, lineterminator="\n"))

    def latex(self) -> str:
        """The table as printed, for LaTeX with booktabs."""
        return (
            "% needs \\usepackage{booktabs}\n\\begin{table}\n\\centering\n"
            f"\\caption{{{_escaped(self.title)}. {_escaped(self.legend)}}}\n"
            f"{self.grid('latex_booktabs')}\n\\end{{table}}\n"
        )

    def grid(self, style: str) -> str:
        """The table as printed, in a style of tabulate."""
        header, rows = list(self.frame.columns), self.text()
        aligned = ["right" if column in self.formats else "left" for column in header]
        alignment = aligned if rows else None
        return str(tabulate(rows, header, style, colalign=alignment, disable_numparse=True))

    def _format(self, column: str, place: int) -> str:
        specification = self.formats.get(column, "")
        return specification.removeprefix("+") if place in self.norms else specification


def write_tables(tables: Iterable[Table], folder: Path) -> list[Path]:
    """Write each table as csv, md and tex; tables of an earlier run are removed before."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        if old.suffix in (".csv", ".md", ".tex"):
            old.unlink()
    return [write_table(table, folder) for table in tables]


def write_table(table: Table, folder: Path) -> Path:
    """Write one table beside others as csv, md and tex; returns the csv."""
    csv = folder / f"{table.name}.csv"
    csv.write_text(table.csv(), encoding="utf-8")
    (folder / f"{table.name}.md").write_text(
        f"**{table.title}.** {table.legend}\n\n{table.grid('github')}\n", encoding="utf-8"
    )
    (folder / f"{table.name}.tex").write_text(table.latex(), encoding="utf-8")
    return csv


def printed(value: object, specification: str) -> str:
    """A value as text: nothing for NaN, "none" for infinity, no sign on zero."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if specification:
        if isinstance(value, float) and math.isinf(value):
            return "none"
        text = format(value, specification)
        # -0.00 says no more than 0.00.
        return text if text.strip("+-0.") else text.lstrip("+-")
    return str(value)


def _escaped(text: str) -> str:
    marks = {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "$": r"\$", "°": r"$^\circ$"}
    return "".join(marks.get(c, c) for c in text)
