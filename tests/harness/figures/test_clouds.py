from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from harness.config.reading import load_experiment
from harness.execution import perform
from harness.figures.clouds import SOURCE_RGB, TARGET_RGB, write_clouds
from harness.file_names import file_slug
from harness.trials.specs import build_trials


def test_clouds_hold_the_measured_points(small_file: Path, tmp_path: Path) -> None:
    trial = build_trials(load_experiment(small_file), small_file)[0]
    pair = perform(trial).pair
    folder = tmp_path / "scans"
    files = write_clouds(pair, folder)
    assert [file.name for file in files] == ["right.ply", "left.ply", "a.b_thesis_merged.ply"]
    assert sorted(folder.iterdir()) == sorted(files)
    target, source, merged = (trimesh.load(file) for file in files)
    expected = pair.source.points_mm[pair.source.valid]
    np.testing.assert_allclose(source.vertices, expected, atol=1e-3)
    moved = pair.result.T_target_source.apply(expected)
    both = np.concatenate([pair.target.points_mm[pair.target.valid], moved])
    np.testing.assert_allclose(merged.vertices, both, atol=1e-3)
    assert tuple(merged.colors[0][:3]) == TARGET_RGB
    assert tuple(merged.colors[-1][:3]) == SOURCE_RGB
    assert len(target.vertices) == pair.target.n_valid


def test_file_names_hold_nothing_odd() -> None:
    assert file_slug("6.4_thesis (3D), ä/b") == "6.4_thesis_3D_b"
