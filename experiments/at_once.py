"""The experiments that run as a whole: in seconds, or keeping their own rows."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from experiments.discussion import check_rows, rehearse_discussion, run_discussion
from experiments.discussion_trials import KIND as DISCUSSION
from experiments.precision import KIND as PRECISION
from experiments.precision import rehearse_precision, run_precision
from experiments.profile_pairs import KIND as PROFILES
from experiments.profile_pairs import check_kept, rehearse_profiles, run_profiles
from experiments.terminal import make_console, show_paths, show_tables
from harness.config.errors import ConfigError
from harness.config.reading import read_mapping
from harness.report.run_page import plain_part, write_page
from harness.tables.table import Table

Run = Callable[[Path, Path | None, Sequence[str], int | None], tuple[list[Table], Path]]

# By the key `experiment` of the config; harness.config.reading.experiment_kind reads it.
RUNS: dict[str, Run] = {
    PRECISION: run_precision,
    PROFILES: run_profiles,
    DISCUSSION: run_discussion,
}

Rehearsal = Callable[[Path, Path | None, Sequence[str], int | None], list[str]]
REHEARSALS: dict[str, Rehearsal] = {
    PRECISION: rehearse_precision,
    PROFILES: rehearse_profiles,
    DISCUSSION: rehearse_discussion,
}


def rehearse(
    kind: str, config: Path, folder: Path | None, overrides: Sequence[str], seed: int | None
) -> None:
    """Check the config and tell what a run would do; writes nothing. Raises ConfigError."""
    console = make_console()
    for line in REHEARSALS[kind](config, folder, overrides, seed):
        console.print(line, soft_wrap=True)


def check_reportable(
    kind: str, config: Path, folder: Path | None, overrides: Sequence[str], seed: int | None
) -> None:
    """Raise ConfigError where there are no rows from which tables could be built again."""
    if kind == DISCUSSION:
        check_rows(config, folder, overrides, seed)
        return
    if kind != PROFILES:
        message = (
            f"{config} keeps no scans to report on, only its tables and figures: without "
            "--report-only it measures anew, which takes seconds"
        )
        raise ConfigError("--report-only", (), message)
    check_kept(config, folder, overrides, seed)


def show_run(
    run: Run, config: Path, folder: Path | None, overrides: Sequence[str], seed: int | None
) -> None:
    """Run, then show the tables and what was written; raises ConfigError."""
    console = make_console()
    start = time.perf_counter()
    tables, written = run(config, folder, overrides, seed)
    heading = read_mapping(config)
    part = plain_part(written, str(heading["title"]), str(heading.get("description", "")), tables)
    write_page(written, part.title, [part])
    show_tables(console, tables)
    show_paths(console, written)
    console.print(f"{time.perf_counter() - start:.1f} s")
