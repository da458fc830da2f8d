"""The failures of a run, each with reason, stage at fault, picture and what replays it."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.report.faults import stage_at_fault
from harness.report.markup import escaped, table_markup
from harness.report.offered import worst_first
from harness.report.record_paths import still_path
from harness.report.thumbnail import GAP, HEIGHT, WIDTH
from harness.scoring.poses import COARSE
from harness.scoring.row_scores import within
from harness.tables.notes import with_notes
from harness.tables.sweeps import PREFIX, swept_keys
from harness.tables.table import Table
from harness.trials.points import short_names

Command = Sequence[str]  # "run-experiment configs/desk.yaml ...", word by word


def replay_command(command: Command, identity: str) -> str:
    """What replays a trial, to be pasted into a shell."""
    return shlex.join([*command, "--trial", identity])


def failures_table(rows: pd.DataFrame) -> Table:
    """Every trial of the whole method without a success, the worst first."""
    bad = worst_first(rows[rows["given"] == ""])
    mended = _mended(rows, bad)
    keys = swept_keys(rows)
    names = short_names(keys)
    records = [
        {
            "Trial": row["id"],
            "Pair": row["pair"],
            "Method": row["method"],
            **{names[key]: row[PREFIX + key] for key in keys},
            "Repeat": row["repeat"],
            "Status": row["status"],
            "Rotation error (deg)": row["rotation_error_deg"],
            "Translation error (mm)": row["translation_error_mm"],
            "Stage at fault": stage_at_fault(row["status"], row["stage"], mended[place]),
            "Reason": row["reason"] or "answered without doubt, but wrong",
        }
        for place, row in enumerate(bad.to_dict("records"))
    ]
    return Table(
        "failures_by_stage",
        "Trials without a success, worst first",
        f"Not within {COARSE}, or not sure. The stage at fault is where the method says that it "
        "stopped; of a wrong answer, the stage whose result had to be replaced by the truth for "
        "the same trial to succeed, where that was tried. Empty: nothing tells.",
        with_notes(pd.DataFrame(records), bad),
        {"Repeat": "d", "Rotation error (deg)": ".2f", "Translation error (mm)": ".1f"},
    )


def failures_markup(
    table: Table, command: Command, shown: Collection[str], folder: Path, prefix: str
) -> str:
    """Cards with pictures of the failures that are shown in 3D, and the table of them all."""
    if not len(table.frame):
        return "<p>None: every trial was a success.</p>"
    cards = [
        _card(row, command, folder)
        for row in table.frame.to_dict("records")
        if row["Trial"] in shown
    ]
    note = (
        f"<p>{len(table.frame)} in all; the {len(cards)} below have a picture: target blue, "
        "source orange, front view left, top view right, the source at the estimated pose, or at "
        "the exact one where there is no estimate. Any other one is replayed by "
        f"<code>{escaped(replay_command(command, 'ID'))}</code>.</p>"
    )
    whole = table_markup(table, f"{prefix}{table.name}")
    return f'{note}<div class="cards">{"".join(cards)}</div>{whole}'


def _card(row: Mapping[Any, Any], command: Command, folder: Path) -> str:
    identity = row["Trial"]
    error = "no estimate"
    if np.isfinite(row["Rotation error (deg)"]):
        error = f"off by {row['Rotation error (deg)']:.2f}° and "
        error += f"{row['Translation error (mm)']:.1f} mm"
    heading = f"{row['Pair']}, {row['Method']}, repeat {row['Repeat']}: {row['Status']}, {error}"
    fault = row["Stage at fault"] or "not known"
    notes = f"<p>Note: {escaped(row['Notes'])}.</p>" if row.get("Notes") else ""
    still = base64.b64encode(still_path(folder, identity).read_bytes()).decode("ascii")
    return (
        f'<article class="card"><h3>{escaped(heading)}</h3>'
        f'<img loading="lazy" width="{2 * WIDTH + GAP}" height="{HEIGHT}" '
        f'alt="Both scans of the trial laid on each other" '
        f'src="data:image/png;base64,{still}">'
        f"<p>{escaped(row['Reason'])}</p>{notes}"
        f"<p>Stage at fault: <strong>{escaped(fault)}</strong></p>"
        f"{command_markup(replay_command(command, identity))}"
        f'<p><button type="button" class="js" data-show="{escaped(identity)}">Show in 3D</button>'
        "</p></article>"
    )


def command_markup(command: str) -> str:
    """A command with a button that copies it."""
    return (
        f'<p class="command"><code>{escaped(command)}</code> '
        f'<button type="button" class="js" data-copy="{escaped(command)}">Copy</button></p>'
    )


def _mended(rows: pd.DataFrame, bad: pd.DataFrame) -> list[dict[str, bool]]:
    """For each bad row, whether the same trial succeeded with the truth at a stage, by stage."""
    given = rows[rows["given"] != ""]
    key = ["pair", "method", "repeat", *(["sweep.point"] if "sweep.point" in rows else [])]
    right = dict(
        zip(
            given[[*key, "given"]].itertuples(index=False, name=None),
            within(given, COARSE).tolist(),
            strict=True,
        )
    )
    stages = list(given["given"].unique())
    return [
        {stage: right[(*trial, stage)] for stage in stages if (*trial, stage) in right}
        for trial in bad[key].itertuples(index=False, name=None)
    ]
