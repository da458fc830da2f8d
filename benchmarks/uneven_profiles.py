"""How gauss_sphere takes profiles at uneven distances: random pairs, scanned twice as densely.

python benchmarks/uneven_profiles.py [--pairs N] [--seed N]

Of 160 profiles 2.5 mm apart some 55 to 110 are taken; the others are left out, not given as empty.
In the last cases some in a row are lost besides, and X goes on as if none were: both scans lie.
Views and words are those of missing_returns.py.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

from collections.abc import Callable  # noqa: E402
from functools import partial  # noqa: E402

import numpy as np  # noqa: E402
from missing_returns import count_outcomes  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from registration import Scan  # noqa: E402

PROFILES, STEP_MM = 160, 2.5
EVEN = np.arange(0, PROFILES, 2)

Taken = Callable[[np.random.Generator], NDArray[np.int64]]


def speeding_up(power: float) -> Taken:
    """From slow to so many times the mean speed."""
    along = np.linspace(0.0, 1.0, EVEN.size) ** power
    return lambda _: np.unique(np.round((PROFILES - 1) * along).astype(np.int64))


def braking_within(rng: np.random.Generator) -> NDArray[np.int64]:
    """Half as fast over a third of the way, somewhere."""
    start = rng.integers(PROFILES // 2)
    slowly = np.arange(start, start + PROFILES // 3)
    return np.union1d(EVEN[(start > EVEN) | (slowly[-1] < EVEN)], slowly)


CASES: dict[str, Taken] = {
    "even": lambda _: EVEN,
    "each shaken by up to half a step": lambda rng: np.unique(
        np.clip(EVEN + rng.integers(-1, 2, EVEN.size), 0, PROFILES - 1)
    ),
    "speeding up to 1.2 times the mean": speeding_up(1.2),
    "speeding up to 1.5 times the mean": speeding_up(1.5),
    "speeding up to twice the mean": speeding_up(2.0),
    "half as fast over a third of the way": braking_within,
    "any 80 of the 160": lambda rng: np.sort(rng.choice(PROFILES, EVEN.size, replace=False)),
    "one in five lost": lambda rng: EVEN[rng.random(EVEN.size) >= 0.2],
}


def thinned(taken: Taken, scan: Scan, rng: np.random.Generator) -> Scan:
    profiles = taken(rng)
    step_mm = STEP_MM * np.ptp(profiles) / (profiles.size - 1)
    return Scan.from_points(scan.points_mm[profiles], step_mm, apex_mm=scan.apex_mm)


def closed_up(lost: int, scan: Scan, rng: np.random.Generator) -> Scan:
    """Every second profile, but for so many in a row, in even steps of X all the same."""
    start = rng.integers(EVEN.size // 4, 3 * EVEN.size // 4 - lost)
    points_mm = scan.points_mm[np.delete(EVEN, np.arange(start, start + lost))].copy()
    points_mm[start:, :, 0] -= 2.0 * STEP_MM * lost
    return Scan.from_points(points_mm, 2.0 * STEP_MM, apex_mm=scan.apex_mm)


if __name__ == "__main__":
    count_outcomes(
        __doc__,
        20106,
        "profiles",
        {
            **{case: partial(thinned, taken) for case, taken in CASES.items()},
            **{f"{n} in a row lost, X in even steps": partial(closed_up, n) for n in (2, 4, 8)},
        },
        [f"scan.profiles={PROFILES}", f"scan.step_mm={STEP_MM}"],
    )
