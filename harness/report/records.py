"""The records of the trials that the page shows: written by workers, made again where missing."""

from __future__ import annotations

import gzip
import json
import math
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.figures.pair_view import PairView
from harness.report.packing import write_whole
from harness.report.pair_record import write_trial
from harness.report.record_paths import record_path, still_path
from harness.report.thumbnail import thumbnail
from harness.scoring.poses import COARSE, is_success, pose_error
from harness.trials.specs import Trial
from harness.workers.pool import MakeExecutor

if TYPE_CHECKING:  # workers import this, and pandas would cost them 0.4 s
    import pandas as pd

KEPT = 6  # trials without success that a worker keeps unasked, so that few are replayed

_kept: Counter[Path] = Counter()


def keep(pair: PairView, trial: Trial, folder: Path, asked: bool) -> list[Path]:
    """Write the record of a trial when asked, or when it may be among the worst; in a worker."""
    if not asked:
        if trial.spec.given or _kept[folder] >= KEPT or _is_right(pair):
            return []
        _kept[folder] += 1
    return record(pair, trial, folder)


def record(pair: PairView, trial: Trial, folder: Path) -> list[Path]:
    """Write the record and the still picture of a trial; returns the files."""
    files = write_trial(pair, trial, folder)
    still = still_path(folder, trial.id)
    write_whole(still, thumbnail(pair))
    return [*files, still]


def replay(trial: Trial, folder: Path) -> None:
    """Perform a trial again for its record; in a worker."""
    from harness.execution import perform

    pair = perform(trial).pair
    if pair is not None:
        record(pair, trial, folder)


def provided(
    identities: Sequence[str],
    trials: Mapping[str, Trial],
    rows: pd.DataFrame,
    folder: Path,
    make_executor: MakeExecutor,
) -> dict[str, dict[str, Any]]:
    """The records of these trials by id, in their order; missing and outdated ones are replayed.

    rows: as store.load gives them, with which a record has to agree. Files of other trials are
    removed.
    """
    outcomes = {
        row["id"]: (row["status"], row["notes"], row["rotation_error_deg"])
        for row in rows[rows["id"].isin(list(identities))].to_dict("records")
    }
    records = {identity: _load(folder, identity) for identity in identities}
    missing = [
        trials[identity]
        for identity, found in records.items()
        if found is None or not _agrees(found, *outcomes[identity])
    ]
    if missing:
        with make_executor() as executor:
            for job in [executor.submit(replay, trial, folder) for trial in missing]:
                job.result()
        records |= {trial.id: _load(folder, trial.id) for trial in missing}
    found = {key: value for key, value in records.items() if value is not None}
    _forget_others(found, folder)
    return found


def _load(folder: Path, identity: str) -> dict[str, Any] | None:
    try:
        record: dict[str, Any] = json.loads(
            gzip.decompress(record_path(folder, identity).read_bytes())
        )
    except (OSError, EOFError, zlib.error, ValueError):
        return None
    files = [folder / name for name in record["files"].values()]
    return record if all(file.exists() for file in [*files, still_path(folder, identity)]) else None


def _agrees(record: Mapping[str, Any], status: str, notes: str, rotation_error_deg: float) -> bool:
    """Whether a record is that of a row; NaN is a row without an estimate."""
    error = record["error"]
    noted = record.get("notes")
    if record["status"] != status or noted is None or "\n".join(noted) != notes:
        return False
    return math.isnan(rotation_error_deg) if error is None else error[0] == rotation_error_deg


def _forget_others(records: Mapping[str, Mapping[str, Any]], folder: Path) -> None:
    if not folder.is_dir():
        return
    needed = {name for found in records.values() for name in found["files"].values()}
    for identity in records:
        needed |= {record_path(folder, identity).name, still_path(folder, identity).name}
    for file in folder.iterdir():
        if file.name not in needed:
            file.unlink()


def _is_right(pair: PairView) -> bool:
    pose = pair.result.T_target_source
    error = None if pose is None else pose_error(pair.T_target_source_exact, pose)
    return pair.result.status == "ok" and is_success(error, COARSE)
