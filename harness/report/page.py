"""The page itself: parts put together into one file that needs no network and no server."""

from __future__ import annotations

import base64
import functools
import gzip
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from harness.figures.looks import INK, NORMAL_COLOURS, SOURCE, TARGET
from harness.report.failures import command_markup
from harness.report.markup import (
    COPIED_ROWS,
    details,
    embedded_bytes,
    embedded_json,
    escaped,
    made_by,
    section,
    table_markup,
)
from harness.report.packing import compressed
from harness.report.pictures import load_pictures, pictures_markup
from harness.report.record_paths import record_path
from harness.report.study_still import study_still
from harness.tables.table import Table

ASSETS = Path(__file__).parent / "assets"
FILE_NAME = "report.html"
SCRIPTS = ("tables.js", "data.js", "traces.js", "camera.js", "panels.js", "pair.js", "studies.js")
COLOURS = {"target": TARGET, "source": SOURCE, "ink": INK, "palette": NORMAL_COLOURS}
LARGEST_BYTES = 15_000_000
# No script, style, picture or request from anywhere but this file, whatever a text in it says.
POLICY = (
    "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; font-src data:; "
    "script-src 'unsafe-inline' 'unsafe-eval' blob:; worker-src blob:; connect-src 'none'"
)


@dataclass(frozen=True)
class Part:
    """One experiment of a page.

    name: unique in the page, starts the ids of its elements. answer: sentence first, then a table.
    tables: beside the answer's. failures: markup. config, facts: texts of config.yaml and run.json.
    command: what made it. study: what a sweep found, as studies.study gives it, or
    pair_studies.pair_study.
    """

    name: str
    title: str
    description: str = ""
    sentence: str = ""
    answer: Table | None = None
    tables: Sequence[Table] = ()
    sensor: Sequence[Table] = ()
    figures: Sequence[Path] = ()
    failures: str = ""
    config: str = ""
    facts: str = ""
    command: str = ""
    study: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Shown:
    """What the viewer in 3D offers: records by id, where their files lie, and how to replay one.

    trials: rows of the list that is searched, each a mapping of plain values. first: id of the
    record that is shown before one is chosen. total: how many trials there are, listed or not.
    """

    records: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    folders: Mapping[str, Path] = field(default_factory=dict)
    trials: Sequence[Mapping[str, Any]] = ()
    first: str = ""
    total: int = 0

    def joined(self, other: Shown) -> Shown:
        """What two experiments show, in one viewer."""
        return Shown(
            {**self.records, **other.records},
            {**self.folders, **other.folders},
            [*self.trials, *other.trials],
            self.first or other.first,
            self.total + other.total,
        )


def page_markup(title: str, parts: Sequence[Part], shown: Shown) -> str:
    """The whole page.

    Pictures get what the rest leaves of LARGEST_BYTES; they are made smaller to fit.
    """
    viewer, data = viewer_markup(shown), [*_data(shown), *_studies(parts)]
    files = [file for part in parts for file in part.figures]
    drawn = bool(shown.records) or any(part.study is not None for part in parts)
    rest = (
        sum(len(part.failures) for part in parts)
        + sum(map(len, data))
        + (len(_plotly()) if drawn else 0)
    )
    tables = _table_files(parts)
    rest += len(tables) + 200_000 * len(parts)
    pictures = iter(load_pictures(files, int(0.74 * max(LARGEST_BYTES - rest, 0))))
    bodies = []
    for part in parts:
        figures = [next(pictures) for _ in part.figures]
        body = pictures_markup(figures)
        bodies.append(_part(part, body, alone=len(parts) == 1, viewer=viewer))
        viewer = ""  # the first part holds it for all
    links = _links(parts, bool(shown.records))
    scripts = "\n".join(
        f"<script>{(ASSETS / name).read_text(encoding='utf-8')}</script>" for name in SCRIPTS
    )
    return (
        "<!DOCTYPE html>\n"
        '<html lang="en"><head><meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{html.escape(POLICY)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(title)}</title>\n"
        f"<style>{(ASSETS / 'report.css').read_text(encoding='utf-8')}</style>\n"
        "</head><body>\n"
        f'<a class="skip" href="#main">To the content</a><header><h1>{escaped(title)}</h1>'
        f'<nav aria-label="Sections">{links}</nav></header>\n<main id="main">\n'
        + "\n".join(bodies)
        + "\n</main>\n"
        + "\n".join([embedded_json(COLOURS, "colours"), tables, *data])
        + (f"\n{embedded_bytes(_plotly(), 'plotly')}" if drawn else "")
        + f"\n{scripts}\n</body></html>\n"
    )


def _part(part: Part, figures: str, alone: bool, viewer: str) -> str:
    prefix = "" if alone else f"{part.name}-"
    level = 2 if alone else 3
    pieces = []
    lead = f'<p class="answer">{escaped(part.sentence)}</p>' if part.sentence else ""
    if part.answer is not None:
        lead += table_markup(part.answer, f"{prefix}answer-table")
    lead += made_by(part.facts, part.command, f"{prefix}made")
    if part.description:
        lead += f'<p class="about">{escaped(part.description)}</p>'
    if lead:
        heading = "The answer" if part.sentence or part.answer is not None else "What it is"
        pieces.append(section(f"{prefix}answer", heading, lead, level))
    if viewer:
        pieces.append(section("pair", "A pair in 3D", viewer, level))
    if part.study is not None:
        pieces.append(section(f"{prefix}study", "Study", _study_markup(part), level))
    if part.failures:
        pieces.append(section(f"{prefix}failures", "Failures", part.failures, level))
    if part.tables:
        body = "\n".join(table_markup(t, f"{prefix}{t.name}") for t in part.tables)
        pieces.append(section(f"{prefix}tables", "Tables", body, level))
    if figures:
        pieces.append(section(f"{prefix}figures", "Figures", figures, level))
    if part.sensor:
        body = "\n".join(table_markup(t, f"{prefix}{t.name}") for t in part.sensor)
        pieces.append(section(f"{prefix}sensor", "The sensor", body, level))
    made = command_markup(part.command) if part.command else ""
    for name, text in (
        ("config.yaml, every default written out", part.config),
        ("What was noted: versions, machine, answer", part.facts),
    ):
        made += details(name, _text(text)) if text else ""
    pieces.append(section(f"{prefix}made", "How it was made", made, level))
    body = "\n".join(pieces)
    return body if alone else section(part.name, part.title, body)


