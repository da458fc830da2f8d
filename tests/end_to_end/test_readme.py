"""What the README says is so: its code runs, its tables list what there is."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import yaml

from experiments.arguments import make_parser
from harness.config.reading import load_experiment, read_mapping
from harness.config.sweep_schema import Design
from harness.execution import perform
from harness.scoring import exact_pose, pose_error
from harness.session import open_session
from harness.trials.specs import build_trials
from registration import GaussSphereParams, Scan, register
from registration.calibration import read_calibration
from scenes import SCENES
from scenes.separated_planes import SeparatedPlanesParams, separated_planes
from sensors.jupiter import Jupiter, JupiterParams
from sensors.paths import ViewPath, aimed_view, straight_line
from sensors.target_scans import scan_target

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")

PLATES = """\
title: Plates seen twice
scene: {name: separated_planes}
sensor: {name: jupiter}
scan: {profiles: 40, step_mm: 5.0}
views:
  left: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: -8, pitch_deg: 5}
  right: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: 8, pitch_deg: 5}
pairs:
  plates: {source: left, target: right}
"""


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.DOTALL | re.MULTILINE)


def block(language: str, word: str) -> str:
    (found,) = (text for text in blocks(language) if word in text)
    return found


def run(code: str) -> dict[str, Any]:
    """Run a block as its reader would, without the __future__ imports of this file."""
    names: dict[str, Any] = {"__name__": "builtins"}
    exec(compile(code, "README.md", "exec", dont_inherit=True), names)
    return names


def view(yaw_deg: float) -> ViewPath:
    start = aimed_view([0, 0, 0], 700.0, np.deg2rad(yaw_deg), np.deg2rad(5.0), 0.0, 40, 5.0)
    return straight_line(start, 40, 5.0)


def test_every_python_block_is_run_here() -> None:
    words = ("first_view.npy", "fit_calibration", "cautious.py", "ShelfParams", "SLURMCluster")
    assert sorted(blocks("python")) == sorted(block("python", word) for word in words)


def test_two_scans_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sensor, scene = Jupiter(JupiterParams()), separated_planes(SeparatedPlanesParams())
    paths = view(8.0), view(-8.0)
    for name, path in zip(("first_view", "second_view"), paths, strict=True):
        np.save(tmp_path / f"{name}.npy", sensor.hits(scene, path).points_mm)
    monkeypatch.chdir(tmp_path)
    code = block("python", "first_view.npy")
    assert len(code.splitlines()) <= 10
    names = run(code)
    result = names["result"]
    assert isinstance(names["target"], Scan)
    assert result.status == "ok", result.reason
    error = pose_error(exact_pose(*paths), result.T_target_source)
    assert np.rad2deg(error.rotation_rad) < 0.02
    assert error.translation_mm < 1.0
    assert "ok [[" in capsys.readouterr().out


def test_a_calibration_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sensor, rng = Jupiter(JupiterParams()), np.random.default_rng(5)
    for name, turn_deg, depth_mm in (
        ("near", 0.0, 300.0), ("middle", 0.0, 700.0), ("far", 0.0, 1100.0), ("turned", 20.0, 700.0)
    ):  # fmt: skip
        target = scan_target(sensor, depth_mm, np.deg2rad(turn_deg), 0.0, 40, 5.0, rng)
        np.save(f"target_{name}.npy", target.scan.points_mm)
    run(block("python", "fit_calibration"))
    calibration = read_calibration("calibration.json")
    assert calibration.form == "incidence"  # what the simulated sensor has
    assert calibration.measured_by == "a board on the bench"
    # A turn taken the wrong way round would leave tens of mm, an uncorrected bulge several.
    assert calibration.rms_mm["uncorrected"] < 6.0
    assert calibration.rms_mm["incidence"] < 0.6 * calibration.rms_mm["uncorrected"]


def test_a_calibration_goes_to_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "configs" / "calibration" / "jupiter.json", "calibration.json")
    (call,) = re.findall(r"`(register\(.*GaussSphereParams.*?\)\))`", README)
    sensor, scene = Jupiter(JupiterParams()), separated_planes(SeparatedPlanesParams())
    target, source = (
        sensor.scan(scene, view(yaw_deg), np.random.default_rng(seed))
        for yaw_deg, seed in ((8.0, 1), (-8.0, 2))
    )
    names = {"register": register, "GaussSphereParams": GaussSphereParams}
    result = eval(call, names | {"target": target, "source": source})
    assert result.status == "ok", result.reason
    assert not result.notes


def test_a_method_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cautious.py").write_text(block("python", "cautious.py"), encoding="utf-8")
    config = tmp_path / "mine.yaml"
    config.write_text(PLATES + block("yaml", "cautious"), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)  # the command adds the folder it is started in
    (trial,) = build_trials(load_experiment(config), config)
    row = perform(trial).row
    sys.modules.pop("cautious")
    assert trial.label == "both ways"
    assert row.status == "ok", row.reason
    assert row.rotation_error_deg is not None
    assert row.rotation_error_deg < 1.0


def test_a_scene_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenes.SCENES", dict(SCENES))
    run(block("python", "ShelfParams"))
    import scenes

    entry = scenes.SCENES["shelf"]
    scene = entry.builder(entry.params_type(shelves=2))
    assert {surface.geom for surface in scene.surfaces} == {"wall", "board0", "board1", "book"}
    path = straight_line(aimed_view([50, 0, 100], 700.0, 0.0, 0.3, 0.0, 10, 5.0), 10, 5.0)
    assert Jupiter(JupiterParams()).hits(scene, path).valid.any()


def test_a_cluster_of_slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As it stands, with an sbatch that only keeps what it is given."""
    pytest.importorskip("dask_jobqueue", reason="comes with the extra `cluster`")
    sbatch = tmp_path / "sbatch"
    sbatch.write_text(f"#!/bin/sh\ncat $1 >> {tmp_path}/jobs\necho Submitted batch job 7\n")
    sbatch.chmod(0o755)
    (tmp_path / "scancel").symlink_to("/bin/true")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    jobs = tmp_path / "jobs"

    def enter(_: str) -> str:
        deadline = time.monotonic() + 60.0
        while not (jobs.exists() and jobs.read_text().count("#!/") == 4):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        return ""

    monkeypatch.setattr("builtins.input", enter)
    names = run(block("python", "SLURMCluster"))
    names["cluster"].close()
    assert "#SBATCH -p compute" in jobs.read_text()
    assert "--nworkers 16" in jobs.read_text()


