"""What the command prints: how trials ended, in words, then tables and paths."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table as RichTable

from harness.store import Row
from harness.tables.table import Table
from harness.trials.specs import Trial

# Columns of text are as wide as their words where nobody watches: a log is not cut to 80 columns.
LOG_WIDTH = 160

# Of a long list, as of many failures, the terminal shows the beginning; the files have it all.
SHOWN_ROWS = 12


def make_console() -> Console:
    """The terminal, or a wide plain one when the output goes to a file."""
    console = Console(highlight=False, markup=False)  # brackets are plain text here
    if not console.is_terminal:
        console = Console(highlight=False, markup=False, width=LOG_WIDTH)
    return console


def trial_name(trial: Trial) -> str:
    """A trial as a reader of the config knows it."""
    entered = f" with true {trial.spec.given.replace('_', ' ')}" if trial.spec.given else ""
    at = f", {trial.point}" if trial.point is not None else ""
    return f"{trial.pair}, {trial.label}{entered}, repeat {trial.spec.repeat}{at}"


def outcome(row: Row) -> str:
    """The end of a trial in a few words."""
    if row.rotation_error_deg is None or row.translation_error_mm is None:
        return f"{row.status}: {row.reason}"
    errors = f"{row.rotation_error_deg:.3f} deg, {row.translation_error_mm:.2f} mm off"
    return f"{row.status}, {errors}" + (f" ({row.reason})" if row.reason else "")


def show_tables(console: Console, tables: Iterable[Table]) -> None:
    """Print the tables, each caption once; where a method has no estimate its reason is enough."""
    told: set[str] = set()
    for table in tables:
        if table.quiet:
            continue
        estimates = table.frame.get("Our estimate")
        if estimates is not None and estimates.isna().all():
            console.print(f"{table.title}: {table.note}\n")
            continue
        caption = table.note if table.caption in told else table.legend
        told.add(table.caption)
        _show_table(console, table, caption)


def _show_table(console: Console, table: Table, caption: str) -> None:
    shown = RichTable(
        title=table.title,
        title_justify="left",
        title_style="bold",
        caption=caption,
        caption_justify="left",
        caption_style="dim",
        box=box.SIMPLE_HEAD,
    )
    for column in table.frame.columns:
        shown.add_column(column, justify="right" if column in table.formats else "left")
    rows = table.text()
    shortened = len(rows) > SHOWN_ROWS and not table.in_full
    for row in rows[:SHOWN_ROWS] if shortened else rows:
        shown.add_row(*row)
    if shortened:
        shown.caption = f"The first {SHOWN_ROWS} of {len(rows)}. {shown.caption}"
    console.print(shown)
    console.print()


def show_paths(console: Console, folder: Path) -> None:
    """Print what a results folder holds, one line a kind."""
    console.print("Written:")
    for pattern, what in (
        ("report.html", "all of it on one page, opens in any browser"),
        ("tables/*.csv", "tables as csv, md and tex"),
        ("figures/*.png", "figures"),
        ("calibration.json", "bias and noise of the sensor, for registration"),
        ("scans/*.ply", "scans and merged clouds, in mm"),
        ("profiles.csv", "one row a pair of profiles"),
        ("trials.sqlite", "one row a trial"),
        ("config.yaml", "the configuration with all defaults"),
        ("run.json", "versions and machine"),
    ):
        files = sorted(folder.glob(pattern))
        if files:
            count = f"{len(files)} " if "*" in pattern else ""
            place = folder / pattern.split("*")[0]
            console.print(f"  {place}  {count}{what}", soft_wrap=True)
