from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from shipped_configs import CONFIGS

from harness.config.reading import load_experiment
from harness.execution import perform
from harness.scoring import exact_pose
from harness.trials.specs import build_trials
from registration import register
from scenes.desk import DeskParams, desk
from scenes.scene import Scene
from sensors.jupiter import Jupiter
from sensors.paths import ViewPath

DESK = CONFIGS / "desk.yaml"


def trial_of(file: Path, *overrides: str, index: int = 0):
    return build_trials(load_experiment(file, overrides), file)[index]


def moved_scene(scene: Scene, T: RigidTransform) -> Scene:
    """The same objects elsewhere in the world."""
    world = mujoco.MjSpec()
    frame = world.worldbody.add_frame(
        pos=np.asarray(T.translation) / 1000.0, quat=T.rotation.as_quat(scalar_first=True)
    )
    world.attach(scene.spec.copy(), frame=frame, prefix="moved_")
    surfaces = tuple(
        replace(s, geom=f"moved_{s.geom}", polygon_m=T.apply(1000.0 * s.polygon_m) / 1000.0)
        for s in scene.surfaces
    )
    return Scene(scene.name, world, surfaces)


@pytest.mark.parametrize("seed", [1, 2])
def test_moving_the_whole_world_changes_no_estimate(seed: int) -> None:
    """The truth stays out: an estimate that knew the world would move with it."""
    spec = trial_of(DESK).spec
    scene, sensor = desk(DeskParams()), Jupiter()
    rng = np.random.default_rng(seed)
    T = RigidTransform.from_components(rng.normal(0.0, 800.0, 3), Rotation.random(rng=rng))
    estimates = []
    for place, world in ((RigidTransform.identity(), scene), (T, moved_scene(scene, T))):
        paths = [spec.path(view) for view in (spec.target, spec.source)]
        paths = [ViewPath(place * p.T_world_profile, p.step_mm) for p in paths]
        scans = [
            sensor.scan(world, p, np.random.default_rng([seed, i])) for i, p in enumerate(paths)
        ]
        estimates.append(register(*scans, method="thesis").T_target_source)
    assert estimates[0] is not None
    np.testing.assert_allclose(estimates[1].as_matrix(), estimates[0].as_matrix(), atol=1e-6)


def test_a_trial_gives_the_same_row_every_time(small_file: Path) -> None:
    rows = [perform(trial_of(small_file)).row for _ in range(2)]
    assert rows[0].status == "ok"
    a, b = (replace(row, stage_ms={}, T_exact=None, T_estimated=None,
                    covariance=None, undetermined=None) for row in rows)  # fmt: skip
    assert a == b
    np.testing.assert_array_equal(*(row.T_estimated.as_matrix() for row in rows))


def test_a_row_holds_the_exact_pose_and_both_overlaps(small_file: Path) -> None:
    trial = trial_of(small_file)
    outcome = perform(trial)
    spec = trial.spec
    exact = exact_pose(spec.path(spec.target), spec.path(spec.source))
    np.testing.assert_array_equal(outcome.row.T_exact.as_matrix(), exact.as_matrix())
    assert 0.3 < outcome.row.overlap_target <= 1.0
    assert 0.3 < outcome.row.overlap_source <= 1.0
    assert outcome.row.counts["patches_target"] >= 3
    assert {"scan", "overlap", "registration"} <= set(outcome.row.stage_ms)
    assert (outcome.pair.target_view, outcome.pair.source_view) == ("right", "left")


def test_views_that_share_nothing_are_a_row_and_not_registered() -> None:
    trial = trial_of(DESK, "rotation_labels=printed", "methods=[{name: thesis}]", index=1)
    outcome = perform(trial)
    assert outcome.row.status == "no_overlap"
    assert "views center and right overlap by 0%" in outcome.row.reason
    assert outcome.row.T_exact is not None
    assert outcome.row.T_estimated is None
    assert outcome.pair is None


def test_a_view_without_a_point_is_said_to_be_one(small_file: Path) -> None:
    row = perform(trial_of(small_file, "views.left.distance_mm=9000")).row
    assert row.status == "no_overlap"
    assert "left measures no point" in row.reason


def test_a_bug_in_a_method_is_a_row_with_its_traceback(small_file: Path) -> None:
    row = perform(trial_of(small_file, "methods.0.name=own_methods:crash")).row
    assert row.status == "error"
    assert row.reason == "ZeroDivisionError: a bug"
    assert "in crash" in row.traceback
    assert row.overlap_target is not None  # so that it counts as a failure among its like


def test_a_method_of_ones_own_takes_its_parameters(small_file: Path) -> None:
    trial = trial_of(
        small_file, "methods.0.name=own_methods:give_up", "methods.0.params.reason=because"
    )
    row = perform(trial).row
    assert (row.status, row.reason) == ("failed", "because")
