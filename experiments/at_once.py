"""The experiments without trials, which take seconds: nothing of them has to be resumed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from experiments.precision import run_precision
from experiments.profile_pairs import KIND, run_profiles
from experiments.terminal import make_console, show_paths, show_tables
from harness.config import read_mapping
from harness.report.run_page import plain_part, write_page
from harness.table_files import Table

Run = Callable[[Path, Path | None, Sequence[str], int | None], tuple[list[Table], Path]]

# By the key `experiment` of the config; harness.config.experiment_kind reads it.
RUNS: dict[str, Run] = {"precision": run_precision, KIND: run_profiles}


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
    console.print(f"{time.perf_counter() - start:.1f} s", markup=False)
