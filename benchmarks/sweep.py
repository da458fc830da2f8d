"""How fast a sweep runs: trials a second, overhead, two workers against one, start, reading back.

python benchmarks/sweep.py [--trials N] [--rows N] [--asked N] [--points N]

--asked is the size of a sweep of which only the start is measured: the time to its first row and
the memory of the process that drives it. --points is at how many different points it is.

A trial is a 40 x 256 pair of the desk with all noise, scanned anew, registered and scored. Run it
on an idle machine: everything else that runs makes all of it slower.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from harness.workers.threads import limit_threads

limit_threads()

import numpy as np  # noqa: E402
from scipy.spatial.transform import RigidTransform, Rotation  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.execution import perform  # noqa: E402
from harness.scoring.poses import COARSE  # noqa: E402
from harness.scoring.row_scores import within  # noqa: E402
from harness.session import execute, open_session, plan  # noqa: E402
from harness.store import Store, load  # noqa: E402
from harness.trials.specs import Trial  # noqa: E402
from harness.workers.pool import process_pool  # noqa: E402

CONFIG = """\
title: Desk, two views
scene: {name: desk}
sensor: {name: jupiter, params: {pixels: 256}}
arm: {bracket_mm: [3, 3, 3], bracket_deg: [0.2, 0.2, 0.2]}
scan: {profiles: 40, step_mm: 5.0}
views:
  left: {aim_mm: [0, 0, 120], distance_mm: 900, yaw_deg: -12, pitch_deg: 25}
  right: {aim_mm: [0, 0, 120], distance_mm: 900, yaw_deg: 12, pitch_deg: 25}
pairs:
  desk: {source: left, target: right}
methods:
  - {name: METHOD, figures: false}
