"""How the time of gauss_sphere grows with the number of profiles, and with that of patches.

python benchmarks/growth.py

On clutter scans with all of the sensor's effects, calibrated: profiles from 20 to 2000 over the
same line, so that the scene stays the same; then scenes of ever more solids at 200 profiles. One
core, least of five repeats.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

import time  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
from tabulate import tabulate  # noqa: E402

from registration import Scan, register  # noqa: E402
from registration.gauss_sphere.describing import describe  # noqa: E402
from registration.gauss_sphere.params import GaussSphereParams  # noqa: E402
from scenes import SCENES  # noqa: E402
from scenes.clutter import ClutterParams  # noqa: E402
from sensors.jupiter import Jupiter  # noqa: E402
from sensors.paths import aimed_view, straight_line  # noqa: E402

CALIBRATION = Path(__file__).resolve().parents[1] / "configs" / "calibration" / "jupiter.json"
PARAMS = GaussSphereParams(calibration=str(CALIBRATION))
LINE_MM, REPEATS = 400.0, 5
PROFILES = (20, 50, 100, 200, 500, 1000, 2000)
SOLIDS = (2, 5, 10, 20, 40, 80)


def scans(solids: int, profiles: int) -> tuple[Scan, Scan]:
    scene = SCENES["clutter"].builder(ClutterParams(seed=1, solids=solids, size_max_mm=120.0))
    step_mm = LINE_MM / profiles
    rng = np.random.default_rng(2)
    views = []
    for yaw_deg in (-10.0, 10.0):
        pose = aimed_view(
            [0, 0, 60], 900.0, np.deg2rad(yaw_deg), np.deg2rad(25.0), 0.0, profiles, step_mm
        )
        views.append(Jupiter().scan(scene, straight_line(pose, profiles, step_mm), rng))
    return views[0], views[1]


def row(solids: int, profiles: int) -> list[float | int | str]:
    target, source = scans(solids, profiles)
    register(target, source, params=PARAMS)
    times_ms = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        result = register(target, source, params=PARAMS)
        times_ms.append(1e3 * (time.perf_counter() - start))
    patches = [len(describe(scan, PARAMS).patches.n_points) for scan in (target, source)]
    points = target.n_valid + source.n_valid
    least_ms = min(times_ms)
    stages = [round(ms, 1) for ms in result.stage_ms.values()]
    return [
        solids, profiles, points, *patches, least_ms, 1e6 * least_ms / points, *stages,
        result.status,
    ]  # fmt: skip


def main() -> None:
    stages = list(register(*scans(5, 20), params=PARAMS).stage_ms)
    headers = ["solids", "profiles", "points", "patches target", "source", "time (ms)",
               "ns a point", *(f"{stage} (ms)" for stage in stages), "status"]  # fmt: skip
    by_profiles = [row(14, profiles) for profiles in PROFILES]
    print(tabulate(by_profiles, headers, "github", floatfmt=".1f"))
    times = np.array([float(r[5]) for r in by_profiles])
    slope = np.polyfit(np.log(PROFILES[3:]), np.log(times[3:]), 1)[0]
    print(f"\nfrom {PROFILES[3]} profiles on the time grows with the power {slope:.2f} of them\n")
    print(tabulate([row(solids, 200) for solids in SOLIDS], headers, "github", floatfmt=".1f"))


if __name__ == "__main__":
    main()
