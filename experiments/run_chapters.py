"""What `run-experiment` does with a config of kind `chapters`: its parts, then the summary."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from experiments.chapter_summary import PartResult, summary_tables
from experiments.chapters import CALIBRATED, ChaptersExperiment, PartRun, load_chapters
from experiments.chapters_page import write_chapters_page
from experiments.cli import EXIT_INTERRUPTED, EXIT_OK
from experiments.commands import available_cores, replay, run_all
from experiments.precision import KIND as PRECISION
from experiments.precision import run_precision
from experiments.profile_pairs import KIND as PROFILES
from experiments.profile_pairs import kept_rows, run_profiles
from experiments.rehearsal import dry_run
from experiments.terminal import make_console, show_paths, show_tables
from harness.config.errors import ConfigError
from harness.config.reading import PAIRS, dump_yaml
from harness.config.schema import Experiment
from harness.provenance import code_fingerprint, note_run
from harness.results import check_folder, results_folder
from harness.store import FILE_NAME, StoreError, load
from harness.tables.table import Table, write_tables
from harness.workers.pool import MakeExecutor, process_pool


def run_chapters(
    path: Path,
    folder: Path | None,
    overrides: Sequence[str],
    seed: int | None,
    workers: int | None,
    redraw: bool,
) -> int:
    """Run what is missing of every part, then sum all up; returns the exit status."""
    from experiments.draw_chapters import draw_chapters  # it brings matplotlib

    folder = results_folder(folder, path.stem)
    check_folder(folder)
    experiment, runs = load_chapters(path, folder, overrides, seed)
    if redraw:
        _check_rows(runs)
    console = make_console()
    workers = workers or available_cores()
    start = time.perf_counter()
    make_executor = process_pool(workers)
    results: list[PartResult] = []
    worst = EXIT_OK
    try:
        for run in runs:
            console.print(f"\n{run.name}: {run.check().title}", style="bold")
            status, result = _run_part(run, workers, redraw, make_executor)
            if status == EXIT_INTERRUPTED:
                return status
            worst = max(worst, status)
            results.append(result)
        _write_facts(experiment, folder)
        tables, quiet = summary_tables(results)
        figures = draw_chapters(results, folder / "figures", make_executor, redraw)
        write_tables([*tables, *quiet, figures], folder / "tables")
        console.print()
        show_tables(console, tables)
        write_chapters_page(experiment, folder, runs, results, [*tables, *quiet], make_executor)
    except KeyboardInterrupt:
        again = shlex.join(["run-experiment", *sys.argv[1:]])
        print(
            f"\nInterrupted: what is finished is kept in {folder}. To go on: {again}",
            file=sys.stderr,
        )
        return EXIT_INTERRUPTED
    show_paths(console, folder)
    console.print(
        f"{len(runs)} parts in {time.perf_counter() - start:.0f} s with {workers} workers; each "
        f"has its own tables and figures in {folder}/<part>",
        soft_wrap=True,
    )
    return worst


def rehearse_chapters(
    path: Path, folder: Path | None, overrides: Sequence[str], seed: int | None, workers: int | None
) -> int:
    """Check every part, count its trials and time some; writes nothing."""
    console = make_console()
    for run in load_chapters(path, folder, overrides, seed)[1]:
        console.print(f"\n{run.name}:", style="bold")
        if run.kind == PAIRS:
            dry_run(run.session(), workers)
            if run.waits:
                console.print(f"{CALIBRATED} comes on top: its calibration is yet to be measured")
        elif run.kind == PROFILES:
            experiment, trials = run.profiles()
            count = len(trials) * experiment.scan.profiles
            console.print(f"{experiment.title}: {count} pairs of profiles")
        else:
            console.print(f"{run.check().title}: takes seconds")
    return EXIT_OK


def replay_part(
    path: Path, folder: Path | None, overrides: Sequence[str], seed: int | None, identity: str
) -> int:
    """Perform one trial of whichever part has it; writes nothing. Raises ConfigError."""
    for run in load_chapters(path, folder, overrides, seed)[1]:
        if run.kind != PAIRS:
            continue
        session = run.session()
        if any(trial.id.startswith(identity) for trial in session.trials):
            return replay(session.trials, identity)
    raise ConfigError("--trial", (), f"{identity!r} is no trial of a part of {path}")


def _run_part(
    run: PartRun, workers: int, redraw: bool, make_executor: MakeExecutor
) -> tuple[int, PartResult]:
    """Bring one part up to date; its exit status, and what the summary needs of it."""
    if run.kind == PRECISION:
        # It takes seconds and no rows: nothing of it is reused.
        tables, _ = run_precision(run.file, run.folder, run.overrides, run.seed)
        return EXIT_OK, PartResult(run.name, tuple(tables))
    if run.kind == PROFILES:
        profiles, trials = run.profiles()
        tables, _ = run_profiles(run.file, run.folder, run.overrides, run.seed, make_executor)
        rows = kept_rows(profiles, trials, run.folder)
        return EXIT_OK, PartResult(run.name, tuple(tables), profiles, trials, rows)
    session = run.session()
    kept: list[Table] = []
    status = run_all(session, workers, redraw, kept.extend)
    if status == EXIT_INTERRUPTED or not isinstance(session.experiment, Experiment):
        return status, PartResult(run.name, ())
    result = PartResult(run.name, tuple(kept), session.experiment, session.trials, load(run.folder))
    return status, result


def _check_rows(runs: Sequence[PartRun]) -> None:
    """Raise StoreError for a part that has no rows to report on, before anything is written."""
    for run in runs:
        there = True
        if run.kind == PAIRS:
            there = (run.folder / FILE_NAME).exists()
        elif run.kind == PROFILES:
            there = kept_rows(*run.profiles(), run.folder) is not None
        if not there:
            raise StoreError(f"{run.folder} has no rows of part {run.name}; run it first")


def _write_facts(experiment: ChaptersExperiment, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    resolved = experiment.model_dump(mode="json", exclude_none=True)
    (folder / "config.yaml").write_text(dump_yaml(resolved), encoding="utf-8")
    note_run(folder, code_fingerprint(()))
