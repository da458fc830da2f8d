from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.commands import tell_long_check
from experiments.discussion import TrialError
from harness.config.reading import load_experiment

ROOT = Path(__file__).parents[2]
DESK = str(ROOT / "configs" / "desk.yaml")


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, where a results folder would show."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ([DESK, "--set", "scan.profils=40"], ["scan.profils", "'profiles'"]),
        ([DESK, "--set", "scan.step_mm=-1"], ["scan.step_mm", "greater than 0", "-1"]),
        ([DESK, "--set", "scene.name=dsk"], ["scene.name", "'dsk'", "'desk'"]),
        ([DESK, "--set", "methods.0.name=thesi"], ["methods.0.name", "'thesis'"]),
        ([DESK, "--set", "repeats"], ["--set", "key=value"]),
        ([DESK[:-5] + ".yml"], ["no such file", "'desk'"]),
        ([str(ROOT)], ["is a directory"]),
        ([], ["CONFIG", "--list"]),
        ([DESK, "--report-only"], ["trials.sqlite does not exist", "run the experiment first"]),
        ([DESK, "--trial", "zz"], ["--trial", "'zz' is no trial of this config"]),
        ([DESK, "--out", DESK], ["desk.yaml cannot be a results folder", "--out"]),
        (["--show-scene", "dsk"], ["unknown scene 'dsk'", "'desk'"]),
        (["--show-scene", "desk", "--set", "a=1"], ["--set: says nothing", "without a CONFIG"]),
        (["--show-scene", "desk", "--seed", "1"], ["--seed: says nothing", "without a CONFIG"]),
        (["--show-scene", "desk", DESK, "--workers", "2"], ["--workers: says nothing to --show"]),
        (["--list", DESK], ["CONFIG: says nothing to --list"]),
        (["--list", "--set", "a=1"], ["--set: says nothing to --list"]),
        ([DESK, "--dry-run", "--scheduler", "tcp://a:1"], ["--scheduler: says nothing to --dry"]),
        ([DESK, "--trial", "ab", "--scheduler", "tcp://a:1"], ["--scheduler: says nothing"]),
        ([DESK, "--export", "a.csv", "--scheduler", "tcp://a:1"], ["--scheduler: says nothing"]),
        (
            [str(ROOT / "configs" / "precision.yaml"), "--workers", "2"],
            ["--workers: says nothing to", "runs in one process"],
        ),
        (["--show-scene", "clutter", DESK], ["has scene 'desk', not 'clutter'"]),
    ],
)
def test_a_wrong_request_gets_one_line_and_writes_nothing(
    arguments: list[str],
    parts: list[str],
    elsewhere: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("run-experiment: ")
    assert shown.err.count("\n") == 1
    assert all(part in shown.err for part in parts), shown.err
    assert list(elsewhere.iterdir()) == []


@pytest.mark.parametrize(
    "request_words",
    [
        ["--compare", "before", "after"],
        ["--show-scene", "desk"],
        [str(ROOT / "configs" / "precision.yaml")],
        [str(ROOT / "configs" / "foam_2d.yaml")],
        [str(ROOT / "configs" / "thesis.yaml")],
    ],
)
def test_a_results_folder_that_cannot_be_made_is_told_before_anything_is_computed(
    request_words: list[str],
    elsewhere: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def computing(*_: object) -> None:
        raise AssertionError("nothing should be computed")

    for name in ("precision.measure", "profile_pairs.measure", "run_chapters._run_part"):
        monkeypatch.setattr(f"experiments.{name}", computing)
    (elsewhere / "taken").touch()
    (elsewhere / "link").symlink_to("nowhere")
    for out, why in (
        ("taken", "taken is a file"),
        ("taken/below", "taken is a file"),
        ("link", "link is a link that leads nowhere"),
        ("a" * 300, "File name too long"),
    ):
        assert main([*request_words, "--out", out]) == 2
        told = capsys.readouterr().err
        assert told.startswith(f"run-experiment: --out: {out} cannot be a results folder: ")
        assert told.endswith(f"{why}; give another\n")


@pytest.mark.parametrize(
    ("step", "request_words"),
    [
        ("experiments.compare_runs.load", ["--compare", "before", "after"]),
        ("scenes.picture.save_picture", ["--show-scene", "desk"]),
        ("experiments.precision.measure", [str(ROOT / "configs" / "precision.yaml")]),
        ("experiments.run_chapters._run_part", [str(ROOT / "configs" / "thesis.yaml")]),
    ],
)
def test_a_full_disk_gets_one_line(
    step: str,
    request_words: list[str],
    elsewhere: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "some.file")

    monkeypatch.setattr(step, full)
    assert main(request_words) == 2
    told = capsys.readouterr().err
    assert told.startswith("run-experiment: some.file cannot be written (No space left on device)")
    assert told.count("\n") == 1


def test_a_duplicate_key_gets_one_line(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = elsewhere / "twice.yaml"
    file.write_text(Path(DESK).read_text(encoding="utf-8") + "seed: 1\n", encoding="utf-8")
    assert main([str(file)]) == 2
    assert "'seed' is written twice" in capsys.readouterr().err
    assert list(elsewhere.iterdir()) == [file]


@pytest.mark.parametrize(
    "arguments", [[DESK, "--workers", "0"], [DESK, "--seed", "-1"], [DESK, "--sed", "1"]]
)
def test_argparse_refuses_with_status_2(arguments: list[str], elsewhere: Path) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert list(elsewhere.iterdir()) == []


def test_list_names_every_config_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [Path(line.split()[0]).name for line in lines] == [
        file.name for file in sorted((ROOT / "configs").glob("*.yaml"))
    ]
    assert all(len(line.split()) > 3 for line in lines)


def test_help_needs_no_heavy_import() -> None:
    script = (
        "import sys\nfrom experiments.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "print(sorted({'numpy', 'pandas', 'mujoco', 'pydantic'} & set(sys.modules)))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert answer.stdout.splitlines()[-1] == "[]"
    assert "--report-only" in answer.stdout


def test_a_dry_run_counts_and_writes_nothing(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--set", "scan.profiles=30", "--set", "methods=[{name: thesis}]"]
    assert main([DESK, "--dry-run", "--set", "repeats=4", *options]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "8 trials" in told
    assert "8 different trials at " in told
    assert ", 8 pairs of scans at " in told  # one method: none are shared
    assert list(elsewhere.iterdir()) == []


def test_show_scene_saves_a_picture(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--show-scene", "flat_target"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert (elsewhere / line).read_bytes().startswith(b"\x89PNG")


def test_show_scene_takes_the_seed(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def opened(*request: object) -> None:
        asked.extend(request)
        raise KeyboardInterrupt

    monkeypatch.setattr("experiments.commands.open_session", opened)
    main(["--show-scene", "desk", DESK, "--seed", "9"])
    assert asked[-1] == 9


def test_an_interrupt_outside_of_the_trials_gets_one_line_too(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("harness.session.open_session", interrupted)
    request = [DESK, "--seed", "4"]
    assert main([*request, "--dry-run"]) == 130
    told = capsys.readouterr().err.strip()
    assert told.count("\n") == 0
    assert told.endswith(f"To go on: run-experiment {request[0]} --seed 4 --dry-run")


def test_an_interrupt_leaves_the_fork_server_at_work() -> None:
    program = """
import os, signal
from multiprocessing import forkserver
from harness.workers.pool import process_pool
signal.signal(signal.SIGINT, signal.SIG_IGN)
if __name__ == "__main__":
    make = process_pool(1)
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGINT)  # it is importing
    with make() as executor:
        print(executor.submit(abs, -3).result())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == ("3", "")


@pytest.mark.parametrize(
    ("design", "samples", "told"),
    [
        ("latin_hypercube", 99, ""),
        ("latin_hypercube", 20_000, "Checking all 20000 points first\n"),
        ("saltelli", 2**19, ""),  # over a million points: they are refused, which takes no time
    ],
)
def test_a_check_that_takes_long_is_announced(
    design: str, samples: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    over = "{scan.step_mm: {distribution: uniform, from: 4, to: 6}}"
    sweep = f"sweep={{design: {design}, samples: {samples}, over: {over}}}"
    tell_long_check(load_experiment(Path(DESK), [sweep]))
    assert capsys.readouterr().out == told


def test_trials_that_failed_in_the_discussion_are_told_without_a_traceback_of_the_command(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise TrialError("2 trials failed, ab12 first:\nof the trial")

    monkeypatch.setattr("experiments.discussion.load_discussion", failing)
    assert main([str(ROOT / "configs" / "discussion.yaml")]) == 1
    told = capsys.readouterr().err
    assert told == "run-experiment: 2 trials failed, ab12 first:\nof the trial\n"