def _links(parts: Sequence[Part], viewer: bool) -> str:
    if len(parts) > 1:
        names = [(part.name, part.title) for part in parts]
    else:
        (part,) = parts
        sections = (
            ("answer", "Answer", part.sentence or part.answer is not None),
            ("study", "Study", part.study),
            ("failures", "Failures", part.failures),
            ("tables", "Tables", part.tables),
            ("figures", "Figures", part.figures),
            ("sensor", "Sensor", part.sensor),
            ("made", "How it was made", True),
        )
        names = [(name, text) for name, text, there in sections if there]
    if viewer:
        after_answer = len(parts) == 1 and names[0][0] == "answer"
        # Of several parts, the first holds it.
        names.insert(1 if after_answer or len(parts) > 1 else 0, ("pair", "In 3D"))
    return " ".join(f'<a href="#{escaped(name)}">{escaped(text)}</a>' for name, text in names)


def viewer_markup(shown: Shown) -> str:
    """The place of the viewer; pair.js fills it, and without scripts a line says so."""
    if not shown.records:
        return ""
    options = "".join(
        f'<option value="{escaped(identity)}">{escaped(_option(identity, found))}</option>'
        for identity, found in shown.records.items()
    )
    template = (ASSETS / "viewer.html").read_text(encoding="utf-8")
    template = template.replace("<!--first-->", escaped(shown.first))
    several = "Trial: the worst first, then the first repeat of every pair"
    template = template.replace("<!--label-->", several if len(shown.records) > 1 else "Pair")
    template = template.replace("<!--total-->", str(max(shown.total, len(shown.trials))))
    return template.replace("<!--options-->", options)


def _option(identity: str, record: Mapping[str, Any]) -> str:
    text = f"{record['pair']}, {record['method']}, repeat {record['repeat']}: {record['status']}"
    if record["error"] is not None:
        text += f", off by {record['error'][0]:.2f}° and {record['error'][1]:.1f} mm"
    return f"{text} ({identity[:8]})"


def _data(shown: Shown) -> list[str]:
    """The records and what they share, once each, and the list of all trials."""
    data: dict[str, str] = {}
    for identity, record in shown.records.items():
        folder = shown.folders[identity]
        own = record_path(folder, identity).read_bytes()
        data[f"trial-{identity}"] = base64.b64encode(own).decode("ascii")
        for name in record["files"].values():
            if name not in data:
                data[name] = base64.b64encode((folder / name).read_bytes()).decode("ascii")
    if shown.trials:
        data["trials"] = base64.b64encode(compressed(list(shown.trials))).decode("ascii")
    return [embedded_bytes(text, f"data-{name}") for name, text in data.items()]


def _table_files(parts: Sequence[Part]) -> str:
    """The tables as csv with raw numbers and as LaTeX, for the buttons that copy them."""
    texts = {}
    for part in parts:
        prefix = "" if len(parts) == 1 else f"{part.name}-"
        answer = () if part.answer is None else (part.answer,)
        for table in (*answer, *part.tables, *part.sensor):
            name = "answer-table" if table is part.answer else table.name
            copied = replace(table, frame=table.frame.head(COPIED_ROWS))
            texts[f"{prefix}{name}"] = {"csv": copied.csv(), "tex": copied.latex()}
    data = base64.b64encode(compressed(texts)).decode("ascii")
    return embedded_bytes(data, "data-tables")


@functools.cache
def _plotly() -> str:
    """The library that draws in 3D, compressed: the page inflates it when it is first needed."""
    from plotly.offline import get_plotlyjs

    data = gzip.compress(get_plotlyjs().encode("utf-8"), compresslevel=4, mtime=0)
    return base64.b64encode(data).decode("ascii")


def _study_markup(part: Part) -> str:
    template = (ASSETS / "studies.html").read_text(encoding="utf-8")
    template = template.replace("<!--still-->", _still_markup(part))
    return template.replace("<!--study-->", escaped(f"study-{part.name}"))


def _still_markup(part: Part) -> str:
    """The study for readers without scripts; nothing where the run has figures of its own of it."""
    if part.study is None or "whole" in part.study:
        return ""
    if any(file.name.startswith("study_") for file in part.figures):
        return ""
    still = base64.b64encode(study_still(part.study)).decode("ascii")
    return (
        '<figure class="picture"><img alt="Share of right answers along every swept key" '
        f'src="data:image/png;base64,{still}"></figure>'
    )


def _studies(parts: Sequence[Part]) -> list[str]:
    return [
        embedded_bytes(
            base64.b64encode(compressed(part.study)).decode("ascii"), f"data-study-{part.name}"
        )
        for part in parts
        if part.study is not None
    ]


def _text(text: str) -> str:
    return f"<pre>{escaped(text)}</pre>"
