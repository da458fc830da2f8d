"""What `run-experiment` does once its request is checked: run, replay, show."""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from experiments.cli import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
from experiments.progress import Tally, reporting
from experiments.terminal import (
    make_console,
    outcome,
    show_paths,
    show_tables,
    trial_name,
)
from harness.config.errors import ConfigError, nearest
from harness.config.reading import AnyExperiment
from harness.config.schema import Experiment
from harness.results import check_folder, results_folder, telling_disk
from harness.scoring import six_parameters
from harness.session import Plan, Session, draw_whole, execute, open_session, plan, report
from harness.store import FILE_NAME, Store, StoreError, load
from harness.tables.table import Table
from harness.trials.points import MOST_POINTS, point_count
from harness.trials.specs import Trial, beyond_reach, full_specs
from harness.workers.cluster import cluster_pool
from harness.workers.pool import process_pool
from sensors import SENSORS

Show = Callable[[list[Table]], object]
LITTLE_OVERLAP = 0.1  # where a failure is put down to it
MANY_POINTS = 20_000  # of a sweep, to check which takes seconds


def run_all(
    session: Session,
    workers: int | None,
    redraw: bool,
    show: Show | None = None,
    scheduler: str | None = None,
) -> int:
    """Compute what is missing, then write and show tables; returns the exit status.

    show: what is done with the tables in place of printing them and the paths of all files.
    scheduler: address of a Dask scheduler whose workers compute, in place of processes here.
    """
    console = make_console()
    workers = min(workers or available_cores(), len(session.trials))
    if redraw and not (session.folder / FILE_NAME).exists():
        raise StoreError(f"{session.folder / FILE_NAME} does not exist; run the experiment first")
    make_local = process_pool(workers)
    # Before the store notes what is asked for: a request that is refused changes nothing.
    make_executor = cluster_pool(scheduler) if scheduler else make_local
    start = time.perf_counter()
    with telling_disk(session.folder), Store(session.folder) as store:
        planned = plan(session, store, redraw)
        if planned.outdated:
            then = "the figures are not" if redraw else "they are computed again"
            console.print(f"{planned.outdated} rows were computed by other code: {then}")
        who = f"the workers of {scheduler}" if scheduler else f"{workers} workers"
        console.print(
            f"{session.experiment.title}: {planned.missing} trials to compute, {planned.reused} "
            f"reused, {who}",
        )
        tell_left_out(console, session)
        tell_beyond_reach(console, session)
        tell_alike(console, session, planned)
        tally = Tally(len(planned.tasks))
        try:
            with reporting(console, tally) as reporter:
                for done in execute(session, store, planned, make_executor):
                    reporter.tell(done)
        except KeyboardInterrupt:
            again = shlex.join(["run-experiment", *sys.argv[1:]])
            print(
                f"\nInterrupted: {tally.computed} of {planned.missing} missing rows are kept in "
                f"{session.folder}. To go on: {again}",
                file=sys.stderr,
            )
            return EXIT_INTERRUPTED
        tables = report(session)
        (show or partial(show_tables, console))(tables)
        tell_no_overlap(console, session)
        if planned.tasks:
            draw_whole(session, make_local)
        from harness.report.run_page import write_run_page  # it brings matplotlib

        write_run_page(session, tables, make_local)
    if show is None:
        show_paths(console, session.folder)
    answered = int((load(session.folder, arrays=False)["status"] == "ok").sum())
    console.print(
        f"{tally.computed} trials computed, {planned.reused} reused; {answered} of "
        f"{len(session.trials)} answered, {tally.errors} errors; "
        f"{time.perf_counter() - start:.1f} s with {who}",
    )
    for line in tally.first_errors:
        print(line, file=sys.stderr)
    if tally.errors > len(tally.first_errors):
        print(f"and {tally.errors - len(tally.first_errors)} more errors", file=sys.stderr)
    return EXIT_FAILED if tally.errors or tally.undrawn else EXIT_OK


def export(session: Session, file: Path) -> int:
    """Write the rows at hand of all trials to one file; computes nothing. Raises StoreError."""
    from harness.store.export import export_rows  # it brings pandas

    rows, missing = export_rows(session.folder, file, {trial.id for trial in session.trials})
    print(f"{file}: {rows} rows" + (f", {missing} different trials have none" if missing else ""))
    return EXIT_OK


