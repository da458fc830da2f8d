"""All methods on the same random pairs, in one process on one core, beside the fastest peer.

python benchmarks/pairs.py [--pairs N] [--turns N] [--profiles N ...] [--methods WORD ...]
    [--all-cores]

Pairs are those of configs/random_pairs.yaml with another seed, so that nothing is tuned on what is
reported. Methods take turns on each pair, another one first in each turn, so that a machine whose
speed changes is as fast for one as for the other; of the two calls of a turn the faster one counts,
as the first finds the caches as another method left them. Times are the least of the turns on a
pair, which is what a method needs when nothing else runs, in the median and mean over pairs.
Ratios are those within a turn, in the median of the turns on a pair, then the median, least and
most over pairs, and last the ratio of the times that all pairs take together. Peers that are not
installed are left out, and told. With --all-cores peers may use every core, as they do by default;
our methods use one all the same.
"""

from __future__ import annotations

import os
import sys

ALL_CORES = "--all-cores"
# Before any library is imported: one core, for those that take all they may, and one thread.
if ALL_CORES not in sys.argv and hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
from harness.workers.threads import limit_threads  # noqa: E402

limit_threads()

import argparse  # noqa: E402
import time  # noqa: E402
from dataclasses import replace  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any, NamedTuple  # noqa: E402

import numpy as np  # noqa: E402
from scipy.spatial.transform import RigidTransform  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.config.reading import load_experiment  # noqa: E402
from harness.execution import full_spec, scan_view  # noqa: E402
from harness.scoring.poses import (  # noqa: E402
    COARSE,
    FINE,
    PoseError,
    exact_pose,
    is_success,
    pose_error,
)
from harness.trials.random_pairs import build_random_trials  # noqa: E402
from registration import Scan, register  # noqa: E402
from registration.gauss_sphere.params import GaussSphereParams  # noqa: E402
from registration.peers import PEERS, MissingPeerError, check_installed  # noqa: E402
from registration.peers.params import (  # noqa: E402
    FgrParams,
    IcpParams,
    KissMatcherParams,
    RansacParams,
    RefineParams,
)
from registration.scan import FloatArray  # noqa: E402
from registration.thesis.params import ThesisParams  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "configs" / "random_pairs.yaml"
CALIBRATION = str(ROOT / "configs" / "calibration" / "jupiter.json")
GICP, PLANE = RefineParams(kind="gicp"), RefineParams(kind="point_to_plane")


class Entry(NamedTuple):
    """A method with parameters, by the name it is listed under."""

    label: str
    method: str
    params: Any


def entries(all_cores: bool) -> list[Entry]:
    own = [
        Entry("gauss_sphere", "gauss_sphere", GaussSphereParams(calibration=CALIBRATION)),
        Entry("gauss_sphere without calibration", "gauss_sphere", GaussSphereParams()),
        Entry("thesis", "thesis", ThesisParams()),
    ]
    peers = []
    # The last voxel is the library's own: of Open3D's tutorial, and KISS-Matcher's default.
    for name, method, params_type, own_voxel_mm in (
        ("RANSAC", "open3d_ransac", RansacParams, 50.0),
        ("FGR", "open3d_fgr", FgrParams, 50.0),
        ("KISS-Matcher", "kiss_matcher", KissMatcherParams, 300.0),
    ):
        for voxel_mm in (3.0, 5.0, 10.0, own_voxel_mm):
            label = f"{name} {voxel_mm:g} mm"
            peers.append(Entry(label, method, params_type(voxel_mm=voxel_mm)))
            peers.append(Entry(f"{label} + GICP", method, params_type(voxel_mm, refine=GICP)))
            plane = params_type(voxel_mm, refine=PLANE)
            peers.append(Entry(f"{label} + point to plane", method, plane))
    peers.append(Entry("GICP from the identity", "icp", IcpParams()))
    if all_cores:
        cores = os.cpu_count() or 1
        peers = [peer._replace(params=replace(peer.params, threads=cores)) for peer in peers]
    return own + peers


def _installed(entry: Entry) -> bool:
    try:
        check_installed(entry.method, entry.params)
    except MissingPeerError as error:
        print(f"left out: {entry.label}: {error}")
        return False
    return True


