"""Read tens of thousands of damaged .3dx files: each must be read whole or refused by ThreeDxError.

    python benchmarks/fuzz_threedx.py [FILES] [SEED]

A file that is read must also be written back to the same bytes, so nothing was skipped or made up.
Exits with 1 and names the first offending file by its number and seed.
"""

from __future__ import annotations

import io
import sys
import time
import tracemalloc
from collections import Counter

import numpy as np

from sensors import threedx
from sensors.threedx_layout import ThreeDxError

INTERESTING = (0, 1, 2, 3, 127, 128, 254, 255)


def good_file(rng: np.random.Generator) -> bytes:
    """Return a valid file of either width, from one pixel to a few real profiles."""
    shape = (int(rng.integers(1, 6)), int(rng.choice([1, 2, 7, 64, 256])))
    raw = threedx.RawProfiles(
        rng.integers(-32768, 32768, shape).astype(np.int16),
        rng.integers(-32768, 32768, shape).astype(np.int16),
        rng.integers(0, 256, shape).astype(np.uint8),
        rng.integers(0, 256, shape[0]).astype(np.uint8),
        unit=int(rng.integers(0, 65536)),
        content=int(rng.integers(0, 256)),
        narrow=bool(rng.integers(2)),
    )
    return threedx.encode(raw)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a mutation: flips, header bytes, cuts, growth, splices or noise."""
    mutant = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, max(1, len(mutant))))
        match int(rng.integers(7)):
            case 0 if mutant:
                mutant[at] ^= 1 << int(rng.integers(8))
            case 1 if mutant:  # the header and the first profile's
                mutant[at % min(len(mutant), 36)] = int(rng.choice(INTERESTING))
            case 2:
                del mutant[at:]
            case 3:
                mutant += rng.bytes(int(rng.integers(1, 40)))
            case 4:
                mutant[at:at] = rng.bytes(int(rng.integers(1, 6)))
            case 5:
                del mutant[at : at + int(rng.integers(1, 6))]
            case 6:
                mutant[6:] = rng.bytes(int(rng.integers(0, 120)))
    return bytes(mutant)


def outcome(data: bytes) -> str:
    """Return "read" or "refused"; raises whatever else reading raises, or AssertionError."""
    try:
        raw = threedx.decode(io.BytesIO(data))
    except ThreeDxError:
        return "refused"
    if threedx.encode(raw) != data:
        raise AssertionError("written back, the file differs")
    return "read"


def main() -> int:
    files = int(sys.argv[1]) if len(sys.argv) > 1 else 25_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    counts: Counter[str] = Counter()
    start_s = time.perf_counter()
    tracemalloc.start()
    peak_ratio = 0.0
    for number in range(files):
        rng = np.random.default_rng([seed, number])
        data = damaged(good_file(rng), rng)
        tracemalloc.reset_peak()
        before, _ = tracemalloc.get_traced_memory()
        try:
            counts[outcome(data)] += 1
        except Exception as error:
            print(f"file {number} of seed {seed}: {type(error).__name__}: {error}")
            return 1
        peak_ratio = max(
            peak_ratio, (tracemalloc.get_traced_memory()[1] - before) / (len(data) + 30_000)
        )
    print(
        f"{files} damaged files, seed {seed}: {counts['read']} read and written back unchanged, "
        f"{counts['refused']} refused by ThreeDxError, no other exception, memory at most "
        f"{peak_ratio:.1f} times (file + 30 kB), "
        f"{time.perf_counter() - start_s:.1f} s"
    )
    return 0 if peak_ratio < 2.0 else 1


if __name__ == "__main__":
    sys.exit(main())
