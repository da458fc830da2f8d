"""What set-up compiles: every kernel, so that nobody waits for one later."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_set_up_compiles_every_kernel() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", Path(__file__).with_name("kernels_left_out.py")],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    left_out, n_compiled = done.stdout.splitlines()
    assert left_out == ""
    assert int(n_compiled) > 100
