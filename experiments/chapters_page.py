"""The page of a run of several experiments: its summary first, then each part as a section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments.chapter_summary import PartResult
from experiments.chapters import PAIRS, ChaptersExperiment, PartRun
from harness.pool import MakeExecutor
from harness.report.page import Shown
from harness.report.run_page import plain_part, run_part, write_page
from harness.table_files import Table


def write_chapters_page(
    experiment: ChaptersExperiment,
    folder: Path,
    runs: Sequence[PartRun],
    results: Sequence[PartResult],
    summary: Sequence[Table],
    make_executor: MakeExecutor,
) -> Path:
    """Build the page from what the parts left in their folders; returns its file."""
    whole = plain_part(folder, "All parts summed up", experiment.description, summary)
    parts = [replace(whole, name="all-parts")]  # no folder of a part can have this name
    shown = Shown()
    for run, result in zip(runs, results, strict=True):
        if run.kind == PAIRS:
            part, of_part = run_part(run.session(), result.tables, make_executor, f"{run.name}-")
            shown = shown.joined(of_part)
        else:
            checked = run.check()
            part = plain_part(run.folder, checked.title, checked.description, result.tables)
        parts.append(part)
    return write_page(folder, experiment.title, parts, shown)
