"""The page of two scans of the user's own: the same viewer, without any truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from harness.figures.pair_view import PairView
from harness.report.packing import compressed, write_whole
from harness.report.page import Part, Shown
from harness.report.pair_record import write_pair
from harness.report.record_paths import RECORDS, record_path
from harness.report.run_page import write_page
from harness.report.thumbnail import thumbnail
from harness.scoring.poses import six_parameters
from harness.tables.pairs import NAMES
from harness.tables.table import Table
from registration.result import RegistrationResult
from registration.scan import Scan

IDENTITY = "own"  # of the only record


def write_own_page(
    folder: Path,
    files: tuple[Path, Path],
    scans: tuple[Scan, Scan],
    method: str,
    result: RegistrationResult,
    facts: str,
    command: str,
) -> Path:
    """Write the page of a registered pair into a folder; returns its file.

    files, scans: target and source. facts: what registration.json holds.
    """
    target, source = files
    pair = PairView(
        pair=f"{source.name} to {target.name}",
        scene="",
        target_view=target.name,
        source_view=source.name,
        method=method,
        repeat=0,
        target=scans[0],
        source=scans[1],
        # Nobody knows it; without surroundings the record leaves it out.
        T_target_source_exact=RigidTransform.identity(),
        overlap=float("nan"),
        result=result,
    )
    pairs = folder / RECORDS
    record = {"id": IDENTITY, **write_pair(pair, None, pairs)}
    write_whole(record_path(pairs, IDENTITY), compressed(record))
    still = folder / "superposition.png"
    write_whole(still, thumbnail(pair))
    sentence = f"{source.name} was registered to {target.name} by {method}: {result.status}"
    if result.T_target_source is None:
        sentence = f"{source.name} could not be registered to {target.name} by {method}"
    if result.reason:
        sentence += f", {result.reason}"
    part = Part(
        name="own",
        title=pair.pair,
        sentence=" ".join([f"{sentence}.", *(f"Note: {note}." for note in result.notes)]),
        answer=pose_table(result),
        tables=[time_table(result)],
        figures=[still],
        facts=facts,
        command=command,
    )
    shown = Shown({IDENTITY: record}, {IDENTITY: pairs}, first=IDENTITY)
    return write_page(folder, f"Registration of {pair.pair}", [part], shown)


def pose_table(result: RegistrationResult) -> Table | None:
    """The six parameters with their standard deviations; None without an estimate."""
    pose = result.T_target_source
    if pose is None:
        return None
    spread = np.full(6, np.nan)
    if result.covariance is not None:
        spread = np.sqrt(np.diagonal(result.covariance))
        spread[:3] = np.rad2deg(spread[:3])
    frame = pd.DataFrame(
        {
            "Parameter": NAMES,
            "Estimate": six_parameters(pose),
            "Standard deviation": spread,
            **{f"Matrix, column {k + 1}": [*pose.as_matrix()[:3, k], *[np.nan] * 3]
               for k in range(4)},
        }
    )  # fmt: skip
    formats = {"Estimate": ".4f", "Standard deviation": ".4f"}
    formats |= {f"Matrix, column {k + 1}": ".6f" for k in range(4)}
    return Table(
        "pose",
        "The pose of the source in the frame of the target",
        "p_target = R p_source + T with R = Rz Ry Rx, in degrees and mm; the matrix is [R T]. "
        "Standard deviations are of a small motion about and along the target's axes, as the "
        "method believes; empty where it does not say.",
        frame,
        formats,
    )


def time_table(result: RegistrationResult) -> Table:
    """How long each stage took."""
    frame = pd.DataFrame(
        {"Stage": [name.replace("_", " ") for name in result.stage_ms],
         "Time (ms)": list(result.stage_ms.values())}
    )  # fmt: skip
    caption = "One core, this run; the first one of a process also loads compiled code."
    return Table("times", "Time by stage", caption, frame, {"Time (ms)": ".1f"})
