"""What `run-experiment --dry-run` tells: how many trials there are, and how long they may take."""

from __future__ import annotations

import time
from array import array
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from experiments.cli import EXIT_OK
from experiments.commands import available_cores, tell_beyond_reach, tell_left_out
from experiments.progress import duration
from experiments.terminal import make_console, outcome, trial_name
from harness.session import Session
from harness.trials.specs import Trial

REHEARSED = 3  # trials that are timed


class Size(NamedTuple):
    """Of an experiment: its points, the different trials, and the pairs of scans these need."""

    points: int
    different: int
    scans: int


def dry_run(session: Session, workers: int | None) -> int:
    """Count the trials, show the first, time some; writes nothing."""
    console = make_console()
    workers = min(workers or available_cores(), len(session.trials))
    size = size_of(session.trials)
    at = f" at {size.points} points" if size.points else ""
    console.print(f"{session.experiment.title}: {len(session.trials)} trials{at}")
    for trial in session.trials[:REHEARSED]:
        console.print(f"  {trial.id}  {trial_name(trial)}", soft_wrap=True)
    console.print("  ..." if len(session.trials) > REHEARSED else "")
    tell_left_out(console, session)
    tell_beyond_reach(console, session)
    from harness.execution import perform

    perform(session.trials[0])  # the first one compiles and loads, which no other has to do
    scanned = {session.trials[0].spec.scan_key}
    scan_s, own_s = [], []
    for trial in _rehearsed(session):
        start = time.perf_counter()
        row = perform(trial).row
        took_s = time.perf_counter() - start
        own_s.append(row.stage_ms.get("registration", 0.0) / 1e3)
        if trial.spec.scan_key not in scanned:
            scan_s.append(took_s - own_s[-1])
        scanned.add(trial.spec.scan_key)
        console.print(f"{trial_name(trial)}: {outcome(row)}", soft_wrap=True)
    # Scans are made once for all the trials that share them.
    whole_s = size.different * _mean(own_s) + size.scans * _mean(scan_s)
    console.print(
        f"{size.different} different trials at {_mean(own_s):.2f} s, {size.scans} pairs of scans "
        f"at {_mean(scan_s):.2f} s: about {duration(whole_s / workers)} with {workers} "
        f"workers, figures apart; rows would go to {session.folder}".replace(
            "about under", "under"
        ),
        soft_wrap=True,
    )
    return EXIT_OK


def size_of(trials: Sequence[Trial]) -> Size:
    """How much is asked for, from 16 bytes of each trial however many there are."""
    ids, scans, points, last = array("Q"), array("q"), 0, None
    for trial in trials:
        ids.append(int(trial.id, 16))
        scans.append(hash(trial.spec.scan_key))
        points += trial.point is not None and trial.point is not last
        last = trial.point
    return Size(points, *(len(np.unique(np.asarray(numbers))) for numbers in (ids, scans)))


def _rehearsed(session: Session) -> Sequence[Trial]:
    """Some trials to time: of a sweep from all over it, as its points may differ in cost.

    Else such that have scans of their own.
    """
    trials: Sequence[Trial] = session.trials
    if session.experiment.sweep is None:
        by_scans: dict[object, Trial] = {}
        for trial in trials:
            by_scans.setdefault(trial.spec.scan_key, trial)
            if len(by_scans) > REHEARSED:
                break
        apart = list(by_scans.values())[1 : 1 + REHEARSED]
        return apart if len(apart) == REHEARSED else trials[1 : 1 + REHEARSED] or trials
    if len(trials) <= 2 * REHEARSED:
        return trials[1 : 1 + REHEARSED] or trials
    return [trials[(2 * i + 1) * len(trials) // (2 * REHEARSED)] for i in range(REHEARSED)]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0
