"""The page of a run of several experiments: its summary first, then each part as a section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments.chapter_summary import PartResult, part_by_part
from experiments.chapters import ChaptersExperiment, PartRun
from harness.config.reading import PAIRS
from harness.report.answer import OURS, scores
from harness.report.page import Part, Shown
from harness.report.run_page import plain_part, run_part, write_page
from harness.scoring.chance import wilson_interval
from harness.scoring.poses import COARSE
from harness.tables.table import Table
from harness.workers.pool import MakeExecutor


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
    parts[0] = replace(parts[0], sentence=_sentence(results), answer=_answer(parts))
    return write_page(folder, experiment.title, parts, shown)


def _sentence(results: Sequence[PartResult]) -> str:
    """How often the project's own method was right over all parts that register whole scans."""
    found = [
        score
        for result in results
        if result.rows is not None and "given" in result.rows
        for score in scores(result.rows)
        if score.label == OURS
    ]
    if not found:
        return ""
    right, trials = sum(score.right for score in found), sum(score.trials for score in found)
    low, high = wilson_interval(right, trials)
    return (
        f"Over {len(found)} parts, {OURS} registered {right} of {trials} trials within "
        f"{COARSE.rotation_deg:g}° and {COARSE.translation_mm:g} mm (95 % interval {low:.0%} to "
        f"{high:.0%}); the table says what every part found, and what the thesis printed."
    )


def _answer(parts: Sequence[Part]) -> Table | None:
    """The answers of the parts, one below the other."""
    answers = [(part.name, part.answer) for part in parts if part.answer is not None]
    if not answers:
        return None
    return replace(answers[0][1], title="Part by part", frame=part_by_part(answers), note="")
