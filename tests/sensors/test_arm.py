"""Laws of the arm: the three poses of a profile, and what it cannot reach."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from experiments.profile_pairs import load_profiles
from harness.config.reading import experiment_kind, load_experiment, read_mapping
from harness.trials.specs import build_trials, full_specs
from scenes import SCENES
from sensors import arm, f3
from sensors.arm import TOOL_CENTRE_POINT, ArmParams, ReachError, viewing_line
from sensors.arm_picture import model_with_arm, place_arm
from sensors.paths import aimed_view

CONFIGS = Path(__file__).parents[2] / "configs"


def differences(a: RigidTransform, b: RigidTransform) -> tuple[float, float]:
    """Largest distance in mm and largest angle in degrees."""
    between = a.inv() * b
    distance_mm = np.linalg.norm(np.atleast_2d(between.translation), axis=1)
    return float(distance_mm.max()), float(np.rad2deg(between.rotation.magnitude()).max())


def published_views() -> dict[str, tuple[str, RigidTransform, int, float, ArmParams]]:
    """Scene, commanded pose, line and arm of every view that the shipped configs take."""
    views = {}
    for file in sorted(CONFIGS.glob("*.yaml")):
        if "views" not in read_mapping(file):
            continue
        load = load_profiles if experiment_kind(file) == "profiles" else load_pairs
        for spec in full_specs(load(file)[1]):
            for view in (spec.target, spec.source):
                T_world_view = view.commanded(spec.profiles, spec.step_mm)
                # The bracket is no part of what the arm is told.
                params = replace(view.arm, bracket_mm=(0.0,) * 3, bracket_deg=(0.0,) * 3)
                line = (spec.scene.name, T_world_view, spec.profiles, spec.step_mm, params)
                views[f"{file.stem} {view.name}"] = line
    return views


def load_pairs(file: Path):
    experiment = load_experiment(file)
    return experiment, build_trials(experiment, file)


VIEWS = published_views()


def test_all_experiments_of_chapter_6_are_driven():
    assert {name.split()[0] for name in VIEWS} >= {"desk", "desk_virtual", "foam", "foam_2d"}


@pytest.mark.parametrize("name", VIEWS)
def test_perfect_bracket_leaves_the_three_poses_close_but_apart(name):
    _, *view, params = VIEWS[name]
    path = viewing_line(*view, params, seed=3)
    commanded, encoder, exact = (
        path.T_world_commanded, path.T_world_encoder, path.T_world_profile
    )  # fmt: skip
    np.testing.assert_allclose(commanded[0].as_matrix(), view[0].as_matrix(), atol=1e-9)
    for one, other in ((commanded, encoder), (encoder, exact), (commanded, exact)):
        distance_mm, angle_deg = differences(one, other)
        assert 1e-4 < distance_mm < 0.1
        assert 1e-5 < angle_deg < 0.01


@pytest.mark.parametrize("name", VIEWS)
def test_published_views_are_driven_smoothly_within_the_limits(name):
    _, *view, params = VIEWS[name]
    path = viewing_line(*view, params)
    joints = f3.from_pulses(path.counts)
    assert (joints >= f3.LIMITS[:, 0]).all()
    assert (joints <= f3.LIMITS[:, 1]).all()
    assert np.ptp(joints[:, 0]) == 0.0
    assert np.abs(np.diff(joints[:, 1:], axis=0)).max() < np.deg2rad(5.0)
    assert f3.self_contact(joints) is None


@pytest.mark.parametrize("name", VIEWS)
def test_arm_neither_touches_the_scene_nor_stands_in_the_view(name):
    scene_name, T_world_view, profiles, step_mm, params = VIEWS[name]
    entry = SCENES[scene_name]
    path = viewing_line(T_world_view, profiles, step_mm, params)
    model = model_with_arm(entry.builder(entry.params_type()), params)
    hit = np.zeros(1, np.int32)
    for profile in (0, profiles // 2, profiles - 1):
        data = place_arm(model, path, profile)
        assert data.ncon == 0
        pose = path.T_world_profile[profile]
        for slope in np.linspace(-0.2343, 0.2343, 15):
            # From just before the sensor's front, where the beams have left its housing.
            start_m = pose.apply([0.0, slope * 65.0, 2.0]) / 1000.0
            ray = pose.rotation.apply([0.0, slope, 1.0])
            mujoco.mj_ray(model, data, start_m, ray, None, 1, -1, hit)
            body = model.geom_bodyid[hit[0]] if hit[0] >= 0 else 0
            assert not model.body(body).name.startswith("arm/")


def test_bracket_error_moves_the_exact_poses_by_what_it_implies():
    params = ArmParams(bracket_mm=(1.5, -2.0, 0.7), bracket_deg=(0.4, -0.3, 0.6))
    _, T_world_left, profiles, step_mm, _ = VIEWS["desk left"]
    _, T_world_center, *_ = VIEWS["desk center"]
    left = viewing_line(T_world_left, profiles, step_mm, params)
    center = viewing_line(T_world_center, profiles, step_mm, params)
    bracket = RigidTransform.from_components(
        [1.5, -2.0, 0.7], Rotation.from_rotvec(np.deg2rad([0.4, -0.3, 0.6]))
    )
    distance_mm, angle_deg = differences(left.T_world_encoder * bracket, left.T_world_profile)
    assert distance_mm < 1e-9
    assert angle_deg < 1e-9
    # (3-1): Q = Q1^-1 Q3 Q2, with Q1 and Q3 Q2 the two sensors in one base frame.
    theoretical = center.T_world_encoder[0].inv() * left.T_world_encoder[0]
    exact = center.T_world_view.inv() * left.T_world_view
    distance_mm, angle_deg = differences(bracket.inv() * theoretical * bracket, exact)
    assert distance_mm < 1e-9
    assert angle_deg < 1e-9
    assert differences(theoretical, exact)[0] > 1.0


def test_profiles_lie_on_the_sensors_x_at_multiples_of_the_step():
    _, T_world_view, profiles, step_mm, _ = VIEWS["desk center"]
    path = viewing_line(T_world_view, profiles, step_mm, ArmParams(), seed=4)
    in_view = T_world_view.inv() * path.T_world_profile
    planned = np.outer(step_mm * np.arange(profiles), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(in_view.translation, planned, atol=0.1)
    assert path.step_mm == step_mm


def test_moving_base_and_view_together_moves_the_poses_along():
    _, T_world_view, profiles, step_mm, _ = VIEWS["desk_virtual left"]
    params = ArmParams()
    move = RigidTransform.from_components(
        [300.0, -200.0, 55.0], Rotation.from_euler("z", 70.0, degrees=True)
    )
    moved = ArmParams(
        base_mm=tuple(move.apply(params.base_mm).tolist()), base_yaw_deg=params.base_yaw_deg + 70.0
    )
    here = viewing_line(T_world_view, profiles, step_mm, params, seed=5)
    there = viewing_line(move * T_world_view, profiles, step_mm, moved, seed=5)
    np.testing.assert_array_equal(here.counts, there.counts)
    assert max(differences(move * here.T_world_profile, there.T_world_profile)) < 1e-6


def test_line_through_the_straight_wrist_keeps_joint_4_still():
    # Level and straight before the arm, the forearm passes through the direction of the view.
    place = f3.flange_by_simulator(np.deg2rad([[0, 0, -75, 110, 0, 35, 0]]))[0]
    params = ArmParams(base_mm=(0.0, 0.0, 0.0), track_mm=0.0)
    joints = arm.solve_joints(
        arm.straight_line(place * TOOL_CENTRE_POINT, 60, 4.0).T_world_profile, params
    )
    assert joints[0, 5] * joints[-1, 5] < 0.0
    assert np.ptp(joints[:, 4]) < 1e-9
    assert np.abs(np.diff(joints[:, 1:], axis=0)).max() < np.deg2rad(3.0)


def test_rest_within_a_count_is_seeded():
    _, *view, _ = VIEWS["desk_virtual center"]
    first, again, other = (viewing_line(*view, ArmParams(), seed=s) for s in (1, 1, 2))
    assert first is again
    np.testing.assert_array_equal(first.counts, other.counts)
    assert 1e-5 < differences(first.T_world_profile, other.T_world_profile)[0] < 0.1


def test_next_view_turns_the_waist_and_moves_along_the_track():
    _, *view, _ = VIEWS["desk_virtual center"]
    path = viewing_line(*view, ArmParams())
    T_world_next, track_mm = arm.next_view(path.counts[0], np.deg2rad(-20), 300.0, ArmParams())
    assert track_mm == path.track_mm + 300.0
    axis_mm = ArmParams().T_world_base.apply([0.0, path.track_mm, 0.0])
    turn = RigidTransform.from_rotation(Rotation.from_euler("z", -20.0, degrees=True))
    about = RigidTransform.from_translation(axis_mm)
    expected = RigidTransform.from_translation([0, 300, 0]) * about * turn * about.inv()
    assert max(differences(expected * path.T_world_encoder[0], T_world_next)) < 1e-9
    with pytest.raises(
        ReachError, match=r"track would have to go to 3\d+\.0 mm; its limit is 2600"
    ):
        arm.next_view(path.counts[0], 0.0, 2400.0, ArmParams())


def test_view_out_of_reach_names_joint_value_and_limit():
    far = aimed_view([2000, 0, 100], 600, 0, 0, 0, 40, 5.0)
    with pytest.raises(
        ReachError,
        match=r"profile \d+: joint 3 cannot stretch the arm to \d+\.\d mm .*limit is 535",
    ):
        viewing_line(far, 40, 5.0, ArmParams())


@pytest.mark.parametrize(
    ("turns_deg", "joint", "limit"),
    [
        ((20, 60, 20, 0, 30, 0), 2, "45"),
        ((20, -20, 139, 0, 30, 0), 3, "135"),
        ((20, -80, -120, -160, 138, 0), 5, "135"),
    ],
)
def test_passing_a_limit_names_joint_value_and_limit(turns_deg, joint, limit):
    place = f3.flange_by_simulator(np.array([[1000.0, *np.deg2rad(turns_deg)]]))[0]
    params = ArmParams(base_mm=(0.0, 0.0, 0.0), track_mm=1000.0)
    with pytest.raises(
        ReachError,
        match=rf"profile 0: joint {joint} would have to turn to -?{turns_deg[joint - 1]}\.00 "
        rf"degrees; its limit is -?{limit} degrees, with the arm at 1000 mm",
    ):
        viewing_line(place * TOOL_CENTRE_POINT, 1, 3.0, params)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"track_mm": 2700.0}, "track_mm is 2700.0; the track runs from 0 to 2600 mm"),
        ({"track_step_mm": 0.0}, "track_step_mm is 0.0"),
        ({"base_mm": (0.0, float("nan"), 0.0)}, "not finite"),
        ({"base_mm": (0.0, 1.0)}, r"base_mm is \(0.0, 1.0\); expected three numbers"),
        ({"base_yaw_deg": 400.0}, "base_yaw_deg is 400.0; expected -360 to 360"),
        ({"bracket_mm": (0.0, 0.0, 2000.0)}, "bracket_mm is .*; expected -1000 to 1000"),
        ({"bracket_deg": (0.0, 200.0, 0.0)}, "bracket_deg is .*; expected -180 to 180"),
    ],
)
def test_impossible_parameters_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        ArmParams(**fields)