def replay(trials: Sequence[Trial], identity: str) -> int:
    """Perform one trial in this process and print its row; writes nothing."""
    from harness.execution import perform

    trial = find_trial(trials, identity)
    row = perform(trial).row
    console = make_console()
    console.print(f"trial {trial.id}: {trial_name(trial)}")
    console.print(outcome(row), soft_wrap=True)
    for note in row.notes:
        console.print(f"note       {note}", soft_wrap=True)
    for name, pose in (("exact", row.T_exact), ("estimated", row.T_estimated)):
        if pose is not None:
            six = six_parameters(pose)
            console.print(
                f"{name:9}  rotation X, Y, Z {six[0]:9.3f} {six[1]:9.3f} {six[2]:9.3f} deg   "
                f"translation {six[3]:9.2f} {six[4]:9.2f} {six[5]:9.2f} mm",
                soft_wrap=True,
            )
    if row.overlap_target is not None and row.overlap_source is not None:
        console.print(
            f"overlap    {row.overlap_source:.1%} of the source's points, "
            f"{row.overlap_target:.1%} of the target's",
        )
    for what, values, unit in (("counts", row.counts, ""), ("times", row.stage_ms, " ms")):
        text = ", ".join(f"{name} {value:.0f}{unit}" for name, value in values.items())
        if text:
            console.print(f"{what:9}  {text}", soft_wrap=True)
    if row.traceback:
        console.print(row.traceback, soft_wrap=True)
    return EXIT_FAILED if row.status == "error" else EXIT_OK


def show_scene(
    name: str,
    config: Path | None,
    folder: Path | None,
    overrides: Sequence[str],
    seed: int | None,
) -> int:
    """Save a picture of a scene, with the views of a config when one is given."""
    from scenes import SCENES
    from scenes.picture import save_picture

    if name not in SCENES:
        raise ConfigError("--show-scene", (), f"unknown scene {name!r}; {nearest(name, SCENES)}")
    path = results_folder(folder, "scenes") / f"{name}.png"
    check_folder(path.parent)
    params, outlines = SCENES[name].params_type(), None
    if config is not None:
        session = open_session(config, folder, overrides, seed)
        specs = full_specs(session.trials)
        if not specs:
            message = f"{config} draws its views while it runs; leave it out to see the scene"
            raise ConfigError("--show-scene", (), message)
        spec = specs[0]
        if spec.scene.name != name:
            message = f"{config} has scene {spec.scene.name!r}, not {name!r}"
            raise ConfigError("--show-scene", (), message)
        params = spec.scene.params
        sensor = SENSORS[spec.sensor.name].factory(spec.sensor.params)
        views = {view.name: view for each in specs for view in (each.source, each.target)}
        outlines = {key: sensor.outline(spec.path(view)) for key, view in views.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    save_picture(SCENES[name].builder(params), path, outlines)
    print(path)
    return EXIT_OK


def find_trial(trials: Sequence[Trial], identity: str) -> Trial:
    """The trial whose id begins so; raises ConfigError."""
    found = {t.id: t for t in trials if identity and t.id.startswith(identity)}
    if len(found) == 1:
        return next(iter(found.values()))
    problem = "matches several trials" if found else "is no trial of this config"
    raise ConfigError("--trial", (), f"{identity!r} {problem}; it begins with {trials[0].id}")


def tell_long_check(experiment: AnyExperiment | None) -> None:
    """One line where there are so many points to be checked that a user waits for it."""
    if experiment is None or experiment.sweep is None:
        return
    points = point_count(experiment.sweep)
    if MANY_POINTS <= points <= MOST_POINTS:
        make_console().print(f"Checking all {points} points first")


def tell_left_out(console: Console, session: Session) -> None:
    """One line for each optional method that cannot run here."""
    for line in session.left_out:
        console.print(line, soft_wrap=True)


def tell_alike(console: Console, session: Session, planned: Plan) -> None:
    """One line where trials are the same, as those of a method that a point does not change."""
    if planned.different < len(session.trials):
        console.print(
            f"{len(session.trials)} trials are asked for, {planned.different} different ones: "
            "those that are the same share one row.",
            soft_wrap=True,
        )


def tell_beyond_reach(console: Console, session: Session) -> None:
    """One line for each view that is scanned without the arm, as it cannot be reached."""
    if not isinstance(session.experiment, Experiment):
        return
    for name, reason in beyond_reach(session.experiment, session.base).items():
        console.print(
            f"View {name} is scanned from a straight line, without the arm: {reason}.",
            soft_wrap=True,
        )


def tell_no_overlap(console: Console, session: Session) -> None:
    """One line for each pair without an answer whose views share little or nothing."""
    if not isinstance(session.experiment, Experiment) or session.experiment.sweep is not None:
        return
    rows = load(session.folder)
    for name, group in rows[rows["given"] == ""].groupby("pair", sort=False):
        shared = float(group[["overlap_target", "overlap_source"]].max().max())
        if (group["status"] == "ok").any() or not shared < LITTLE_OVERLAP:
            continue
        pair = session.experiment.pairs[str(name)]
        reason = str(group["reason"].iloc[0])
        if group["status"].iloc[0] != "no_overlap":
            reason = f"views {pair.source} and {pair.target} overlap by {shared:.0%}: {reason}"
        line = f"Pair {name} was not registered: {reason}"
        if pair.printed is not None and session.experiment.rotation_labels == "printed":
            line += (
                " (rotation_labels: printed; swapped is the reading that fits tables 6.2 to 6.5)"
            )
        console.print(f"{line}.", soft_wrap=True)


def available_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
