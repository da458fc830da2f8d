"""A Dask cluster over loopback: the README's lines, a killed worker, a missing scheduler."""

from __future__ import annotations

import re
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from commanded_runs import ROOT, count_of, rows_of, run, wait_until

README = (ROOT / "README.md").read_text(encoding="utf-8")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def test_the_lines_of_the_readme_and_a_killed_worker(
    cheap: Path, tmp_path: Path, started: Callable[..., psutil.Popen]
) -> None:
    (tmp_path / "configs").mkdir()
    cheap.rename(tmp_path / "configs" / "desk.yaml")
    port = str(free_port())
    (lines,) = re.findall(r"^```sh\n(.*?)^```$", README, flags=re.DOTALL | re.MULTILINE)
    script = lines.replace("8786", port).replace(".venv/bin", str(Path(sys.executable).parent))
    assert len(script.splitlines()) == 3
    out = tmp_path / "results" / "desk"
    process = started(["bash", "-c", script], cwd=tmp_path)
    wait_until(lambda: count_of(out) >= 5, 120.0)
    below = psutil.Process(process.pid).children(recursive=True)
    # A worker of Dask by its place above the fork server of its trials; its nanny starts another.
    told_by = {p.pid: " ".join(p.cmdline()) for p in below if p.is_running()}
    # The shell itself has become the run, its last line; it is not below itself.
    above = {p.pid: told_by.get(p.ppid(), "run-experiment") for p in below}
    dask = {
        p.ppid()
        for p in below
        if "forkserver" in told_by[p.pid]
        and not any(word in above[p.pid] for word in ("forkserver", "run-experiment"))
    }
    assert len(dask) == 2
    psutil.Process(min(dask)).kill()
    wait_until(lambda: count_of(out) == 60, 120.0)
    told = ""
    for line in process.stdout:
        told += line
        if "trials computed" in line:
            break
    assert "60 trials computed, 0 reused; 60 of 60 answered, 0 errors" in told, told
    alone = run(tmp_path / "configs" / "desk.yaml", tmp_path / "alone")
    assert alone.returncode == 0
    assert rows_of(out) == rows_of(tmp_path / "alone")


def test_a_scheduler_that_is_not_there_is_told_in_a_line(
    cheap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.workers.cluster.WAIT_S", 1.0)
    from harness.workers.cluster import ClusterError, cluster_pool

    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ClusterError, match=f"no scheduler answers at {address}") as caught:
        cluster_pool(address)
    assert "\n" not in str(caught.value)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"pip install -c constraints.txt -e '.\[cluster\]'"):
        cluster_pool(address)


def test_a_batch_that_the_other_side_cannot_read_is_told_in_a_line() -> None:
    from harness.workers.cluster import OtherCodeError, is_loss

    lacking = RuntimeError(
        "Error during deserialization of the task graph. This frequently\noccurs"
    )
    lacking.__cause__ = AttributeError(
        "Can't get attribute 'Task' on <module 'harness.workers.child'>"
    )
    for error in (lacking, ModuleNotFoundError("No module named 'harness'")):
        with pytest.raises(OtherCodeError, match="start them anew") as caught:
            is_loss(error)
        assert "\n" not in str(caught.value)
    assert not is_loss(ValueError("a bug"))
