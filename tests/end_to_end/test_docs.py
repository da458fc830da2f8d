"""Every command that the README and docs/ print is run here, and their pages hang together.

Whole experiments are shortened: fewer profiles and repeats, one method, no figures. Commands on
other configs than desk.yaml are read and checked whole here, and run by the tests of the configs.
"""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import yaml

from experiments.arguments import make_parser
from experiments.at_once import RUNS
from experiments.chapters import KIND as CHAPTERS
from experiments.chapters import load_chapters
from experiments.cli import main
from harness.config.reading import experiment_kind, load_experiment
from harness.execution import perform
from harness.session import open_session
from harness.store import load
from scenes.separated_planes import SeparatedPlanesParams, separated_planes
from sensors import SENSORS, threedx
from sensors.jupiter import Jupiter, JupiterParams
from sensors.paths import aimed_view, straight_line

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMAND = re.compile(r"^    ((?:\.venv/bin/)?(?:run-experiment|python|make) .+)$", re.MULTILINE)
DESK = "configs/desk.yaml"
SHORT = [
    "--set", "scan.profiles=24", "--set", "repeats=1",
    "--set", "methods=[{name: gauss_sphere, figures: false}]",
]  # fmt: skip


def commands() -> list[str]:
    """Every command of the pages, once, without what is noted beside it."""
    found = [
        " ".join(shlex.split(line, comments=True))
        for page in PAGES
        for line in COMMAND.findall(page.read_text(encoding="utf-8"))
    ]
    return list(dict.fromkeys(text.removeprefix(".venv/bin/") for text in found))


EXPERIMENTS = [
    shlex.split(line, comments=True)[1:]
    for page in PAGES
    for line in COMMAND.findall(page.read_text(encoding="utf-8"))
    if "run-experiment " in line
]
OF_DESK = [words for words in EXPERIMENTS if DESK in words]
OTHERS = [words for words in EXPERIMENTS if words[0].startswith("configs/") and DESK not in words]
BARE = [words for words in EXPERIMENTS if words[0] in ("--list", "--show-scene")]
REGISTERED = [words for words in EXPERIMENTS if words[0] == "--register"]
COMPARED = [words for words in EXPERIMENTS if words[0] == "--compare"]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder to run in, with the configs, two scans and a calibration."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "configs").symlink_to(ROOT / "configs")
    shutil.copy(ROOT / "configs" / "calibration" / "jupiter.json", folder / "calibration.json")
    sensor, scene = Jupiter(JupiterParams()), separated_planes(SeparatedPlanesParams())
    for name, yaw_rad in (("first_view", 0.14), ("second_view", -0.14)):
        path = straight_line(aimed_view([0, 0, 0], 700.0, yaw_rad, 0.1, 0.0, 40, 5.0), 40, 5.0)
        scan = sensor.scan(scene, path, np.random.default_rng(2))
        threedx.write(folder / f"{name}.3dx", threedx.from_scan(scan))
        there = np.argwhere(scan.valid)
        lines = [f"{p},{u},{','.join(f'{v:.3f}' for v in scan.points_mm[p, u])}" for p, u in there]
        header = "profile,pixel,x_mm,y_mm,z_mm"
        (folder / f"{name}.csv").write_text("\n".join([header, *lines, ""]), encoding="utf-8")
    return folder


def test_the_sensor_of_the_docs_scans_and_its_pairs_are_registered(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)
    config = tmp_path / "fan.yaml"
    config.write_text(
        "title: Desk by a fan of rays\nscene: {name: desk}\nsensor: {name: fan}\n"
        "scan: {profiles: 50, step_mm: 6.0}\n"
        "views:\n  left: {aim_mm: [0, 0, 0], distance_mm: 900, yaw_deg: -10, pitch_deg: 12}\n"
        "  right: {aim_mm: [0, 0, 0], distance_mm: 900, yaw_deg: 10, pitch_deg: 12}\n"
        "pairs:\n  a: {source: left, target: right}\n"
        "methods:\n  - {name: gauss_sphere, figures: false}\n",
        encoding="utf-8",
    )
    known = dict(SENSORS)
    try:
        # As a module of its own would be: dataclasses look their module up.
        module = types.ModuleType("fan_of_the_docs")
        sys.modules[module.__name__] = module
        exec(compile(code, "extending.md", "exec", dont_inherit=True), module.__dict__)
        (trial,) = open_session(config, None).trials
        row = perform(trial).row  # here: a process of its own would not know the sensor
    finally:
        SENSORS.clear()
        SENSORS.update(known)
        sys.modules.pop("fan_of_the_docs", None)
    assert row.status == "ok", row.reason
    assert row.rotation_error_deg < 0.5
    assert row.translation_error_mm < 5.0
    assert 0.3 < row.overlap_source <= 1.0


def test_every_command_is_covered_here() -> None:
    covered = [*OF_DESK, *OTHERS, *BARE, *REGISTERED, *COMPARED]
    assert all(words in covered for words in EXPERIMENTS)
    assert OF_DESK
    assert REGISTERED
    assert COMPARED
    made = [text.split()[1] for text in commands() if text.startswith("make ")]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in made)
    scripts = [text.split()[1] for text in commands() if text.startswith("python ")]
    assert all((ROOT / script).is_file() for script in scripts)


def test_commands_on_the_desk(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    # A whole run first, so that there is something to report on and to replay.
    for words in sorted(OF_DESK, key=lambda words: len(words) > 1):
        identity = ""
        if "--trial" in words:
            identity = str(load(place / "results" / "desk")["id"].iloc[0])
        shown = [identity if word == "ID" else word for word in words]
        assert main([*shown, *SHORT]) == 0, words
    assert (place / "results" / "desk" / "report.html").stat().st_size > 1_000_000
    assert (place / "results" / "short" / "report.html").exists()


@pytest.mark.parametrize("words", COMPARED, ids=" ".join)
def test_comparisons(words: list[str], place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    assert main([DESK, *SHORT, "--out", words[1]]) == 0
    shutil.copytree(words[1], words[2])
    assert main(words) == 0


@pytest.mark.parametrize("words", [*BARE, *REGISTERED], ids=" ".join)
def test_commands_without_a_config(
    words: list[str], place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    assert main(words) == 0
    if words[0] == "--register":
        assert (place / "results" / "first_view_second_view" / "report.html").exists()


@pytest.mark.parametrize("words", OTHERS, ids=" ".join)
def test_commands_on_other_configs_are_valid(words: list[str]) -> None:
    options = make_parser().parse_args(words)
    file = ROOT / options.config
    kind = experiment_kind(file)
    if kind == CHAPTERS:
        assert load_chapters(file, None, options.set)[1]
    elif kind not in RUNS:
        assert load_experiment(file, options.set).title


def test_the_pages_link_to_what_is_there() -> None:
    navigation = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    listed = {name for entry in navigation for name in entry.values()}
    assert listed == {page.name for page in PAGES[1:]}
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


@pytest.mark.skipif(
    importlib.util.find_spec("mkdocs") is None, reason="mkdocs-material is not here: make docs"
)
def test_the_site_is_built(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir"]
    subprocess.run([*command, str(tmp_path / "site")], cwd=ROOT, check=True, capture_output=True)
    assert (tmp_path / "site" / "index.html").exists()
