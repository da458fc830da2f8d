from __future__ import annotations

import subprocess
import sys

import pytest

from harness.config import schema
from harness.workers import fork_server
from sensors import paths


def loaded(module: str, *heavy: str) -> set[str]:
    """Those of some libraries that are loaded once a module is, in a process of its own."""
    code = f"import sys, {module}; print(*sys.modules)"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    return set(heavy) & set(answer.stdout.split())


@pytest.mark.parametrize("module", ["harness.config.reading", "harness.workers.fork_server"])
def test_the_server_is_started_before_anything_heavy_is_imported(module: str) -> None:
    heavy = ("numpy", "scipy", "numba", "mujoco", "pandas", "matplotlib", "trimesh", "rich")
    assert loaded(module, *heavy) == set()


@pytest.mark.parametrize("module", fork_server.TRIALS)
def test_workers_for_trials_alone_do_without_what_draws(module: str) -> None:
    assert loaded(module, "pandas", "matplotlib", "trimesh", "rich", "mujoco") == {"mujoco"}


def test_workers_that_draw_have_all_they_need() -> None:
    modules = ", ".join([*fork_server.TRIALS, *fork_server.DRAWING])
    assert loaded(modules, "matplotlib", "trimesh") == {"matplotlib", "trimesh"}


def test_a_file_names_the_lines_and_directions_that_sensors_know() -> None:
    assert (schema.Line, schema.Direction) == (paths.Line, paths.Direction)
