"""One experiment from its file to its results folder; the command is a thin shell around this."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from harness.config.choices import installed_methods
from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import AnyExperiment, dump_yaml, load_experiment, overridden_mapping
from harness.config.resolved import resolved_config, with_defaults
from harness.figures.of_rows import forget_figures
from harness.provenance import Sources, code_fingerprint, note_run
from harness.report.record_paths import RECORDS
from harness.results import results_folder
from harness.scoring.face_gaps import FaceGaps
from harness.store import Store, StoreError, load
from harness.tables.table import Table, write_tables
from harness.trials.lazy import Lazy
from harness.trials.random_pairs import build_random_trials
from harness.trials.specs import Trial, Trials, TrialSpec, build_trials
from harness.trials.swept import build_swept_trials
from harness.workers.child import Task
from harness.workers.pool import MakeExecutor
from harness.workers.runner import Done, run

if TYPE_CHECKING:  # it takes 0.4 s to import, which the first trial need not wait for
    import pandas as pd

# Tables that the terminal does not show.
QUIET = ("curves",)


@dataclass(frozen=True)
class Session:
    """A checked experiment, its trials, the folder of its results and the code that computes it.

    trials: those of every point where there is a sweep. base: those of the experiment without it.
    code: its fingerprint. sources: what that is made of.
    left_out: why optional methods do not run, a line each.
    """

    file: Path
    experiment: AnyExperiment
    trials: Trials
    folder: Path
    code: str
    sources: Sources
    base: Trials
    left_out: tuple[str, ...] = ()

    @property
    def drawn_labels(self) -> list[str]:
        """Labels of the methods whose repeat 0 is drawn; none of a sweep, of too many pairs."""
        if self.experiment.sweep is not None:
            return []
        return [method.called for method in self.experiment.methods if method.figures]


@dataclass(frozen=True)
class Plan:
    """What is left to do: the tasks, each made when it is asked for.

    missing: rows to compute. reused: trials whose row is taken as it is. outdated: rows that other
    code made. different: trials apart from those that are the same.
    """

    tasks: Sequence[Task]
    missing: int
    reused: int
    outdated: int
    different: int


def open_session(
    file: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> Session:
    """Read and check everything; writes nothing. Raises ConfigError."""
    experiment = load_experiment(file, overrides, seed)
    methods, left_out = installed_methods(experiment.methods, file)
    experiment = experiment.model_copy(update={"methods": methods})
    if isinstance(experiment, RandomPairsExperiment):
        trials = base = build_random_trials(experiment, file)
    else:
        trials = base = build_trials(experiment, file)
    if experiment.sweep is not None:
        data = overridden_mapping(file, overrides, seed)
        if left_out:
            data["methods"] = [m.model_dump(mode="json", exclude_none=True) for m in methods]
        trials = build_swept_trials(data, experiment.sweep, with_defaults(experiment, base), file)
    names, read = ({each[i] for each in trials.used} for i in range(2))
    sources = Sources(tuple(sorted(names)), tuple(sorted(read - {""})))
    code = code_fingerprint(*sources)
    folder = results_folder(folder, file.stem)
    return Session(file, experiment, trials, folder, code, sources, base, left_out)


def plan(session: Session, store: Store, redraw: bool = False) -> Plan:
    """Note in the store what is asked for, and compare it with the rows at hand.

    The figures of repeat 0 go with their trial. redraw: compute no rows, draw all figures again.
    Raises StoreError, and notes nothing, where there is no row to draw from.
    """
    if redraw and not store.has_some(session.trials):
        raise no_rows(session.folder)
    labels = session.drawn_labels
    scans = array("q")  # a number for the scans of each trial
    drawn: dict[int, Trial] = {}  # those that have figures, by position

    def noted() -> Iterator[Trial]:
        for position, trial in enumerate(session.trials):
            scans.append(hash(trial.spec.scan_key))
            if trial.spec.repeat == 0 and not trial.spec.given and trial.label in labels:
                drawn[position] = trial
            yield trial

    store.begin(noted())
    state = store.state(session.code)
    missing = np.zeros(len(scans), dtype=np.bool_)
    missing[state.missing] = not redraw
    drawn = {
        position: trial
        for position, trial in drawn.items()
        if missing[position] or redraw or not store.is_drawn(trial)
    }
    wanted = missing.copy()
    wanted[list(drawn)] = True
    positions = np.flatnonzero(wanted)
    positions = positions[_side_by_side(np.asarray(scans)[positions])]
    records = session.folder / RECORDS if session.experiment.sweep is None else None

    def task(index: int) -> Task:
        position = int(positions[index])
        folders = (session.folder / "figures", session.folder / "scans")
        pictures, clouds = folders if position in drawn else (None, None)
        return Task(session.trials[position], bool(missing[position]), pictures, clouds, records)

    reused = state.held if redraw else state.reused
    tasks = Lazy(len(positions), task)
    return Plan(tasks, int(missing.sum()), reused, state.outdated, state.different)


def no_rows(folder: Path) -> StoreError:
    """What is raised where a results folder has nothing of what is asked for."""
    return StoreError(f"{folder} has no row of this configuration; run it first")


def _side_by_side(keys: NDArray[np.int64]) -> NDArray[np.intp]:
    """An order in which equal keys stand together, those first that occur first."""
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    return np.argsort(first[which], kind="stable")


def execute(
    session: Session, store: Store, planned: Plan, make_executor: MakeExecutor
) -> Iterator[Done]:
    """Note what is run by what, then perform the tasks; hands each on as it ends."""
    if planned.missing:
        note_run(session.folder, session.code)
    config = dump_yaml(resolved_config(session.experiment, session.base))
    (session.folder / "config.yaml").write_text(config, encoding="utf-8")
    store.forget_drawings(session.trials)
    limits = session.experiment.limits
    for done in run(planned.tasks, store, session.code, make_executor, limits, session.sources):
        if done.task.pictures is not None and not done.drawing_error:
            store.note_drawing(done.task.trial, done.files)
        yield done


def draw_whole(session: Session, make_executor: MakeExecutor) -> list[Path]:
    """Draw what concerns no single pair: the arm, and all views superposed; returns the files."""
    if session.experiment.sweep is not None:
        return []
    from harness.figures.overview import draw_overview  # it brings matplotlib

    rows = load(session.folder)
    return draw_overview(session.trials, session.drawn_labels, rows, session.folder, make_executor)


def report(session: Session) -> list[Table]:
    """Build the tables from the rows and write them; raises StoreError.

    The card of the sensor, how the arm stood and the points of the curves are quiet: in the files
    and in the page, which nobody needs to see in the terminal at every run.
    """
    # They bring scipy.stats, which a run needs only when its last trial has ended.
    from harness.tables.experiment import all_tables
    from harness.tables.random_pairs import random_tables
    from harness.tables.sweeps import sweep_table
    from harness.tables.variants import variant_tables
    from harness.tables.views import sensing_tables

    experiment = session.experiment
    rows = load(session.folder, arrays=experiment.sweep is None)
    if rows.empty:
        raise no_rows(session.folder)
    forget_figures(session.folder / "figures")
    if experiment.sweep is not None:
        tables = [sweep_table(rows)]
    elif isinstance(experiment, RandomPairsExperiment):
        from harness.figures.random_pairs import draw_random_figures

        tables = random_tables(rows) + variant_tables(experiment.methods, rows, random=True)
        draw_random_figures(rows, session.folder / "figures")
    else:
        tables = all_tables(experiment, rows, _gaps(session.trials, rows))
        tables += variant_tables(experiment.methods, rows, random=False)
    if isinstance(experiment, RandomPairsExperiment) and experiment.study:
        from harness.studies.study import draw_study, find

        findings = find(experiment, rows)
        draw_study(findings, session.folder / "figures")
        tables = [*findings.tables, *(replace(t, quiet=True) for t in tables)]
    tables = [replace(table, quiet=table.quiet or table.name in QUIET) for table in tables]
    tables += sensing_tables(session.base)
    write_tables(tables, session.folder / "tables")
    return tables


def _gaps(trials: Sequence[Trial], rows: pd.DataFrame) -> dict[str, FaceGaps]:
    """By pair, how far apart the views see the same faces, where a method was given true patches.

    No rows hold it: like the card, it follows from the configuration alone.
    """
    from harness.execution import face_gaps  # it brings the whole simulation

    entered = rows[rows["given"].isin(["patches", "shared_patches"])]
    scanned = set(entered.loc[entered["status"] != "error", "id"])
    specs = {trial.pair: trial.spec for trial in trials if trial.id in scanned}
    return {pair: face_gaps(spec) for pair, spec in specs.items() if isinstance(spec, TrialSpec)}
