from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from shipped_configs import CONFIGS

from harness.config.reading import load_experiment
from harness.execution import scan_view
from harness.figures.overview import draw_overview
from harness.scoring import exact_pose
from harness.store import Row, Store, load
from harness.trials.specs import TrialSpec, build_trials

DESK = CONFIGS / "desk.yaml"


def one_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1)


def test_the_arm_and_all_views_are_drawn(tmp_path: Path) -> None:
    overrides = ["methods=[{name: gauss_sphere}]", "repeats=1", "arm={}"]
    overrides += ["scan.profiles=44", "scan.step_mm=9"]
    trials = build_trials(load_experiment(DESK, overrides), DESK)
    with Store(tmp_path) as store:
        store.begin(trials)
        for trial in trials:
            spec = trial.spec
            assert isinstance(spec, TrialSpec)
            T_exact = exact_pose(spec.path(spec.target), spec.path(spec.source))
            store.add(Row(trial.id, "{}", "ok", T_exact=T_exact, T_estimated=T_exact), "code")
    stale = tmp_path / "figures" / "views_thesis_superposed.png"
    stale.parent.mkdir()
    stale.touch()
    rows = load(tmp_path)
    files = draw_overview(trials, ["gauss_sphere"], rows, tmp_path, one_thread)
    assert [file.name for file in files] == [
        "views_arm.png", "views_gauss_sphere_superposed.png", "views_gauss_sphere_merged.ply",
    ]  # fmt: skip
    assert not stale.exists()
    for file in files[:2]:
        image = np.asarray(Image.open(file).convert("RGB"))
        assert len(np.unique(image.reshape(-1, 3), axis=0)) > 100
    specs = [trial.spec for trial in trials if isinstance(trial.spec, TrialSpec)]
    views = {view.name: (spec, view) for spec in specs for view in (spec.target, spec.source)}
    measured = sum(scan_view(spec, view).n_valid for spec, view in views.values())
    assert len(trimesh.load(files[2]).vertices) == measured

    rows["status"] = "failed"
    files = draw_overview(trials, ["gauss_sphere"], rows, tmp_path, one_thread)
    assert [file.name for file in files] == ["views_arm.png"]
    assert draw_overview(trials, [], rows, tmp_path, one_thread) == []
    assert not list(tmp_path.glob("*/views_*"))
