"""What a study found: tables, figures and a conclusion of two sentences, from its rows alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from harness.config.random_schema import RandomPairsExperiment
from harness.figures.of_rows import STUDY
from harness.figures.page import page_style, save
from harness.studies.curves import curves_conclusion, curves_table, draw_errors, draw_success
from harness.studies.effects import draw_effects, effects_conclusion, effects_table
from harness.studies.grid import draw_grid, grid_conclusion, grid_table
from harness.studies.indices import (
    IncompleteError,
    draw_failure_map,
    draw_indices,
    indices_conclusion,
    indices_table,
    progress_table,
)
from harness.studies.overlap import draw_overlap, overlap_conclusion, overlap_table
from harness.studies.ranking import draw_ranking, ranking_conclusion, ranking_table
from harness.tables.table import Table


@dataclass(frozen=True)
class Findings:
    """Of a study: its tables, the answer's first, and its figures by name.

    The frame of a table holds the raw numbers of the figures that show it; the note of the first
    one is the conclusion, two lines.
    """

    tables: tuple[Table, ...]
    figures: Mapping[str, Callable[[], Figure]]


def find(experiment: RandomPairsExperiment, rows: pd.DataFrame) -> Findings:
    """What the study of an experiment found; nothing is drawn before its figures are called.

    rows: as store.load gives them. An incomplete design gets a table that says so.
    """
    study, sweep = experiment.study, experiment.sweep
    if study is None:
        raise ValueError(f"{experiment.title} has no study")
    names = study.names
    draws: Mapping[str, Callable[[pd.DataFrame, str], Figure]]
    if study.kind == "indices" and sweep is not None:
        try:
            table = indices_table(rows, sweep, names)
        except IncompleteError as error:
            return Findings((progress_table(error),), {})
        lines = indices_conclusion(table.frame)
        draws = {
            "indices": draw_indices,
            "failures": lambda frame, note: draw_failure_map(rows, frame, sweep, names, note),
        }
    elif study.kind == "curves":
        table = curves_table(rows, names)
        lines = curves_conclusion(rows, table.frame)
        draws = {"success": draw_success, "errors": draw_errors}
    elif study.kind == "effects":
        table = effects_table(rows)
        lines = effects_conclusion(rows, table.frame)
        draws = {"effects": draw_effects}
    elif study.kind == "grid":
        table = grid_table(rows, study.profiles_per_s)
        lines = grid_conclusion(rows, table.frame)
        draws = {"failures": draw_grid}
    elif study.kind == "overlap":
        table = overlap_table(rows, experiment.overlap)
        lines = overlap_conclusion(rows, table.frame)
        draws = {"overlap": draw_overlap}
    else:
        table = ranking_table(rows)
        lines = ranking_conclusion(rows, table.frame)
        draws = {"ranking": draw_ranking}
    note = " ".join(lines)
    figures = {name: partial(draw, table.frame, note) for name, draw in draws.items()}
    return Findings((replace(table, note="\n" + "\n".join(lines)),), figures)


def draw_study(findings: Findings, folder: Path) -> list[Path]:
    """Draw the figures of a study; returns the files, PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, draw in findings.figures.items():
        with page_style():
            files.append(save(draw(), folder / f"{STUDY}{name}.png"))
    return files
