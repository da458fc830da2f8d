"""All methods on the same random pairs, in one process on one core, beside the fastest peer.

python benchmarks/pairs.py [--pairs N] [--turns N] [--profiles N ...] [--methods WORD ...]
    [--all-cores]

Pairs are those of configs/random_pairs.yaml with another seed, so that nothing is tuned on what is
reported. Methods take turns on each pair, so that a machine whose speed changes is as fast for one
as for the other; of the two calls of a turn the faster one counts, as the first finds the caches as
another method left them. Times are the least of the turns on a pair, which is what the method needs
when nothing else runs, then the median over pairs; ratios to gauss_sphere are of the same turn.
Peers that are not installed are left out, and told. With --all-cores peers may use every core, as
they do by default; our methods use one all the same.
"""

from __future__ import annotations

import os
import sys

ALL_CORES = "--all-cores"
# Before any library is imported: one core, for those that take all they may, and one thread.
if ALL_CORES not in sys.argv and hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
from harness.threads import limit_threads  # noqa: E402

limit_threads()

import argparse  # noqa: E402
import time  # noqa: E402
from dataclasses import replace  # noqa: E402
from itertools import product  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any, NamedTuple  # noqa: E402

import numpy as np  # noqa: E402
from scipy.spatial.transform import RigidTransform  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.config import load_experiment  # noqa: E402
from harness.execution import full_spec, scan_view  # noqa: E402
from harness.random_pairs import build_random_trials  # noqa: E402
from harness.scoring import (  # noqa: E402
    COARSE,
    FINE,
    PoseError,
    exact_pose,
    is_success,
    pose_error,
)
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
    for voxel_mm in (3.0, 5.0, 10.0):
        for name, method, params_type in (
            ("RANSAC", "open3d_ransac", RansacParams),
            ("FGR", "open3d_fgr", FgrParams),
            ("KISS-Matcher", "kiss_matcher", KissMatcherParams),
        ):
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
        found.append((target, source, exact_pose(spec.path(spec.target), spec.path(spec.source))))
    return found


def measure(
    chosen: list[Entry], found: list[tuple[Scan, Scan, RigidTransform]], turns: int
) -> tuple[FloatArray, list[list[PoseError | None]]]:
    """Times (entries, pairs, turns) in ms, and of each entry the errors of its answers."""
    times_ms = np.empty((len(chosen), len(found), turns))
    errors: list[list[PoseError | None]] = [[] for _ in chosen]
    for entry in chosen:
        register(*found[0][:2], entry.method, entry.params)  # whatever is loaded at first
    for turn, (p, (target, source, T_exact)) in product(range(turns), enumerate(found)):
        for e, entry in enumerate(chosen):
            calls_ms = []
            for _ in range(2):
                start = time.perf_counter()
                result = register(target, source, entry.method, entry.params)
                calls_ms.append(1e3 * (time.perf_counter() - start))
            times_ms[e, p, turn] = min(calls_ms)
            if turn == 0:
                answered = result.status == "ok" and result.T_target_source is not None
                errors[e].append(pose_error(T_exact, result.T_target_source) if answered else None)
    return times_ms, errors


def table(chosen: list[Entry], times_ms: FloatArray, errors: list[list[PoseError | None]]) -> str:
    """A line a method, the fastest first."""
    least = times_ms.min(axis=2)
    typical = np.median(least, axis=1)
    of_peers = [ms for entry, ms in zip(chosen, typical, strict=True) if entry.method in PEERS]
    labels, rows = [entry.label for entry in chosen], []
    own = times_ms[labels.index("gauss_sphere")] if "gauss_sphere" in labels else np.nan
    for e in np.argsort(typical):
        low, middle, high = np.quantile(times_ms[e] / own, [0.1, 0.5, 0.9])
        successes = (sum(is_success(error, t) for error in errors[e]) for t in (FINE, COARSE))
        rows.append(
            [labels[e], typical[e], np.median(times_ms[e]), least[e].max(),
             min(of_peers, default=np.nan) / typical[e], f"{middle:.1f} ({low:.1f} to {high:.1f})",
             *successes]
        )  # fmt: skip
    headers = [
        "method", "least (ms)", "median (ms)", "slowest pair (ms)",
        "times as fast as the fastest peer", "times as long as gauss_sphere (10 to 90 %)",
        *(f"within {t.rotation_deg:g} deg, {t.translation_mm:g} mm" for t in (FINE, COARSE)),
    ]  # fmt: skip
    formats = ("", ".1f", ".1f", ".1f", ".2f", "", "d", "d")
    return tabulate(rows, headers, "github", floatfmt=formats)


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
        print(table(chosen, *measure(chosen, found, options.turns)))


if __name__ == "__main__":
    main()
