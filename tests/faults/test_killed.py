"""What is left when processes are killed: every row that was kept, and a run that goes on."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
from commanded_runs import HERE, command, count_of, rows_of, run, wait_until, workers_of

# Most hit drivers that begin at once, at any moment of a run; some the command itself, whose worker
# processes have to end too.
QUICK_KILLS, SLOW_KILLS = 48, 2
TRIALS = 800
SOON_S = 0.6  # within which a driver is killed


def test_fifty_kills_of_the_driver_cost_nothing(
    cheap: Path, tmp_path: Path, started: Callable[..., psutil.Popen]
) -> None:
    """The rows end bit for bit as those of a run that nobody disturbed."""
    moments = random.Random(6)
    out, undisturbed = tmp_path / "killed", tmp_path / "undisturbed"
    text = cheap.read_text(encoding="utf-8")
    cheap.write_text(text.replace("s: 0.05", "s: 0.02"), encoding="utf-8")
    options = ["--set", f"repeats={TRIALS}", "--workers", "4"]
    counts = []
    template = started(
        [sys.executable, str(HERE / "killable_driver.py")], cwd=tmp_path, stdin=subprocess.PIPE
    )
    assert template.stdout.readline() == "ready\n"
    longest_s = SOON_S
    for _ in range(QUICK_KILLS):
        template.stdin.write(f"{cheap} {out} repeats={TRIALS}\n")
        template.stdin.flush()
        driver = int(template.stdout.readline())
        time.sleep(moments.uniform(0.0, longest_s))
        os.kill(driver, signal.SIGKILL)
        assert template.stdout.readline() == "gone\n"
        before = counts[-1] if counts else 0
        counts.append(count_of(out))
        # A slow machine needs longer to keep its first row: half of the kills should cost some.
        longest_s = max(longest_s * (1.2 if counts[-1] == before else 0.8), SOON_S)
    for _ in range(SLOW_KILLS):
        process = started(command(cheap, out, *options), cwd=tmp_path)
        goal = min(counts[-1] + moments.randrange(1, 40), TRIALS)
        wait_until(lambda goal=goal: count_of(out) >= goal)
        below = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGKILL)
        process.wait()
        # Nothing of it goes on in secret, not even in the middle of a trial.
        _, alive = psutil.wait_procs(below, timeout=60.0)
        assert not alive
        counts.append(count_of(out))
    assert counts == sorted(counts)
    assert len({count for count in counts if 0 < count < TRIALS}) > 10, counts
    last = run(cheap, out, *options)
    assert last.returncode == 0, last.stderr
    assert f"{counts[-1]} reused" in last.stdout
    assert run(cheap, undisturbed, *options).returncode == 0
    assert rows_of(out) == rows_of(undisturbed)
    assert len(rows_of(out)) == TRIALS


def test_a_killed_worker_costs_no_row(
    cheap: Path, tmp_path: Path, started: Callable[..., psutil.Popen]
) -> None:
    out = tmp_path / "out"
    process = started(command(cheap, out, "--workers", "2"), cwd=tmp_path)
    for least in (5, 20):
        wait_until(lambda least=least: count_of(out) >= least)
        wait_until(lambda: workers_of(process.pid))
        os.kill(workers_of(process.pid)[0].pid, signal.SIGKILL)
    told, _ = process.communicate(timeout=120)
    assert process.returncode == 0, told
    assert "60 trials computed, 0 reused; 60 of 60 answered, 0 errors" in told
    assert run(cheap, tmp_path / "undisturbed").returncode == 0
    assert rows_of(out) == rows_of(tmp_path / "undisturbed")


def test_bad_trials_cost_themselves_alone(cheap: Path, tmp_path: Path) -> None:
    """One raises, one never ends, one wants too much memory, one kills its process."""
    names = ("slow", "crash", "endless", "greedy", "suicide")
    methods = ", ".join(f"{{name: 'slow_methods:{name}', label: {name}}}" for name in names)
    options = ["--set", f"methods=[{methods}]", "--set", "repeats=2", "--workers", "2",
               "--set", "limits={trial_s: 2.0, worker_mb: 300}"]  # fmt: skip
    done = run(cheap, tmp_path / "out", *options)
    assert done.returncode == 1, done.stderr
    assert "10 trials computed, 0 reused; 2 of 10 answered, 8 errors" in done.stdout
    reasons = {row[3] for row in rows_of(tmp_path / "out")}
    assert len(reasons) == 5
    assert {"", "ZeroDivisionError: a bug", "did not end within 2 s and was killed"} < reasons
    assert any(reason.startswith("MemoryError") or "Unable to allocate" in reason
               for reason in reasons)  # fmt: skip
    assert any(reason.startswith("its process died twice (signal 9)") for reason in reasons)
    assert "Traceback" not in done.stderr
    # Errors are tried again, and what was right is not.
    again = run(cheap, tmp_path / "out", *options)
    assert "8 trials computed, 2 reused" in again.stdout


def test_the_second_run_on_a_folder_is_refused(
    cheap: Path, tmp_path: Path, started: Callable[..., psutil.Popen]
) -> None:
    out = tmp_path / "out"
    first = started(command(cheap, out, "--set", "repeats=2000"), cwd=tmp_path)
    wait_until(lambda: count_of(out) >= 1)
    second = run(cheap, out)
    assert second.returncode == 2
    assert second.stderr.count("\n") == 1
    assert f"is in use by process {first.pid}" in second.stderr
    assert first.poll() is None
    first.send_signal(signal.SIGINT)
    told, _ = first.communicate(timeout=120)
    assert first.returncode == 130
    assert "Interrupted: " in told
    assert "To go on: run-experiment" in told
    assert run(cheap, out).returncode == 0
