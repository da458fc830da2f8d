"""What `run-experiment` does once its request is checked: run, rehearse, replay."""

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
from experiments.terminal import (
    make_console,
    outcome,
    reporting,
    show_paths,
    show_tables,
    trial_name,
)
from harness.config_errors import ConfigError, nearest
from harness.pool import process_pool
from harness.runner import Done
from harness.schema import Experiment
from harness.scoring import six_parameters
from harness.session import Session, draw_whole, execute, open_session, plan, report
from harness.store import FILE_NAME, Store, StoreError, load
from harness.table_files import Table
from harness.trials import Trial, beyond_reach, full_specs
from sensors import SENSORS

Show = Callable[[list[Table]], object]
REHEARSED = 3  # trials that a dry run times
LITTLE_OVERLAP = 0.1  # where a failure is put down to it


def run_all(session: Session, workers: int | None, redraw: bool, show: Show | None = None) -> int:
    """Compute what is missing, then write and show tables; returns the exit status.

    show: what is done with the tables in place of printing them and the paths of all files.
    """
    console = make_console()
    workers = workers or available_cores()
    if redraw and not (session.folder / FILE_NAME).exists():
        raise StoreError(f"{session.folder / FILE_NAME} does not exist; run the experiment first")
    make_executor = process_pool(min(workers, len(session.trials)))
    start = time.perf_counter()
    ended: list[Done] = []
    with Store(session.folder) as store:
        planned = plan(session, store, redraw)
        if planned.outdated:
            then = "the figures are not" if redraw else "they are computed again"
            console.print(
                f"{planned.outdated} rows were computed by other code: {then}", markup=False
            )
        console.print(
            f"{session.experiment.title}: {planned.missing} trials to compute, {planned.reused} "
            f"reused, {workers} workers",
            markup=False,
        )
        tell_left_out(console, session)
        tell_beyond_reach(console, session)
        try:
            with reporting(console, len(planned.tasks)) as reporter:
                for done in execute(session, store, planned, make_executor):
                    ended.append(done)
                    reporter.tell(done)
        except KeyboardInterrupt:
            kept = sum(done.task.keep for done in ended)
            again = shlex.join(["run-experiment", *sys.argv[1:]])
            print(
                f"\nInterrupted: {kept} of {planned.missing} missing rows are kept in "
                f"{session.folder}. To go on: {again}",
                file=sys.stderr,
            )
            return EXIT_INTERRUPTED
    tables = report(session)
    (show or partial(show_tables, console))(tables)
    tell_no_overlap(console, session)
    if planned.tasks:
        draw_whole(session, make_executor)
    from harness.report.run_page import write_run_page  # it brings matplotlib

    write_run_page(session, tables, make_executor)
    if show is None:
        show_paths(console, session.folder)
    computed = [done.row for done in ended if done.task.keep]
    errors = [row for row in computed if row.status == "error"]
    undrawn = sum(bool(done.drawing_error) for done in ended)
    answered = int((load(session.folder, arrays=False)["status"] == "ok").sum())
    console.print(
        f"{len(computed)} trials computed, {planned.reused} reused; {answered} of "
        f"{len(session.trials)} answered, {len(errors)} errors; "
        f"{time.perf_counter() - start:.1f} s with {workers} workers",
        markup=False,
    )
    for row in errors:
        print(f"trial {row.id}: {row.reason}", file=sys.stderr)
    return EXIT_FAILED if errors or undrawn else EXIT_OK


