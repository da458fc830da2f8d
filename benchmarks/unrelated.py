"""How often gauss_sphere calls a pose of views of different scenes sure: it should be never.

python benchmarks/unrelated.py [--pairs N] [--seed N]

Views are those of configs/random_pairs.yaml with another seed. Each is registered to views of the
other families, and each clutter to another clutter. Exits with status 1 when an answer is "ok".
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

import argparse  # noqa: E402
import sys  # noqa: E402
from collections import Counter  # noqa: E402

from missing_returns import FAMILIES, PARAMS, trials_of  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.execution import full_spec, scan_view  # noqa: E402
from registration import Scan, register  # noqa: E402
from registration.gauss_sphere.params import GaussSphereParams  # noqa: E402


def views(count: int, seed: int) -> dict[str, list[tuple[Scan, Scan]]]:
    found: dict[str, list[tuple[Scan, Scan]]] = {family: [] for family in FAMILIES}
    # Families take turns.
    for number, trial in enumerate(trials_of(count, seed)):
        spec = full_spec(trial)
        scans = scan_view(spec, spec.target), scan_view(spec, spec.source)
        found[FAMILIES[number % len(FAMILIES)]].append(scans)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=100, help="views of each family")
    parser.add_argument("--seed", type=int, default=2000)
    options = parser.parse_args()
    if options.pairs < 2:
        parser.error("--pairs: at least 2, so that no view meets its own pair")
    seen = views(options.pairs, options.seed)
    rows, wrong = [], 0
    for label, params in (
        ("calibrated", PARAMS),
        ("without calibration", GaussSphereParams()),
    ):
        for of, to in (*zip(FAMILIES, FAMILIES[1:] + FAMILIES[:1], strict=True), ("clutter",) * 2):
            statuses = Counter(
                register(target, seen[to][(i + 1) % options.pairs][1], params=params).status
                for i, (target, _) in enumerate(seen[of])
            )
            wrong += statuses["ok"]
            rows.append([label, of, to, options.pairs, statuses["ok"], dict(statuses)])
    headers = ["gauss_sphere", "target", "source", "pairs", "ok", "statuses"]
    print(tabulate(rows, headers, "github"))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
