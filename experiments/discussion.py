"""The experiment `discussion`: what section 6.6 says of its results, asked of the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from experiments.commands import available_cores, replay
from experiments.discussion_trials import Asked, DiscussionExperiment, load_discussion
from experiments.progress import Tally, reporting
from experiments.terminal import make_console
from experiments.turned_rotation import Turning, middle_mm, turn
from harness.config.errors import ConfigError
from harness.config.reading import dump_yaml
from harness.provenance import code_fingerprint, note_run
from harness.results import check_folder, results_folder
from harness.store import FILE_NAME, Store, load
from harness.tables.card import card_table
from harness.tables.pairs import theoretical_error
from harness.tables.table import Table, write_tables
from harness.trials.specs import TrialSpec
from harness.workers.child import Task
from harness.workers.pool import MakeExecutor, process_pool
from harness.workers.runner import run


class TrialError(RuntimeError):
    """Trials that ended with an exception; the message holds the first one's traceback."""


def run_discussion(
    path: Path,
    folder: Path | None,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    workers: int | None = None,
) -> tuple[list[Table], Path]:
    """Perform what is missing, write rows, tables and figures; returns the tables and the folder.

    workers: processes, one for each core when not given. Raises ConfigError before anything is
    written. Rows are kept one by one: a run that was cut off goes on where it stopped. Raises
    TrialError in the end where trials ended with an error.
    """
    from experiments.discussion_figures import draw_discussion
    from experiments.discussion_tables import discussion_tables

    experiment, asked = load_discussion(path, overrides, seed)
    folder = results_folder(folder, path.stem)
    check_folder(folder)
    make_executor = process_pool(min(workers or available_cores(), len(asked)))
    rows = perform_asked(asked, folder, make_executor)
    turned = turn_rotations(experiment, asked, make_executor)
    (folder / "config.yaml").write_text(
        dump_yaml(experiment.model_dump(mode="json")), encoding="utf-8"
    )
    turned.to_csv(folder / "turned.csv", index=False)
    tables = [*discussion_tables(experiment, rows, turned), *cards(asked)]
    write_tables(tables, folder / "tables")
    draw_discussion(experiment, rows, turned, folder / "figures")
    errors = rows[rows["status"] == "error"]
    if len(errors):
        first = errors.iloc[0]
        raise TrialError(f"{len(errors)} trials failed, {first['id']} first:\n{first['traceback']}")
    return tables, folder


def cards(asked: Sequence[Asked]) -> list[Table]:
    """The card of the sensor, or of every one where the scenes have different ones; quiet."""
    scenes: dict[str, list[str]] = {}
    sensors = {}
    for a in asked:
        sensor = a.trial.spec.sensor
        key = repr(sensor)
        sensors[key] = sensor
        if a.scene not in scenes.setdefault(key, []):
            scenes[key].append(a.scene)
    tables = []
    for key, sensor in sensors.items():
        card = card_table(sensor.name, sensor.params)
        if card is not None:
            name = card.name if len(sensors) == 1 else "_".join([card.name, *scenes[key]])
            tables.append(replace(card, name=name, quiet=True))
    return tables


