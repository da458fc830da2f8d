"""Views of a config that are scanned along the vertical, between two heights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shipped_configs import CONFIGS

from harness.config.choices import canonical_json
from harness.config.errors import ConfigError
from harness.config.reading import load_experiment
from harness.trials.specs import TrialSpec, build_trials
from harness.trials.views import ViewSpec
from sensors import f3
from sensors.arm import ArmParams, ArmPath

DESK, VERTICAL = CONFIGS / "desk.yaml", CONFIGS / "desk_vertical.yaml"


def specs(*overrides: str, config: Path = VERTICAL) -> list[TrialSpec]:
    few = ("repeats=1", "methods=[{name: gauss_sphere}]")
    trials = build_trials(load_experiment(config, (*few, *overrides)), config)
    return [trial.spec for trial in trials if isinstance(trial.spec, TrialSpec)]


@pytest.mark.parametrize("direction", ["up", "down"])
def test_every_view_goes_from_one_height_to_the_other(direction: str) -> None:
    chosen = (f"scan.direction={direction}", "scan.step_mm=20", "arm.bracket_mm=[0, 0, 0]")
    first = "views.left.roll_deg=0"
    for spec in specs(*chosen, "arm.bracket_deg=[0, 0, 0]", first):
        assert spec.profiles == 20  # 390 mm hold 19 whole steps
        for view in (spec.target, spec.source):
            path = spec.path(view)
            assert isinstance(path, ArmPath)
            heights_mm = path.T_world_profile.translation[:, 2]
            ends_mm = (360.0, 740.0) if direction == "up" else (750.0, 370.0)
            assert heights_mm[[0, -1]] == pytest.approx(ends_mm, abs=0.15)
            across_mm = np.ptp(path.T_world_profile.translation[:, :2], axis=0)
            assert across_mm == pytest.approx(0.0, abs=0.15)


def test_a_start_given_by_joints_is_taken_to_the_end_of_its_line() -> None:
    aimed = specs("scan.step_mm=20")[0]
    path = aimed.path(aimed.source)
    assert isinstance(path, ArmPath)
    joints = f3.from_pulses(path.counts)[5]  # somewhere along the line
    degrees = np.rad2deg(joints[1:]).round(9).tolist()
    start = f"views.left={{joints_deg: {degrees}, track_mm: {joints[0]}}}"
    by_joints = specs("scan.step_mm=20", start)[0]
    again = by_joints.path(by_joints.source)
    assert isinstance(again, ArmPath)
    off = path.T_world_encoder.inv() * again.T_world_encoder
    assert np.abs(off.translation).max() < 0.2
    assert np.rad2deg(off.rotation.magnitude()).max() < 0.02


@pytest.mark.parametrize(
    ("config", "overrides", "message"),
    [
        (VERTICAL, ["scan.profiles=40"], r"profiles is 40, but from low_mm 360 .* there are 131"),
        (VERTICAL, ["scan.high_mm=300"], r"low_mm 360 should lie below high_mm 300"),
        (VERTICAL, ["scan.high_mm=null", "scan.profiles=4"], r"low_mm and high_mm belong together"),
        (VERTICAL, ["scan.line=sensor_x"], r"low_mm is for vertical lines; add `line: vertical`"),
        (VERTICAL, ["scan.line=upright"], r"scan\.line"),
        (DESK, ["scan.direction=down"], r"direction is for vertical lines"),
        (
            DESK,
            ["scan={line: vertical, low_mm: 400, high_mm: 700, step_mm: 3}"],
            r"views\.left: gives a pose whose height is not that of scan\.low_mm",
        ),
        (
            VERTICAL,
            ["views.left={joints_deg: [0, 0, 0, 0, 0, 200], track_mm: 0}"],
            r"views\.(left|center): out of the arm's reach: .*joint 6 would have to turn to 200",
        ),
        (
            VERTICAL,
            ["views.left={joints_deg: [0, 0, 0, 0, 0, 0], track_mm: 0}", "arm=null"],
            r"views\.left: gives joints, and `arm` names no arm|views\..*: moves the arm",
        ),
        (
            DESK,
            ["scan.line=vertical", "views.center.roll_deg=90", "arm=null"],
            r"views\.\w+: the laser plane of the sensor is nearly upright",
        ),
    ],
)
def test_lines_that_cannot_be_are_refused(config: Path, overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as raised:
        specs(*overrides, config=config)
    assert "\n" not in str(raised.value)


def test_the_resolved_config_of_a_vertical_line_can_be_read_again() -> None:
    resolved = load_experiment(VERTICAL).scan
    assert type(resolved).model_validate(resolved.model_dump()) == resolved
    assert resolved.profiles == 131


def test_trials_along_the_sensor_s_own_x_keep_their_ids() -> None:
    view = specs(config=DESK)[0].target
    assert '"line"' not in canonical_json(view)
    assert '"line"' in canonical_json(specs()[0].target)
    assert isinstance(view, ViewSpec)
    assert view.arm == ArmParams(bracket_mm=(3, 3, 3), bracket_deg=(0.2, 0.2, 0.2))
