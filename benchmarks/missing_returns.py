"""How much of a scan gauss_sphere can do without: random pairs with returns taken away.

python benchmarks/missing_returns.py [--pairs N] [--seed N]

Views are those of configs/random_pairs.yaml with another seed, calibrated. Right is an answer
marked "ok" within 1 degree and 5 mm, wrong one beyond 5 degrees or 30 mm, inexact one between.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

import argparse  # noqa: E402
from collections import Counter  # noqa: E402
from collections.abc import Callable, Mapping, Sequence  # noqa: E402
from dataclasses import replace  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.spatial.transform import RigidTransform  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.config.reading import load_experiment  # noqa: E402
from harness.execution import full_spec, scan_view  # noqa: E402
from harness.scoring.poses import COARSE, FINE, exact_pose, is_success, pose_error  # noqa: E402
from harness.trials.random_pairs import build_random_trials  # noqa: E402
from harness.trials.specs import Trials  # noqa: E402
from registration import Scan, register  # noqa: E402
from registration.gauss_sphere.params import GaussSphereParams  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "configs" / "random_pairs.yaml"
PARAMS = GaussSphereParams(calibration=str(ROOT / "configs" / "calibration" / "jupiter.json"))
FAMILIES = ("desk", "foam_chair", "clutter")
OUTCOMES = ("right", "inexact", "wrong", "ambiguous", "underdetermined", "failed")

Missing = Callable[[tuple[int, int], np.random.Generator], NDArray[np.bool_]]


def some(share: float) -> Missing:
    return lambda shape, rng: rng.random(shape) < share


def stripes(number: int, widest: int) -> Missing:
    """Stripes of up to so many beams, in each profile elsewhere."""

    def missing(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.bool_]:
        beam = np.arange(shape[1])[:, None]
        first = rng.integers(shape[1], size=(shape[0], 1, number))
        width = rng.integers(1, widest + 1, size=first.shape)
        return ((first <= beam) & (beam < first + width)).any(axis=2)

    return missing


def all_but_every(nth: int) -> Missing:
    return lambda shape, _: np.broadcast_to(np.arange(shape[1]) % nth > 0, shape)


def whole_profiles(share: float) -> Missing:
    return lambda shape, rng: np.broadcast_to(rng.random((shape[0], 1)) < share, shape)


CASES: dict[str, Missing] = {
    "nothing": some(0.0),
    "a tenth of the points": some(0.1),
    "three in ten": some(0.3),
    "half": some(0.5),
    "seven in ten": some(0.7),
    "eight stripes of up to 12 beams": stripes(8, 12),
    "every second beam": all_but_every(2),
    "three of four beams": all_but_every(4),
    "a tenth of the profiles": whole_profiles(0.1),
    "three in ten profiles": whole_profiles(0.3),
    "half of the profiles": whole_profiles(0.5),
}


def without(missing: Missing, scan: Scan, rng: np.random.Generator) -> Scan:
    taken_away = missing(scan.points_mm.shape[:2], rng)[..., None]
    return replace(scan, points_mm=np.where(taken_away, np.nan, scan.points_mm))


def judged(scans: list[Scan], T_exact: RigidTransform) -> str:
    """What comes of registering target and source: the name of a column."""
    result = register(*scans, params=PARAMS)
    if result.status != "ok" or result.T_target_source is None:
        return result.status
    error = pose_error(T_exact, result.T_target_source)
    exact, close = (is_success(error, tolerance) for tolerance in (FINE, COARSE))
    return "right" if exact else "inexact" if close else "wrong"


def trials_of(count: int, seed: int, changes: Sequence[str] = ()) -> Trials:
    """So many random pairs of each family; changes: of the config."""
    pairs = [f"families.{family}.pairs={count}" for family in FAMILIES]
    overrides = [*pairs, "methods=[{name: gauss_sphere}]", *changes]
    return build_random_trials(load_experiment(CONFIG, overrides, seed), CONFIG)


def count_outcomes(
    description: str,
    seed: int,
    heading: str,
    cases: Mapping[str, Callable[[Scan, np.random.Generator], Scan]],
    changes: Sequence[str] = (),
) -> None:
    """Print how pairs of views come out whose scans are changed as each case says.

    seed: where the command line names no other. changes: of the config.
    """
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=20, help="of each family")
    parser.add_argument("--seed", type=int, default=seed)
    options = parser.parse_args()
    counts = {case: Counter[str]() for case in cases}
    for number, trial in enumerate(trials_of(options.pairs, options.seed, changes)):
        spec = full_spec(trial)
        scans = [scan_view(spec, view) for view in (spec.target, spec.source)]
        T_exact = exact_pose(*spec.paths)
        for case, changed in cases.items():
            rng = np.random.default_rng([options.seed, number])
            counts[case][judged([changed(scan, rng) for scan in scans], T_exact)] += 1
    rows = [
        [case, count.total(), *(count[name] for name in OUTCOMES)] for case, count in counts.items()
    ]
    print(tabulate(rows, [heading, "pairs", *OUTCOMES], "github"))


if __name__ == "__main__":
    count_outcomes(
        __doc__,
        20105,
        "missing",
        {case: partial(without, missing) for case, missing in CASES.items()},
    )