def test_the_menu_is_the_configs() -> None:
    listed = re.findall(r"^\| `(configs/\S+\.yaml)` \| (.+?) \|$", README, flags=re.MULTILINE)
    configs = sorted((ROOT / "configs").glob("*.yaml"))
    assert dict(listed) == {f"configs/{p.name}": read_mapping(p)["title"] for p in configs}
    assert len(listed) == len(configs)


def test_every_option_is_in_the_readme() -> None:
    options = {name for action in make_parser()._actions for name in action.option_strings}
    listed = set(re.findall(r"^\| `(--[a-z-]+)", README, flags=re.MULTILINE))
    assert listed == {name for name in options if name.startswith("--")} - {"--help"}


def test_every_folder_and_picture_exists() -> None:
    folders = re.findall(r"^\| `([a-z/]+)/` \|", README.split("## Where things are")[1],
                         flags=re.MULTILINE)  # fmt: skip
    assert len(folders) == 10
    assert all((ROOT / folder).is_dir() for folder in folders)
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)
    assert pictures
    assert all((ROOT / picture).is_file() for picture in pictures)


def test_the_picture_is_drawn_by_the_config_it_names() -> None:
    (pair, method) = re.findall(r"results/desk/figures/([\d.]+)_(\w+)_7_superposition", README)[0]
    experiment = load_experiment(ROOT / "configs" / "desk.yaml")
    assert pair in experiment.pairs
    assert any((choice.label or choice.name) == method for choice in experiment.methods)


def test_every_yaml_block_is_run_here() -> None:
    methods, sweep = block("yaml", "cautious"), block("yaml", "sweep:")
    assert sorted(blocks("yaml")) == sorted([methods, sweep])
    assert list(yaml.safe_load(methods)) == ["methods"]


def test_a_sweep(tmp_path: Path) -> None:
    config = tmp_path / "swept.yaml"
    methods = "methods:\n  - {name: thesis}\n"
    config.write_text(PLATES + methods + block("yaml", "sweep:"), encoding="utf-8")
    trials = open_session(config, tmp_path).trials
    assert len({trial.id for trial in trials}) == 18
    assert "each of these 18 points" in README
    desk = (ROOT / "configs" / "desk.yaml").read_text(encoding="utf-8")
    config.write_text(desk + block("yaml", "sweep:"), encoding="utf-8")  # the arm reaches them all
    assert open_session(config, tmp_path).trials
    designs = re.findall(r"^\| (`[a-z_`, ]+`) \|", README.split("| design |")[1].split("\n\n")[0],
                         flags=re.MULTILINE)  # fmt: skip
    listed = re.findall(r"`(\w+)`", " ".join(designs))
    assert set(listed) == set(get_args(Design))


def test_clean_removes_results_but_those_of_reference(tmp_path: Path) -> None:
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("reference", "desk"):
        (tmp_path / "results" / name).mkdir(parents=True)
    (tmp_path / "results" / ".gitkeep").touch()
    subprocess.run(["make", "clean"], cwd=tmp_path, check=True, capture_output=True)
    assert {path.name for path in (tmp_path / "results").iterdir()} == {".gitkeep", "reference"}
