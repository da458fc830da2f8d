"""Pieces of the page: text that came from files is escaped here and nowhere else."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from harness.tables.table import Table

LONG_TEXT = 60  # characters
SHOWN_ROWS = 300  # of a long table; the files have it all
COPIED_ROWS = 5000  # by its buttons


def escaped(text: object) -> str:
    """Text as markup that shows just that text, in attributes too."""
    return html.escape(str(text), quote=True)


def embedded_json(value: Any, identity: str) -> str:
    """A JSON value for the page's scripts; no text in it can end the element."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=True)
    text = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return f'<script type="application/json" id="{escaped(identity)}">{text}</script>'


def embedded_bytes(base64_text: str, identity: str) -> str:
    """Compressed data for the page's scripts, in base64."""
    kind = "application/gzip"
    return f'<script type="{kind}" id="{escaped(identity)}">{base64_text}</script>'


def section(identity: str, heading: str, body: str, level: int = 2) -> str:
    """A section with its heading."""
    return (
        f'<section id="{escaped(identity)}"><h{level}>{escaped(heading)}</h{level}>\n{body}\n'
        "</section>"
    )


def details(summary: str, body: str, opened: bool = False) -> str:
    """A part that opens on demand, without any script."""
    mark = " open" if opened else ""
    return f"<details{mark}><summary>{escaped(summary)}</summary>\n{body}\n</details>"


def table_markup(
    table: Table, identity: str, cells: Mapping[str, Mapping[int, str]] | None = None
) -> str:
    """A table with its title and legend; sortable and copied by report.js, plain without it.

    cells: by column and row, markup in place of the printed value.
    """
    columns = list(table.frame.columns)
    numeric = [column in table.formats for column in columns]
    text = replace(table, frame=table.frame.head(SHOWN_ROWS)).text()
    longest = [max((len(row[i]) for row in text), default=0) for i in range(len(columns))]
    head = "".join(
        f'<th scope="col"{_look(is_number, most)}>{escaped(column)}</th>'
        for column, is_number, most in zip(columns, numeric, longest, strict=True)
    )
    rows = []
    raw = table.frame.itertuples(index=False)
    for place, (values, texts) in enumerate(zip(raw, text, strict=False)):
        rows.append(
            "<tr>"
            + "".join(
                f"<td{_sort_key(value)}{_look(is_number)}>"
                f"{((cells or {}).get(column) or {}).get(place) or escaped(text)}</td>"
                for column, value, text, is_number in zip(
                    columns, values, texts, numeric, strict=True
                )
            )
            + "</tr>"
        )
    left_out = ""
    if len(table.frame) > SHOWN_ROWS:
        copied = ""
        if len(table.frame) > COPIED_ROWS:
            copied = f", the first {COPIED_ROWS} are copied by the buttons"
        left_out = (
            f'<p class="note">The first {SHOWN_ROWS} of {len(table.frame)} rows; all are in '
            f"tables/{escaped(table.name)}.csv{copied}.</p>"
        )
    legend = "".join(f"<p>{escaped(line)}</p>" for line in table.legend.split("\n") if line)
    return (
        f'<figure class="table" id="{escaped(identity)}" data-table="{escaped(identity)}">\n'
        f'<figcaption><h3>{escaped(table.title)}</h3></figcaption>\n<div class="wide" tabindex="0" '
        f'role="region" aria-label="{escaped(table.title)}">'
        f"<table><thead><tr>{head}</tr></thead>\n<tbody>{chr(10).join(rows)}</tbody></table></div>"
        f'{left_out}<div class="note">{legend}</div></figure>'
    )


def made_by(noted: str, command: str, place: str) -> str:
    """The config and the versions that made it, in a line; nothing where nobody noted them.

    noted: the text of run.json. place: the element that says it all.
    """
    try:
        facts = json.loads(noted)
        versions = {"Python": facts["python"], **facts["libraries"]}
    except (ValueError, KeyError, TypeError):
        return ""
    made = [str(facts["started"])[:10]] if "started" in facts else []
    if isinstance(facts.get("commit"), str):
        commit, _, changed = facts["commit"].partition("-")
        made.append(f"commit {commit[:12]}{' and changes' if changed else ''}")
    made += [f"{name} {version}" for name, version in versions.items()]
    how = f"<code>{escaped(command)}</code>, " if command else ""
    return (
        f'<p class="note">Made by {how}{escaped(", ".join(made))}; '
        f'<a href="#{escaped(place)}">the whole of it</a>.</p>'
    )


def _look(is_number: bool, longest: int = 0) -> str:
    """Numbers stand on the right; a column of sentences gets room, or each would be a tower."""
    if is_number:
        return ' class="n"'
    return ' class="long"' if longest > LONG_TEXT else ""


def _sort_key(value: object) -> str:
    """The raw number of a cell, by which a column is sorted; text sorts as it reads."""
    if isinstance(value, (int, float)) and not math.isnan(value):
        return f' data-v="{value:.9g}"'
    return ""
