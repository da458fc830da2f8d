"""The page of a run, from its results folder: every experiment ends with it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.config.errors import ConfigError
from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import load_experiment
from harness.figures.of_rows import STUDY
from harness.report.answer import answer_sentence, answer_table, main_label
from harness.report.failures import failures_markup, failures_table, replay_command
from harness.report.offered import offered, worst_first
from harness.report.packing import write_whole
from harness.report.page import FILE_NAME, Part, Shown, page_markup
from harness.report.pair_studies import pair_study
from harness.report.record_paths import RECORDS
from harness.report.records import provided
from harness.report.studies import study
from harness.scoring.row_scores import ERRORS
from harness.session import Session
from harness.store import load
from harness.tables.table import Table, write_table
from harness.workers.pool import MakeExecutor

LISTED = 20_000  # trials that are found by their id
SENSOR_TABLES = ("sensor_card", "geometry_fits", "arm")


def write_run_page(session: Session, tables: Sequence[Table], make_executor: MakeExecutor) -> Path:
    """Build the page of a run with trials; returns its file.

    tables: all that session.report made. make_executor: for trials that have to be replayed.
    """
    part, shown = run_part(session, tables, make_executor)
    return write_page(session.folder, session.experiment.title, [part], shown)


def write_page(folder: Path, title: str, parts: Sequence[Part], shown: Shown | None = None) -> Path:
    """Write a page into a results folder; returns its file."""
    path = folder / FILE_NAME
    write_whole(path, page_markup(title, parts, shown or Shown()).encode("utf-8"))
    return path


def run_part(
    session: Session, tables: Sequence[Table], make_executor: MakeExecutor, prefix: str = ""
) -> tuple[Part, Shown]:
    """What a page says of one run, and what it shows of it in 3D."""
    sweep = session.experiment.sweep
    main = main_label(session.experiment)
    rows = load(session.folder, arrays=False)
    folder = session.folder / RECORDS
    wanted = offered(rows, session.drawn_labels, main)
    shown = set(wanted)
    by_id = {trial.id: trial for trial in session.trials if trial.id in shown}
    records = provided(wanted, by_id, rows, folder, make_executor)
    command = ["run-experiment", str(_config_file(session))]
    failures = failures_table(rows)
    if len(failures.frame):  # the page may hold its beginning only
        write_table(failures, session.folder / "tables")
    named = [table for table in tables if table.name not in ("failures", "curves")]
    part = Part(
        name=session.folder.name,
        title=session.experiment.title,
        description=session.experiment.description,
        sentence=_sentence(session, rows, tables),
        # Over points of a sweep taken together it would say how they were chosen.
        answer=answer_table(session.experiment, rows) if sweep is None else None,
        tables=[table for table in named if table.name not in SENSOR_TABLES],
        sensor=[table for table in named if table.name in SENSOR_TABLES],
        figures=sorted(
            (session.folder / "figures").glob("*.png"),
            key=lambda file: (not file.name.startswith(STUDY), file.name),
        ),
        failures=failures_markup(failures, command, records.keys(), folder, prefix),
        config=text_of(session.folder / "config.yaml"),
        facts=text_of(session.folder / "run.json"),
        command=" ".join(command),
        study=_study(session, rows),
    )
    folders = dict.fromkeys(records, folder)
    # What is seen first is the first repeat of the method that the answer is about, if any is kept.
    own = [key for key, found in records.items() if found["method"] == main]
    first = min(own, key=lambda key: records[key]["repeat"], default="")
    asked = {} if part.study is None else {i for p in part.study["points"] for i in p["ids"]}
    listed = listed_trials(rows, command, asked)
    return part, Shown(records, folders, listed, first, int((rows["given"] == "").sum()))


def _study(session: Session, rows: pd.DataFrame) -> dict[str, Any] | None:
    experiment = session.experiment
    if experiment.sweep is not None:
        return study(rows, experiment.sweep.design)
    return pair_study(rows, experiment) if isinstance(experiment, RandomPairsExperiment) else None


def _sentence(session: Session, rows: pd.DataFrame, tables: Sequence[Table]) -> str:
    """The answer: of a study its conclusion, of another sweep what all its points sum up to."""
    told = [table.note for table in tables if table.name.startswith("study_") and table.note]
    if told:
        return " ".join(told[0].split())
    summed = answer_sentence(session.experiment, rows)
    return summed if session.experiment.sweep is None else f"All points together: {summed}"


def plain_part(folder: Path, title: str, description: str, tables: Sequence[Table]) -> Part:
    """What a page says of a results folder without trials, as of the precision of the sensor."""
    return Part(
        name=folder.name,
        title=title,
        description=description,
        tables=[table for table in tables if table.name not in SENSOR_TABLES],
        sensor=[table for table in tables if table.name in SENSOR_TABLES],
        figures=sorted((folder / "figures").glob("*.png")),
        config=text_of(folder / "config.yaml"),
        facts=text_of(folder / "run.json"),
    )


def listed_trials(
    rows: pd.DataFrame, command: Sequence[str], asked: Collection[str] = ()
) -> list[dict[str, Any]]:
    """Trials of the whole method for the list that is searched, the worst first.

    All of them up to LISTED; of more, the worst and those asked for.
    """
    names = ["id", "pair", "method", "repeat", "status", *ERRORS]
    whole = rows.loc[rows["given"] == "", names]
    bad = worst_first(whole)
    good = whole.drop(bad.index).sort_values("translation_error_mm", ascending=False, kind="stable")
    whole = pd.concat([bad, good])
    if len(whole) > LISTED:
        kept = whole["id"].isin(list(asked)).to_numpy(copy=True)
        kept[:LISTED] = True
        whole = whole[kept]
    return [
        {
            "id": row["id"],
            "pair": row["pair"],
            "method": row["method"],
            "repeat": int(row["repeat"]),
            "status": row["status"],
            "deg": _number(row["rotation_error_deg"]),
            "mm": _number(row["translation_error_mm"]),
            "command": replay_command(command, row["id"]),
        }
        for row in whole.to_dict("records")
    ]


def _config_file(session: Session) -> Path:
    """A config that makes the same trials: the run's own file, else the resolved one beside it."""
    try:
        same = load_experiment(session.file) == session.experiment
    except ConfigError:
        same = False
    return session.file if same else session.folder / "config.yaml"


def _number(value: float) -> float | None:
    return round(float(value), 6) if np.isfinite(value) else None


def text_of(path: Path) -> str:
    """What a text file holds; nothing where there is none."""
    return path.read_text(encoding="utf-8") if path.exists() else ""
