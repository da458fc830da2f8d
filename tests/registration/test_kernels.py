"""Cached kernels never outlive the sources that they were compiled from."""

from __future__ import annotations

import os
from pathlib import Path

from registration.kernels import forget_stale


def test_a_changed_source_forgets_the_kernels_of_all_others(tmp_path: Path) -> None:
    called, cache = tmp_path / "called.py", tmp_path / "part" / "__pycache__"
    cache.mkdir(parents=True)
    called.write_text("X = 1\n")
    assert forget_stale(tmp_path)
    kernel = cache / "caller.loop-1.py311.1.nbc"
    kernel.write_bytes(b"compiled")
    assert not forget_stale(tmp_path)
    assert kernel.exists()
    called.write_text("X = 2\n")
    os.utime(called, ns=(1, 1))
    assert forget_stale(tmp_path)
    assert not kernel.exists()
    assert not forget_stale(tmp_path)