def dry_run(session: Session, workers: int | None) -> int:
    """Count the trials, show the first, time some; writes nothing."""
    console = make_console()
    workers = min(workers or available_cores(), len(session.trials))
    points = {trial.point.number for trial in session.trials if trial.point is not None}
    at = f" at {len(points)} points" if points else ""
    console.print(f"{session.experiment.title}: {len(session.trials)} trials{at}", markup=False)
    for trial in session.trials[:REHEARSED]:
        console.print(f"  {trial.id}  {trial_name(trial)}", markup=False, soft_wrap=True)
    console.print("  ..." if len(session.trials) > REHEARSED else "", markup=False)
    tell_left_out(console, session)
    tell_beyond_reach(console, session)
    from harness.execution import perform

    perform(session.trials[0])  # the first one compiles and loads, which no other has to do
    rehearsed = session.trials[1 : 1 + REHEARSED] or session.trials
    start = time.perf_counter()
    for trial in rehearsed:
        row = perform(trial).row
        console.print(f"{trial_name(trial)}: {outcome(row)}", markup=False, soft_wrap=True)
    each_s = (time.perf_counter() - start) / len(rehearsed)
    total_s = each_s * len(session.trials) / workers
    console.print(
        f"{each_s:.2f} s a trial: about {total_s:.0f} s with {workers} workers, figures apart; "
        f"rows would go to {session.folder}",
        markup=False,
    )
    return EXIT_OK


def replay(session: Session, identity: str) -> int:
    """Perform one trial in this process and print its row; writes nothing."""
    from harness.execution import perform

    trial = find_trial(session, identity)
    row = perform(trial).row
    console = make_console()
    console.print(f"trial {trial.id}: {trial_name(trial)}", markup=False)
    console.print(outcome(row), markup=False, soft_wrap=True)
    for name, pose in (("exact", row.T_exact), ("estimated", row.T_estimated)):
        if pose is not None:
            six = six_parameters(pose)
            console.print(
                f"{name:9}  rotation X, Y, Z {six[0]:9.3f} {six[1]:9.3f} {six[2]:9.3f} deg   "
                f"translation {six[3]:9.2f} {six[4]:9.2f} {six[5]:9.2f} mm",
                markup=False,
                soft_wrap=True,
            )
    if row.overlap_target is not None and row.overlap_source is not None:
        console.print(
            f"overlap    {row.overlap_source:.1%} of the source's points, "
            f"{row.overlap_target:.1%} of the target's",
            markup=False,
        )
    for what, values, unit in (("counts", row.counts, ""), ("times", row.stage_ms, " ms")):
        text = ", ".join(f"{name} {value:.0f}{unit}" for name, value in values.items())
        if text:
            console.print(f"{what:9}  {text}", markup=False, soft_wrap=True)
    if row.traceback:
        console.print(row.traceback, markup=False, soft_wrap=True)
    return EXIT_FAILED if row.status == "error" else EXIT_OK


def show_scene(
    name: str, config: Path | None, folder: Path | None, overrides: Sequence[str]
) -> int:
    """Save a picture of a scene, with the views of a config when one is given."""
    from scenes import SCENES
    from scenes.picture import save_picture

    if name not in SCENES:
        raise ConfigError("--show-scene", (), f"unknown scene {name!r}; {nearest(name, SCENES)}")
    params, outlines = SCENES[name].params_type(), None
    if config is not None:
        session = open_session(config, folder, overrides)
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
    path = (folder or Path("results") / "scenes") / f"{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    save_picture(SCENES[name].builder(params), path, outlines)
    print(path)
    return EXIT_OK


def find_trial(session: Session, identity: str) -> Trial:
    """The trial whose id begins so; raises ConfigError."""
    found = {t.id: t for t in session.trials if identity and t.id.startswith(identity)}
    if len(found) == 1:
        return next(iter(found.values()))
    problem = "matches several trials" if found else "is no trial of this config"
    raise ConfigError(
        "--trial", (), f"{identity!r} {problem}; it begins with {session.trials[0].id}"
    )


def tell_left_out(console: Console, session: Session) -> None:
    """One line for each optional method that cannot run here."""
    for line in session.left_out:
        console.print(line, markup=False, soft_wrap=True)


def tell_beyond_reach(console: Console, session: Session) -> None:
    """One line for each view that is scanned without the arm, as it cannot be reached."""
    if not isinstance(session.experiment, Experiment):
        return
    for name, reason in beyond_reach(session.experiment, session.base).items():
        console.print(
            f"View {name} is scanned from a straight line, without the arm: {reason}.",
            markup=False,
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
        console.print(f"{line}.", markup=False, soft_wrap=True)


def available_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
