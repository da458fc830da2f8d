"""Views that the arm drives: what enters a trial, and what is told of the three poses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from shipped_configs import CONFIGS

from experiments.cli import main
from harness.config.errors import ConfigError
from harness.config.reading import load_experiment
from harness.execution import perform, scan_view
from harness.scoring.poses import encoder_pose, exact_pose, pose_error
from harness.tables.views import arm_table
from harness.trials.specs import Trial, TrialSpec, beyond_reach, build_trials
from sensors.arm import ArmParams, ArmPath

DESK = CONFIGS / "desk.yaml"
BRACKET = "arm={bracket_mm: [4, -2, 3], bracket_deg: [0.5, 0.3, -0.4]}"
TURNED = Rotation.from_rotvec([0.5, 0.3, -0.4], degrees=True)
T_NOMINAL_SENSOR = RigidTransform.from_components([4, -2, 3], TURNED)


def trials_of(*overrides: str) -> Sequence[Trial]:
    small = ("methods=[{name: thesis}]", "repeats=2", "scan.profiles=20")
    return build_trials(load_experiment(DESK, (*small, *overrides)), DESK)


def spec_of(*overrides: str) -> TrialSpec:
    spec = trials_of(*overrides)[0].spec
    assert isinstance(spec, TrialSpec)
    return spec


def test_a_bracket_moves_the_exact_pose_by_what_it_is() -> None:
    spec = spec_of(BRACKET)
    target, source = spec.path(spec.target), spec.path(spec.source)
    told = encoder_pose(target, source)
    assert told is not None
    implied = T_NOMINAL_SENSOR.inv() * told * T_NOMINAL_SENSOR
    off = pose_error(exact_pose(target, source), implied)
    assert np.rad2deg(off.rotation_rad) < 0.01
    assert off.translation_mm < 0.1
    assert pose_error(exact_pose(target, source), told).translation_mm > 2.0


def test_a_perfect_bracket_leaves_only_what_the_encoders_round() -> None:
    spec = spec_of("arm={}")
    target, source = spec.path(spec.target), spec.path(spec.source)
    told = encoder_pose(target, source)
    assert told is not None
    off = pose_error(exact_pose(target, source), told)
    assert 0.0 < np.rad2deg(off.rotation_rad) < 0.01
    assert 0.0 < off.translation_mm < 0.1


def test_without_an_arm_the_sensor_is_where_it_was_asked_to_be() -> None:
    spec = spec_of("arm=null")
    path = spec.path(spec.target)
    asked = spec.target.commanded(spec.profiles, spec.step_mm)
    np.testing.assert_allclose(path.T_world_view.as_matrix(), asked.as_matrix(), atol=1e-9)
    assert encoder_pose(path, spec.path(spec.source)) is None
    assert arm_table(trials_of("arm=null")) is None


def test_the_arm_is_part_of_the_trial() -> None:
    ids = [{trial.id for trial in trials_of(arm)} for arm in ("arm=null", "arm={}", BRACKET)]
    assert len(set.union(*ids)) == sum(len(each) for each in ids)
    written = "arm={bracket_mm: [0, 0, 0], track_step_mm: 50}"
    assert {trial.id for trial in trials_of(written)} == ids[1]


def test_a_line_is_driven_once_for_all_pairs_methods_and_repeats() -> None:
    specs = [trial.spec for trial in trials_of()]
    paths = {
        id(spec.path(view))
        for spec in specs
        if isinstance(spec, TrialSpec)
        for view in (spec.target, spec.source)
        if view.name == "center"
    }
    assert len(paths) == 1


def test_a_scan_knows_nothing_of_where_the_sensor_was() -> None:
    spec = spec_of(BRACKET)
    scan = scan_view(spec, spec.target)
    path = spec.path(spec.target)
    x_mm = path.T_world_view.inv().apply(path.T_world_profile.translation)[:, 0]
    planned_mm = spec.step_mm * np.arange(spec.profiles)
    assert np.abs(x_mm - planned_mm).max() > 1e-3
    measured = np.nanmax(np.abs(scan.points_mm[..., 0] - planned_mm[:, None]))
    assert measured == 0.0


def test_a_view_out_of_reach_is_refused_before_any_scan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    far = "views.center.distance_mm=3000"
    assert main([str(DESK), "--set", far, "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert all(part in told for part in ("views.center: ", "joint 3", "535 mm"))
    assert not out.exists()


def test_a_placed_view_out_of_reach_needs_leave_to_go_without_the_arm() -> None:
    # Leave is given to other readings of the labels only, not to an arm that stands too far away.
    with pytest.raises(ConfigError, match=r"views\.right: out of the arm's reach: .*joint 3"):
        trials_of("arm.base_mm=[-1050, -100, 125]", "scan.profiles=130")
    printed = "rotation_labels=printed"
    with pytest.raises(ConfigError, match=r"views\.right: out of the arm's reach"):
        trials_of(printed, "views.right={placed_by: '6.5'}")
    trials = trials_of(printed)
    (name,) = beyond_reach(load_experiment(DESK, [printed]), trials)
    assert name == "right"
    paths = {
        view.name: spec.path(view)
        for spec in (trial.spec for trial in trials)
        if isinstance(spec, TrialSpec)
        for view in (spec.target, spec.source)
    }
    assert {n: isinstance(p, ArmPath) for n, p in paths.items()} == {
        "center": True,
        "left": True,
        "right": False,
    }


def test_a_sensor_mounted_upside_down_is_driven_downwards() -> None:
    for roll_deg, sign in ((0, 1.0), (180, -1.0)):
        spec = spec_of(
            "views.left={aim_mm: [0, 0, 120], distance_mm: 1030, pitch_deg: 25}",
            f"views.left.roll_deg={roll_deg}",
        )
        path = spec.path(spec.source)
        assert isinstance(path, ArmPath)
        climbs_mm = sign * np.diff(path.T_world_profile.translation[:, 2])
        np.testing.assert_allclose(climbs_mm, 3.0 * np.cos(np.deg2rad(25.0)), atol=0.1)


def test_the_next_view_is_where_waist_and_track_leave_the_arm() -> None:
    following = "views.left={next_of: center, waist_deg: 12, track_mm: -150}"
    spec = spec_of(following, "pairs.6.4={source: left, target: center}", "arm={}")
    assert (spec.target.name, spec.source.name) == ("center", "left")
    center, left = spec.path(spec.target), spec.path(spec.source)
    assert isinstance(center, ArmPath)
    assert isinstance(left, ArmPath)
    assert left.track_mm == center.track_mm - 150.0
    T_world_base = ArmParams().T_world_base
    foot = [RigidTransform.from_translation([0.0, p.track_mm, 0.0]) for p in (center, left)]
    turn = RigidTransform.from_rotation(Rotation.from_euler("z", 12.0, degrees=True))
    moved = T_world_base * foot[1] * turn * foot[0].inv() * T_world_base.inv()
    # A view that is asked for is met to the rounding of the encoders.
    off = pose_error(moved * center.T_world_encoder[0], left.T_world_encoder[0])
    assert off.translation_mm < 0.1
    assert np.rad2deg(off.rotation_rad) < 0.01
    assert scan_view(spec, spec.source).n_valid > 0


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["views.left={next_of: center, track_mm: 9000}"],
            r"views\.left: .*track would have to go",
        ),
        (
            ["views.left={next_of: center, waist_deg: 3}", "arm=null"],
            r"views\.left\.next_of: moves",
        ),
        (["views.left={next_of: centre}"], r"views\.left\.next_of: unknown view 'centre'"),
        (["views.left={next_of: center, waist: 3}"], r"views\.left\.waist: unknown key"),
    ],
)
def test_a_next_view_that_cannot_be_is_refused(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as raised:
        trials_of("pairs.6.4={source: left, target: center}", *overrides)
    assert "\n" not in str(raised.value)


def test_the_row_of_a_trial_keeps_the_theoretical_pose() -> None:
    trial = trials_of(BRACKET)[0]
    row = perform(trial).row
    spec = spec_of(BRACKET)
    told = encoder_pose(spec.path(spec.target), spec.path(spec.source))
    assert told is not None
    assert row.T_theoretical is not None
    np.testing.assert_array_equal(row.T_theoretical.as_matrix(), told.as_matrix())


def test_the_table_of_the_arm_tells_the_bracket() -> None:
    table = arm_table(trials_of(BRACKET))
    assert table is not None
    frame: pd.DataFrame = table.frame
    assert set(frame["View"]) == {"left", "center", "right"}
    length_mm = float(np.linalg.norm([4, -2, 3]))
    np.testing.assert_allclose(frame["Exact from encoders (mm)"], length_mm, atol=0.1)
    turn_deg = float(np.linalg.norm([0.5, 0.3, -0.4]))
    np.testing.assert_allclose(frame["Exact from encoders (deg)"], turn_deg, atol=0.01)
    assert (frame["Encoders from commanded (mm)"] < 0.05).all()
    assert (frame["Left (deg)"] > 0.0).all()
