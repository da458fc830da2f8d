"""How long a new process waits for `import registration`, and for its first answer.

python benchmarks/first_call.py [--runs N]

Each run is a process of its own, in which numpy is imported before, to make the points. Kernels are
compiled at set-up: one run before the others, which is not counted, compiles what is missing.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

import numpy as np
from tabulate import tabulate

# As a user's own script begins.
SCRIPT = """
from time import perf_counter
import numpy as np
x, y = np.meshgrid(np.arange(40) * 10.0, np.linspace(-200.0, 200.0, 256), indexing="ij")
z = 800.0 - np.where(x > 200.0, 1.5 * (x - 200.0), 0.0)
z = np.where((abs(y - 80.0) < 60.0) & (abs(x - 90.0) < 60.0), 700.0 + 0.3 * y, z)
points = np.stack([x, y * z / 800.0, z], axis=2)
started = perf_counter()
from registration import Scan, register
imported = perf_counter()
scan = Scan.from_points(points, step_mm=10.0)
made = perf_counter()
status = register(scan, scan).status
first = perf_counter()
assert status == "ok", status
again = perf_counter()
register(scan, scan)
print(imported - started, first - made, perf_counter() - again)
"""


def times_s() -> list[float]:
    """Seconds of import, first call and second call in a process of its own."""
    run = subprocess.run([sys.executable, "-c", SCRIPT], check=True, capture_output=True, text=True)
    return [float(word) for word in run.stdout.split()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=7)
    options = parser.parse_args()
    times_s()  # compiles what is not in the cache, and has the files in memory
    runs = np.array([times_s() for _ in range(options.runs)])
    names = ("import registration", "first call of register", "second call")
    rows = [
        [name, np.median(seconds), seconds.min(), seconds.max()]
        for name, seconds in zip(names, runs.T, strict=True)
    ]
    print(tabulate(rows, ["", "median (s)", "least (s)", "most (s)"], "github", floatfmt=".3f"))


if __name__ == "__main__":
    main()