def rehearse_discussion(
    path: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> list[str]:
    """What a run would do, in lines; writes nothing. Raises ConfigError."""
    experiment, asked = load_discussion(path, overrides, seed)
    folder = results_folder(folder, path.stem)
    performed = _performed(asked)
    missing = len(_missing(performed, folder))
    number = len({a.trial.id for a in performed})  # two questions may ask for the same trial
    return [
        f"{experiment.title}: {number} trials, {missing} of them to compute, at some 0.2 s each on "
        "one core; rotations are turned and figures drawn in half a minute",
        f"Would be written to {folder}",
    ]


def replay_asked(path: Path, overrides: Sequence[str], seed: int | None, identity: str) -> int:
    """Perform one trial and print its row; writes nothing. Raises ConfigError."""
    asked = _performed(load_discussion(path, overrides, seed)[1])
    return replay([a.trial for a in asked], identity)


def check_rows(
    path: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> None:
    """Raise ConfigError where a folder lacks rows of this very config and code."""
    asked = load_discussion(path, overrides, seed)[1]
    folder = results_folder(folder, path.stem)
    missing = len(_missing(_performed(asked), folder))
    if missing:
        message = f"{folder} lacks {missing} rows of this config and code; run it without first"
        raise ConfigError("--report-only", (), message)


def _performed(asked: Sequence[Asked]) -> list[Asked]:
    """Those that are performed as trials: all but those whose rotation is turned."""
    return [a for a in asked if a.question != "turned"]


def _code(asked: Sequence[Asked]) -> str:
    return code_fingerprint({a.trial.spec.method.name for a in asked})


def _missing(asked: Sequence[Asked], folder: Path) -> set[str]:
    """Ids of the trials without a row of this code; makes no store where there is none."""
    ids = {a.trial.id for a in asked}
    if not (folder / FILE_NAME).exists():
        return ids
    with Store(folder) as store:
        return ids - store.finished(_code(asked))


def perform_asked(
    asked: Sequence[Asked], folder: Path, make_executor: MakeExecutor
) -> pd.DataFrame:
    """Run the trials that have no row yet; returns all rows, as of store.load, with the questions.

    Beside, columns question, scene and value; overlap, the smaller share of the two views;
    theoretical_deg and theoretical_mm, how far the encoders' pose is off; middle_x_mm to
    middle_z_mm, by how much the estimate misses the middle of the scene, in the target's frame.
    """
    whole = _performed(asked)
    trials = [a.trial for a in whole]
    code = _code(whole)
    with Store(folder) as store:
        done = store.finished(code)
        missing = {t.id: t for t in trials if t.id not in done}
        if missing:
            note_run(folder, code)
        store.begin(trials)
        with reporting(make_console(), Tally(len(missing))) as reporter:
            tasks = [Task(trial, keep=True) for trial in missing.values()]
            for ended in run(tasks, store, code, make_executor):
                reporter.tell(ended)
    rows = load(folder)
    rows["question"] = [a.question for a in whole]
    rows["scene"] = [a.scene for a in whole]
    rows["value"] = [a.value for a in whole]
    rows["overlap"] = rows[["overlap_target", "overlap_source"]].min(axis=1)
    errors = [theoretical_error(row) for row in rows.to_dict("records")]
    rows[["theoretical_deg", "theoretical_mm"]] = np.array(errors)
    misses = [
        _miss(row, a.trial.spec) for row, a in zip(rows.to_dict("records"), whole, strict=True)
    ]
    rows[["middle_x_mm", "middle_y_mm", "middle_z_mm"]] = np.array(misses)
    return rows


def turn_rotations(
    experiment: DiscussionExperiment, asked: Sequence[Asked], make_executor: MakeExecutor
) -> pd.DataFrame:
    """Turn the true rotation of every trial of that question; rows as of turned_rotation.turn."""
    turnings = [
        Turning(a.trial, experiment.turned.angles_deg, experiment.turned.axes)
        for a in asked
        if a.question == "turned"
    ]
    with make_executor() as executor:
        rows = [row for found in executor.map(turn, turnings) for row in found]
    return pd.DataFrame(rows)


def _miss(row: Mapping[Any, Any], spec: object) -> tuple[float, ...]:
    """(3,) where the estimate puts the middle of the scene, less where it is."""
    assert isinstance(spec, TrialSpec)
    if row["T_estimated"] is None or row["T_exact"] is None:
        return (np.nan,) * 3
    middle = middle_mm(spec)
    exact, estimated = (RigidTransform.from_matrix(row[f"T_{k}"]) for k in ("exact", "estimated"))
    miss = estimated.apply(exact.inv().apply(middle)) - middle
    return tuple(miss.tolist())