def pairs(count: int, profiles: int, seed: int) -> list[tuple[Scan, Scan, RigidTransform]]:
    overrides = [f"scan.profiles={profiles}", "methods=[{name: gauss_sphere}]"]
    overrides.append(f"scan.step_mm={400.0 / profiles}")  # the same line, finer or coarser
    experiment = load_experiment(CONFIG, overrides, seed)
    found = []
    for trial in build_random_trials(experiment, CONFIG)[:count]:
        spec = full_spec(trial)
        target, source = (scan_view(spec, view) for view in (spec.target, spec.source))
        found.append((target, source, exact_pose(*spec.paths)))
    return found


def errors_of(
    entry: Entry, found: list[tuple[Scan, Scan, RigidTransform]]
) -> list[PoseError | None]:
    """The error of each answer marked ok; whatever a method loads at first is loaded then."""
    results = [register(target, source, entry.method, entry.params) for target, source, _ in found]
    return [
        pose_error(T_exact, result.T_target_source)
        if result.status == "ok" and result.T_target_source is not None
        else None
        for result, (_, _, T_exact) in zip(results, found, strict=True)
    ]


def measured_ms(
    chosen: list[Entry], found: list[tuple[Scan, Scan, RigidTransform]], turns: int
) -> FloatArray:
    """Times (entries, pairs, turns) in ms."""
    times_ms = np.empty((len(chosen), len(found), turns))
    for turn in range(turns):
        for p, (target, source, _) in enumerate(found):
            for e in np.roll(np.arange(len(chosen)), turn):
                calls_ms = []
                for _ in range(2):
                    start = time.perf_counter()
                    register(target, source, chosen[e].method, chosen[e].params)
                    calls_ms.append(1e3 * (time.perf_counter() - start))
                times_ms[e, p, turn] = min(calls_ms)
    return times_ms


def table(chosen: list[Entry], errors: list[list[PoseError | None]], times_ms: FloatArray) -> str:
    """A line a method, the fastest first."""
    least_ms = times_ms.min(axis=2)
    middle_ms = np.median(least_ms, axis=1)
    labels = [entry.label for entry in chosen]
    peers = [e for e, entry in enumerate(chosen) if entry.method in PEERS]
    beside = {"gauss_sphere": labels.index("gauss_sphere")} if "gauss_sphere" in labels else {}
    if peers:
        beside["the fastest peer"] = min(peers, key=lambda e: middle_ms[e])
    rows = []
    for e in np.argsort(middle_ms):
        ratios = [_ratios(times_ms[e], times_ms[other]) for other in beside.values()]
        rows.append(
            [
                labels[e], middle_ms[e], least_ms[e].mean(), least_ms[e].max(), *ratios,
                *(sum(is_success(error, t) for error in errors[e]) for t in (FINE, COARSE)),
            ]
        )  # fmt: skip
    headers = [
        "method", "median pair (ms)", "mean pair (ms)", "slowest pair (ms)",
        *(f"times as long as {name} (of pairs; all of them)" for name in beside),
        *(f"within {t.rotation_deg:g} deg, {t.translation_mm:g} mm" for t in (FINE, COARSE)),
    ]  # fmt: skip
    return tabulate(rows, headers, "github", floatfmt=".1f")


def _ratios(times_ms: FloatArray, others_ms: FloatArray) -> str:
    """How many times as long a method took as another: of pairs, and of all pairs together."""
    of_pairs = np.median(times_ms / others_ms, axis=1)
    of_all = times_ms.min(axis=1).sum() / others_ms.min(axis=1).sum()
    span = f"{of_pairs.min():.2f} to {of_pairs.max():.2f}"
    return f"{np.median(of_pairs):.2f} ({span}; {of_all:.2f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=12)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--profiles", type=int, nargs="+", default=[40, 130])
    parser.add_argument("--methods", nargs="+", default=[], help="only labels that hold a word")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument(ALL_CORES, action="store_true", help="as many threads for peers")
    options = parser.parse_args()
    chosen = [
        entry
        for entry in entries(options.all_cores)
        if not options.methods or any(word in entry.label for word in options.methods)
    ]
    chosen = [entry for entry in chosen if entry.method not in PEERS or _installed(entry)]
    for profiles in options.profiles:
        found = pairs(options.pairs, profiles, options.seed)
        print(f"\n{profiles} x 256 points, {len(found)} pairs, {options.turns} turns")
        errors = [errors_of(entry, found) for entry in chosen]
        print(table(chosen, errors, measured_ms(chosen, found, options.turns)))


if __name__ == "__main__":
    main()
