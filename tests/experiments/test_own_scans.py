from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import RigidTransform

from experiments.cli import main
from harness.scoring import pose_error
from registration.calibration import Calibration, Table
from registration.scan import Scan
from scenes import SCENES
from sensors import threedx
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import NoiseParams
from sensors.paths import aimed_view, straight_line, travel_of


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, RigidTransform]:
    """Two noise-free views of three plates as .3dx files, and the exact T_target_source."""
    folder = tmp_path_factory.mktemp("own")
    scene = SCENES["separated_planes"].builder(SCENES["separated_planes"].params_type())
    sensor = Jupiter(JupiterParams(noise=NoiseParams.exact()))
    paths = [
        straight_line(aimed_view([0, 0, 0], 800, np.deg2rad(yaw), 0.1, 0.0, 70, 5.0), 70, 5.0)
        for yaw in (-9.0, 8.0)
    ]
    for name, path in zip(("target", "source"), paths, strict=True):
        scan = sensor.scan(scene, path, np.random.default_rng(0))
        threedx.write(folder / f"{name}.3dx", threedx.from_scan(scan))
    T_target_source = paths[0].T_world_view.inv() * paths[1].T_world_view
    return folder / "target.3dx", folder / "source.3dx", T_target_source


def test_files_of_a_jupiter_are_registered(
    files: tuple[Path, Path, RigidTransform], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target, source, T_exact = files
    out = tmp_path / "out"
    assert main(["--register", str(target), str(source), "--step", "5", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "Status: ok" in shown
    assert "Standard deviations" in shown
    assert "Note: no calibration was given" in shown
    answer = json.loads((out / "registration.json").read_text(encoding="utf-8"))
    assert answer["notes"][0].startswith("no calibration was given")
    T_found = RigidTransform.from_matrix(answer["T_target_source"])
    error = pose_error(T_exact, T_found)
    assert np.rad2deg(error.rotation_rad) < 0.05
    assert error.translation_mm < 0.5
    assert f"{T_found.translation[1]:.3f}" in shown
    page = (out / "report.html").read_text(encoding="utf-8")
    assert (
        "source.3dx was registered to target.3dx by gauss_sphere: ok. Note: no calibration" in page
    )
    record = json.loads(gzip.decompress((out / "pairs" / "trial_own.json.gz").read_bytes()))
    assert record["poses"] == {"estimate": answer["T_target_source"], "exact": None}
    assert record["error"] is record["overlap"] is None
    clouds = [threedx.to_scan(threedx.read(file), 5.0) for file in (target, source)]
    merged = trimesh.load(out / "merged.ply")
    assert len(merged.vertices) == sum(cloud.n_valid for cloud in clouds)
    moved = T_found.apply(clouds[1].points_mm[clouds[1].valid])
    np.testing.assert_allclose(merged.vertices[-len(moved) :], moved, atol=1e-3)


def test_files_of_a_sensor_that_moved_along_the_vertical_are_registered(tmp_path: Path) -> None:
    scene = SCENES["separated_planes"].builder(SCENES["separated_planes"].params_type())
    sensor = Jupiter(JupiterParams(noise=NoiseParams.exact()))
    files, poses = [], []
    for name, yaw in (("target", -9.0), ("source", 8.0)):
        view = aimed_view([0, 0, 0], 800, np.deg2rad(yaw), 0.2, 0.0, 70, 5.0, "vertical", "down")
        path = straight_line(view, 70, 5.0, travel_of(view, "vertical", "down"))
        scan = sensor.scan(scene, path, np.random.default_rng(0))
        files.append(str(tmp_path / f"{name}.3dx"))
        threedx.write(files[-1], threedx.from_scan(scan))
        poses.append(view)
    # Both views are pitched alike and not rolled, so they moved alike.
    motion = ["--step", "5", "--travel", *(repr(value) for value in scan.travel.tolist())]
    out = tmp_path / "out"
    assert main(["--register", *files, *motion, "--out", str(out)]) == 0
    answer = json.loads((out / "registration.json").read_text(encoding="utf-8"))
    T_found = RigidTransform.from_matrix(answer["T_target_source"])
    error = pose_error(poses[0].inv() * poses[1], T_found)
    assert np.rad2deg(error.rotation_rad) < 0.05
    assert error.translation_mm < 0.5


def test_a_calibration_changes_the_estimate(
    files: tuple[Path, Path, RigidTransform], tmp_path: Path
) -> None:
    target, source, _ = files
    bias = Table(
        np.array([200.0, 1500.0]), np.array([0.0, 3.0]), np.array([[-40.0, 0.0], [-40.0, 0.0]])
    )
    sigma = Table(np.array([200.0, 1500.0]), np.array([0.0, 3.0]), np.ones((2, 2)))
    Calibration("incidence", np.array([0.0, 0.0, -65.0]), bias, sigma).write(tmp_path / "c.json")
    poses = []
    for name, extra in (("a", []), ("b", ["--calibration", str(tmp_path / "c.json")])):
        out = ["--out", str(tmp_path / name)]
        assert main(["--register", str(target), str(source), "--step", "5", *extra, *out]) in (0, 1)
        answer = json.loads((tmp_path / name / "registration.json").read_text(encoding="utf-8"))
        poses.append(RigidTransform.from_matrix(answer["T_target_source"]))
    assert answer["calibration"] == str(tmp_path / "c.json")
    assert pose_error(*poses).translation_mm > 0.5


def test_a_results_folder_that_cannot_be_is_told_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("", encoding="utf-8")
    for out in (tmp_path / "taken", tmp_path / "taken" / "below"):
        assert main(["--register", "absent.3dx", "absent.3dx", "--out", str(out)]) == 2
        told = capsys.readouterr().err
        assert told.endswith("taken is a file; give another\n")
        assert told.startswith("run-experiment: --out: ")


def test_scans_that_cannot_be_registered_say_why_and_write_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = Scan.from_points(np.full((5, 8, 3), np.nan), 5.0)
    np.savez(tmp_path / "empty.npz", points_mm=empty.points_mm, step_mm=5.0)
    file, out = str(tmp_path / "empty.npz"), tmp_path / "out"
    assert main(["--register", file, file, "--out", str(out)]) == 1
    assert capsys.readouterr().out.startswith("Status: failed: ")
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--register", "a.3dx", "b.3dx", "--step", "5"], "a.3dx: No such file"),
        (["--register", "TARGET", "SOURCE"], "--step"),
        (["--register", "TARGET", "SOURCE", "--step", "5", "--method", "thsis"], "'thsis'"),
        (["--register", "TARGET", "SOURCE", "--step", "5", "--seed", "3"], "--seed: says nothing"),
        (["--register", "TARGET", "SOURCE", "--step", "5", "--out", "TARGET"], "--out: "),
        (["--register", ".", "SOURCE", "--step", "5"], "is a folder; known are files .3dx, .npz"),
        (
            ["--register", "TARGET", "SOURCE", "--step", "5", "--calibration", "none.json"],
            "--calibration: none.json: No such file or directory; configs/precision.yaml",
        ),
        (
            ["--register", "TARGET", "SOURCE", "--step", "5", "--calibration", "TARGET"],
            "target.3dx: is not JSON",
        ),
        (
            ["--register", "TARGET", "SOURCE", "--method", "thesis", "--calibration", "none.json"],
            "--calibration: method 'thesis' takes none; gauss_sphere does",
        ),
        (["configs/desk.yaml", "--step", "5"], "--step: belongs to --register"),
        (["configs/desk.yaml", "--calibration", "c.json"], "--calibration: belongs to --register"),
    ],
)
def test_a_wrong_request_gets_one_line(
    arguments: list[str],
    message: str,
    files: tuple[Path, Path, RigidTransform],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    names = {"TARGET": str(files[0]), "SOURCE": str(files[1])}
    assert main([names.get(argument, argument) for argument in arguments]) == 2
    told = capsys.readouterr().err
    assert told.startswith("run-experiment: ")
    assert told.count("\n") == 1
    assert message in told
    assert list(tmp_path.iterdir()) == []
