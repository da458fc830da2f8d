"""What `run-experiment --compare` does: two results folders against each other, trial by trial."""

from __future__ import annotations

from pathlib import Path

from experiments.cli import EXIT_OK
from experiments.terminal import make_console, show_paths, show_tables
from harness.config.errors import ConfigError
from harness.figures.compare import draw_comparison
from harness.file_names import file_slug
from harness.report.page import Part
from harness.report.run_page import text_of, write_page
from harness.results import check_folder, results_folder
from harness.store import load
from harness.tables.compare import changed_table, comparison_table, matched, summary, trial_count
from harness.tables.table import write_tables


def compare(first: Path, second: Path, folder: Path | None) -> int:
    """Compare the rows of two results folders, and write tables, a figure and a page.

    Returns the exit status; raises ConfigError and StoreError, one line, before anything is
    written.
    """
    names = _names(first, second)
    folder = results_folder(folder, file_slug(f"{names[1]}_against_{names[0]}"))
    check_folder(folder)
    rows = [load(each, specs=True, arrays=False) for each in (first, second)]
    try:
        pairs = matched(*rows)
    except ValueError as error:
        message = f"{first} and {second} do not match trial by trial: {error}"
        raise ConfigError("--compare", (), message) from None
    if pairs.empty:
        raise ConfigError(
            "--compare", (), f"{first} and {second} have no trial in common: the same scene, "
            "sensor, views, seed and repeat, and a method of the same label"
        )  # fmt: skip
    tables = [comparison_table(pairs, names), changed_table(pairs, names)]
    tables = [table for table in tables if len(table.frame)]
    write_tables(tables, folder / "tables")
    figure = draw_comparison(pairs, names, folder / "figures" / "errors.png")
    counts = [trial_count(each) for each in rows]
    sentence = (
        f"{len(pairs)} trials in common, of {counts[0]} in {names[0]} and {counts[1]} in "
        f"{names[1]}. {summary(pairs, names)}"
    )
    configs = [each / "config.yaml" for each in (first, second)]
    part = Part(
        name="comparison",
        title=f"{names[1]} against {names[0]}",
        sentence=sentence,
        answer=tables[0],
        tables=tables[1:],
        figures=[figure],
        config="\n\n".join(f"# {file}\n{text_of(file)}" for file in configs),
        command=f"run-experiment --compare {first} {second}",
    )
    write_page(folder, part.title, [part])
    console = make_console()
    show_tables(console, tables)
    console.print(sentence)
    show_paths(console, folder)
    return EXIT_OK


def _names(first: Path, second: Path) -> tuple[str, str]:
    """What to call both: as little of the ends of their paths as tells them apart."""
    one, other = first.resolve().parts, second.resolve().parts
    for length in range(1, max(len(one), len(other))):
        names = "/".join(one[-length:]), "/".join(other[-length:])
        if names[0] != names[1]:
            return names
    return "the first", "the second"
