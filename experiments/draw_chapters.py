"""Draws the numbered figures of chapters 4 to 6 from the parts of a run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from experiments.chapter_figures import (
    FIGURES,
    PLANAR_FIGURES,
    MissingEvidenceError,
)
from experiments.chapter_summary import PartResult
from experiments.profile_figures import telling_pair
from experiments.profile_pairs import register_profiles
from harness.execution import perform
from harness.figures.page import page_style, save
from harness.provenance import code_fingerprint
from harness.tables.table import Table
from harness.trials.specs import Trial
from harness.workers.pool import MakeExecutor, shutting_down

METHOD = "thesis"
LIST = "drawn.json"


class Drawing(NamedTuple):
    """A numbered figure: of what it was drawn, or why it was not."""

    number: str
    file: str
    of: str
    problem: str = ""


def draw_chapters(
    parts: Sequence[PartResult], folder: Path, make_executor: MakeExecutor, redraw: bool = True
) -> Table:
    """Draw every numbered figure that these parts have results for; returns their list.

    redraw: also those that were drawn before of the same trials by the same code.
    """
    folder.mkdir(parents=True, exist_ok=True)
    shown = [(part, _trials_of(part)) for part in parts if part.rows is not None]
    of = [code_fingerprint(()), *(trial.id for _, trials in shown for trial in trials)]
    kept = None if redraw else _kept(folder, of)
    if kept is not None:
        return figure_table(kept)
    for old in (folder / LIST, *folder.glob("figure_*.png")):
        old.unlink(missing_ok=True)
    with shutting_down(make_executor()) as executor:
        jobs = []
        for part, trials in shown:
            if part.rows is not None and "profile" in part.rows:
                jobs.append(executor.submit(draw_planar, trials, part.rows, folder))
                continue
            pairs = {trial.pair for trial in trials}
            numbers = [figure.number for figure in FIGURES if pairs >= set(figure.pairs)]
            jobs += [
                executor.submit(draw_numbered, trials, share, folder) for share in _shares(numbers)
            ]
        drawings = [drawing for job in jobs for drawing in job.result()]
    text = json.dumps({"of": of, "drawings": drawings}, indent=2)
    (folder / LIST).write_text(text + "\n", encoding="utf-8")
    return figure_table(drawings)


def _trials_of(part: PartResult) -> list[Trial]:
    """The trials that the figures of a part show, all of profiles in the first."""
    assert part.rows is not None
    return list(part.trials[:1]) if "profile" in part.rows else shown_trials(part)


def _kept(folder: Path, of: Sequence[str]) -> list[Drawing] | None:
    """What was drawn of the same trials by the same code, if all of it is still there."""
    try:
        data = json.loads((folder / LIST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    drawings = [Drawing(*drawing) for drawing in data["drawings"]]
    there = all((folder / drawing.file).exists() for drawing in drawings)
    return drawings if there and data["of"] == list(of) else None


def shown_trials(part: PartResult) -> list[Trial]:
    """The trials by `thesis` of the first repeat in which most printed pairs were answered.

    By what was answered, never by how well; one for each printed pair.
    """
    assert part.experiment is not None
    assert part.rows is not None
    printed = {name for name, pair in part.experiment.pairs.items() if pair.printed is not None}
    trials = [
        trial
        for trial in part.trials
        if trial.spec.method.name == METHOD and not trial.spec.given and trial.pair in printed
    ]
    labels = list(dict.fromkeys(trial.label for trial in trials))[:1]
    answered = set(part.rows.loc[part.rows["status"] == "ok", "id"])
    by_repeat: dict[int, list[Trial]] = {}
    for trial in trials:
        if trial.label in labels:
            by_repeat.setdefault(trial.spec.repeat, []).append(trial)
    if not by_repeat:
        return []
    return max(by_repeat.values(), key=lambda group: sum(trial.id in answered for trial in group))


def draw_numbered(trials: Sequence[Trial], numbers: Sequence[str], folder: Path) -> list[Drawing]:
    """Register these trials and draw the figures of these numbers; runs in a worker."""
    pairs = {trial.pair: view for trial in trials if (view := perform(trial).pair) is not None}
    drawings = []
    for figure in FIGURES:
        if figure.number not in numbers:
            continue
        of = ", ".join(f"table {name}" for name in figure.pairs)
        repeat = trials[0].spec.repeat
        of += f", repeat {repeat}"
        file = folder / f"figure_{figure.number}.png"
        title = f"Figure {figure.number}, simulated: {figure.shows}"
        try:
            with page_style():
                save(figure.draw({name: pairs[name] for name in figure.pairs}, title), file)
        except (MissingEvidenceError, KeyError) as error:
            reason = str(error) if isinstance(error, MissingEvidenceError) else "no overlap"
            drawings.append(Drawing(figure.number, "", of, reason))
            continue
        drawings.append(Drawing(figure.number, file.name, of))
    return drawings


def draw_planar(trials: Sequence[Trial], rows: pd.DataFrame, folder: Path) -> list[Drawing]:
    """Draw the figures of the registration in the plane, of the first method; runs in a worker."""
    trial = trials[0]
    of_method = rows[(rows["method"] == trial.label) & (rows["pair"] == trial.pair)]
    first = of_method[of_method["repeat"] == trial.spec.repeat]
    shown = telling_pair(list(register_profiles(trial)))
    drawings = []
    for figure in PLANAR_FIGURES:
        of = f"pair {trial.pair}, repeat {trial.spec.repeat}"
        if shown is None:
            drawings.append(Drawing(figure.number, "", of, "no pair of profiles was answered"))
            continue
        where = f"Foam, simulated, method {trial.label}"
        if figure.number.startswith("4"):
            place = f"profile {shown[0].profile} at {shown[0].elevation_mm:.0f} mm"
            of, where = f"{of}, {place}", f"{where}, {place}"
        file = folder / f"figure_{figure.number}.png"
        with page_style():
            save(figure.draw(*shown, first, where), file)
        drawings.append(Drawing(figure.number, file.name, of))
    return drawings


def figure_table(drawings: Sequence[Drawing]) -> Table:
    """The list of figures: what each shows and what to look at."""
    known = {figure.number: (figure.shows, figure.look) for figure in FIGURES}
    known |= {figure.number: (figure.shows, figure.look) for figure in PLANAR_FIGURES}
    records = [
        {
            "Figure": drawing.number,
            "File": drawing.file or f"none: {drawing.problem}",
            "Shows": known[drawing.number][0],
            "Look at": known[drawing.number][1],
            "Of": drawing.of,
        }
        for drawing in sorted(drawings, key=lambda d: [int(n) for n in d.number.split(".")])
    ]
    return Table(
        "figures",
        "Figures by their numbers in the thesis",
        "All by the method thesis, on simulated scans; of the first repeat in which most pairs of "
        "the experiment were answered.",
        pd.DataFrame(records, columns=["Figure", "File", "Shows", "Look at", "Of"]),
    )


def _shares(numbers: Sequence[str]) -> list[list[str]]:
    """Two halves, so that no worker is left with all the figures of one part."""
    half = -(-len(numbers) // 2)
    return [list(numbers[:half]), list(numbers[half:])] if numbers else []
