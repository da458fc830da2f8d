"""How gauss_sphere takes depths that are not as the sensor measured them: random pairs, changed.

python benchmarks/changed_depths.py [--pairs N] [--seed N]

Smoothed along profiles, as many sensors do by themselves; with wild points, and numbers in place of
no return; shaken, rounded. Views and words are those of missing_returns.py.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

import warnings  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import replace  # noqa: E402
from functools import partial  # noqa: E402

import numpy as np  # noqa: E402
from missing_returns import count_outcomes  # noqa: E402
from numpy.lib.stride_tricks import sliding_window_view  # noqa: E402

from registration import Scan  # noqa: E402
from registration.scan import FloatArray  # noqa: E402

APEX_MM = -60.0  # of the sensor, behind its front: where depths change, points move along beams
EDGE_MM = 10.0  # points farther off in depth are of another face: no filter mixes them
OUTLIERS_MM = (500.0, 1500.0)  # between which wild returns lie

Changed = Callable[[FloatArray, np.random.Generator], FloatArray]  # depths (profiles, pixels)


def smoothed(average: Callable[..., FloatArray], pixels: int) -> Changed:
    """Each depth the average of those around it, on its own face."""
    half = pixels // 2

    def change(depth_mm: FloatArray, _: np.random.Generator) -> FloatArray:
        padded = np.pad(depth_mm, ((0, 0), (half, half)), constant_values=np.nan)
        around = sliding_window_view(padded, 2 * half + 1, axis=1)
        alike = np.where(abs(around - depth_mm[..., None]) < EDGE_MM, around, np.nan)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of windows without a return
            return np.where(np.isfinite(depth_mm), average(alike, axis=2), np.nan)

    return change


def wild(number: int | float, low_mm: float, high_mm: float, width: int = 1) -> Changed:
    """So many of the points, or such a share of them, anywhere between two depths.

    width: as many side by side are at one depth; where two meet, they are fewer.
    """

    def change(depth_mm: FloatArray, rng: np.random.Generator) -> FloatArray:
        places = np.flatnonzero(np.isfinite(depth_mm))
        count = number if isinstance(number, int) else int(number * places.size / width)
        wild_mm = rng.uniform(low_mm, high_mm, count)
        first = rng.choice(places, count, replace=False)
        pixel = first % depth_mm.shape[1]
        for beside in range(width):
            inside = pixel + beside < depth_mm.shape[1]
            at = first[inside] + beside
            depth_mm.flat[at] = np.where(np.isfinite(depth_mm.flat[at]), wild_mm[inside], np.nan)
        return depth_mm

    return change


def shaken(sigma_mm: float, period: float) -> Changed:
    """A sensor that trembles in depth, once in so many profiles."""

    def change(depth_mm: FloatArray, rng: np.random.Generator) -> FloatArray:
        phase = 2.0 * np.pi * (np.arange(len(depth_mm)) / period + rng.random())
        return depth_mm + sigma_mm * np.sqrt(2.0) * np.sin(phase)[:, None]

    return change


def jerked(sigma_mm: float) -> Changed:
    """Each profile moved in depth by itself."""
    return lambda depth_mm, rng: depth_mm + sigma_mm * rng.normal(size=(len(depth_mm), 1))


def rounded(step_mm: float) -> Changed:
    return lambda depth_mm, _: np.round(depth_mm / step_mm) * step_mm


CASES: dict[str, Changed] = {
    "as measured": lambda depth_mm, _: depth_mm,
    "mean of 3 pixels": smoothed(np.nanmean, 3),
    "mean of 5": smoothed(np.nanmean, 5),
    "mean of 7": smoothed(np.nanmean, 7),
    "median of 3 pixels": smoothed(np.nanmedian, 3),
    "median of 5": smoothed(np.nanmedian, 5),
    "median of 11": smoothed(np.nanmedian, 11),
    "20 wild points, far off": wild(20, 5e3, 1e5),
    "20 wild points, behind the sensor": wild(20, -1e4, -100.0),
    "1 % of the points anywhere": wild(0.01, *OUTLIERS_MM),
    "5 % of the points anywhere": wild(0.05, *OUTLIERS_MM),
    "15 % of the points anywhere": wild(0.15, *OUTLIERS_MM),
    "30 % of the points anywhere": wild(0.3, *OUTLIERS_MM),
    "10 % of them, in pairs": wild(0.1, *OUTLIERS_MM, width=2),
    "10 % of them, in threes": wild(0.1, *OUTLIERS_MM, width=3),
    "10 % of them, in fives": wild(0.1, *OUTLIERS_MM, width=5),
    "trembling by 0.3 mm": shaken(0.3, 7.0),
    "trembling by 1 mm": shaken(1.0, 7.0),
    "trembling by 1 mm, every third profile alike": shaken(1.0, 3.0),
    "swaying by 1 mm, over 40 profiles": shaken(1.0, 40.0),
    "each profile moved by 1 mm": jerked(1.0),
    "rounded to 1 mm": rounded(1.0),
    "rounded to 2 mm": rounded(2.0),
}
MARKS: dict[str, list[float]] = {
    "0, 0, 0 for no return": [0.0, 0.0, 0.0],
    "-9999 three times for no return": [-9999.0] * 3,
    "Z of 99999 for no return": [0.0, 0.0, 99999.0],
}


def with_depths(change: Changed, scan: Scan, rng: np.random.Generator) -> Scan:
    """The scan with other depths, its points moved along their beams."""
    depth_mm = scan.points_mm[..., 2] - APEX_MM
    factor = change(depth_mm.copy(), rng) / depth_mm
    points_mm = scan.points_mm.copy()
    points_mm[..., 1] *= factor
    points_mm[..., 2] = depth_mm * factor + APEX_MM
    return replace(scan, points_mm=points_mm)


def with_marks(mark: list[float], scan: Scan, _: np.random.Generator) -> Scan:
    return replace(scan, points_mm=np.where(scan.valid[..., None], scan.points_mm, mark))


if __name__ == "__main__":
    count_outcomes(
        __doc__,
        20107,
        "depths",
        {case: partial(with_depths, change) for case, change in CASES.items()}
        | {case: partial(with_marks, mark) for case, mark in MARKS.items()},
    )