"""


def config(folder: Path, method: str) -> Path:
    file = folder / f"{method}.yaml"
    file.write_text(CONFIG.replace("METHOD", method), encoding="utf-8")
    return file


def alone_s(file: Path, trials: int) -> float:
    """Seconds that so many trials take one after the other, with nothing around them."""
    session = open_session(file, None, [f"repeats={trials}", "seed=1"])
    perform(session.base[0])
    start = time.perf_counter()
    for trial in session.trials:
        perform(trial)
    return time.perf_counter() - start


def run_s(file: Path, trials: int, workers: int) -> float:
    """Seconds that a run of so many trials takes, from the second row on: without its start."""
    with tempfile.TemporaryDirectory() as folder:
        session = open_session(file, Path(folder), [f"repeats={trials + workers}", "seed=1"])
        with Store(session.folder) as store:
            planned = plan(session, store)
            tasks = tuple(replace(task, records=None) for task in planned.tasks)
            going = execute(session, store, replace(planned, tasks=tasks), process_pool(workers))
            for _ in range(workers):
                next(going)
            start = time.perf_counter()
            for _ in going:
                pass
            return time.perf_counter() - start


def first_row_s(file: Path) -> float:
    """Seconds from the command to its first line about a trial."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "experiments.cli", str(file), "--out", folder]
        start = time.perf_counter()
        with subprocess.Popen(
            [*command, "--set", "repeats=9"], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith("["):
                    break
            taken = time.perf_counter() - start
            process.stdout.read()
    return taken


def start_of(trials: int, most_points: int) -> None:
    """Print as JSON the seconds to the first row of a sweep and the MB that its driver took."""
    start = time.perf_counter()
    points = min(most_points, trials)
    with tempfile.TemporaryDirectory() as name:
        key = "methods.thesis.params.segments.warp_mm"
        values = "{distribution: uniform, from: 2, to: 8}"
        sweep = f"{{design: latin_hypercube, samples: {points}, over: {{{key}: {values}}}}}"
        overrides = [f"repeats={trials // points}", f"sweep={sweep}"]
        session = open_session(config(Path(name), "thesis"), Path(name) / "out", overrides)
        with Store(session.folder) as store:
            going = execute(session, store, plan(session, store), process_pool(2))
            next(going)
            seconds = time.perf_counter() - start
            going.close()  # type: ignore[attr-defined]  # a generator, which ends its workers
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(json.dumps({"trials": len(session.trials), "seconds": seconds, "megabytes": most}))


def started(trials: int, points: int) -> dict[str, float]:
    """start_of in a process of its own."""
    command = [sys.executable, __file__, "--start-of", str(trials), "--points", str(points)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(answer.stdout)
    return found


def reading(rows: int) -> tuple[float, float, float]:
    """Seconds to write rows like those of a sweep, and to load and summarise them; GB on disk."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        session = open_session(config(folder, "thesis"), folder, ["repeats=1"])
        example = perform(session.trials[0]).row
        (trial,) = session.trials
        turns, shifts = Rotation.random(rows, rng=rng), rng.normal(0.0, 300.0, (rows, 3))
        poses = RigidTransform.from_components(shifts, turns)  # each different, as in a sweep
        start = time.perf_counter()
        with Store(folder) as store:
            specs = [Trial(_Numbered(trial.spec, i), "desk", "thesis") for i in range(rows)]
            store.begin(specs)
            for begin in range(0, rows, 1000):
                store.add_all(
                    (
                        replace(
                            example, id=specs[i].id, status="ok", T_estimated=poses[i],
                            rotation_error_deg=float(i % 7), translation_error_mm=float(i % 41),
                        )
                        for i in range(begin, min(begin + 1000, rows))
                    ),
                    "code",
                )  # fmt: skip
        written_s = time.perf_counter() - start
        size = sum(file.stat().st_size for file in folder.iterdir())
        start = time.perf_counter()
        frame = load(folder, arrays=False)
        frame["right"] = within(frame, COARSE)
        by_method = frame.groupby("method", sort=False)
        summary = by_method[["right", "rotation_error_deg", "translation_error_mm"]]
        assert len(frame) == rows
        assert 0.0 < summary.mean()["right"].iloc[0] < 1.0
        by_method[["rotation_error_deg", "translation_error_mm"]].quantile(0.5)
        return written_s, time.perf_counter() - start, size / 1e9


class _Numbered:
    """A spec of which there may be a million."""

    given = ""

    def __init__(self, spec: object, number: int) -> None:
        self.spec, self.repeat, self.id = spec, number, f"{number:016x}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--asked", type=int, default=100_000)
    parser.add_argument("--points", type=int, default=1000)
    parser.add_argument("--start-of", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--best-of", type=int, default=3)
    options = parser.parse_args()
    if options.start_of:
        start_of(options.start_of, options.points)
        return
    found: list[tuple[str, str, str]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for method in ("thesis", "gauss_sphere"):
            file, count = config(folder, method), options.trials
            alone = one = two = float("inf")
            for _ in range(options.best_of):
                alone = min(alone, alone_s(file, count))
                one = min(one, run_s(file, count, 1))
                two = min(two, run_s(file, count, 2))
            found += [
                (f"{method}: trials/s, 2 workers", f"{count / two:.1f}", "25 or more"),
                (f"{method}: overhead of a run, 1 worker", f"{one / alone - 1.0:.1%}", "under 5 %"),
                (f"{method}: 2 workers against 1", f"{one / two:.2f} times", "1.8 or more"),
            ]
        file = config(folder, "thesis")
        starts = [first_row_s(file) for _ in range(options.best_of)]
        found.append(("start to first trial", f"{min(starts):.1f} s", "under 3 s"))
    for trials in (1000, options.asked):
        begun = started(trials, options.points)
        told = f"{begun['seconds']:.1f} s, {begun['megabytes']:.0f} MB"
        found.append((f"{begun['trials']} trials: to the first row", told, "as much memory"))
    written_s, read_s, gigabytes = reading(options.rows)
    found.append((f"{options.rows} rows: load and summarise", f"{read_s:.1f} s", "under 10 s"))
    found.append((f"{options.rows} rows: write", f"{written_s:.0f} s, {gigabytes:.2f} GB", ""))
    print(tabulate(found, ("what", "measured", "goal"), "github"))
    print(json.dumps({"cores": os.cpu_count(), "load before": os.getloadavg()[2]}))


if __name__ == "__main__":
    main()
