from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from shipped_configs import CONFIGS

from harness import execution
from harness.config.choices import canonical_json
from harness.config.errors import ConfigError
from harness.config.limits import Limits
from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import load_experiment
from harness.execution import full_spec
from harness.session import open_session
from harness.trials import random_pairs
from harness.trials.random_pairs import (
    NoPairError,
    RandomSpec,
    build_random_trials,
    drawn_spec,
    family_of,
)
from harness.trials.specs import Trial, TrialSpec
from harness.workers.child import Task
from harness.workers.supervise import perform_all
from registration.calibration import Calibration, Table
from sensors.noise import NoiseParams

CONFIG = """\
title: A few random pairs
experiment: random_pairs
sensor: {name: jupiter}
scan: {profiles: 40, step_mm: 10.0}
families:
  desk:
    scene: {name: desk}
    pairs: 4
    aim_mm: [-20, 0, 100]
    aim_within_mm: 150
    distance_mm: [800, 1000]
    pitch_deg: 25
  clutter:
    scene: {name: clutter}
    new_scene: true
    pairs: 2
    aim_mm: [0, 0, 60]
    aim_within_mm: 100
    distance_mm: [800, 1000]
    pitch_deg: 25
overlap: [0.2, 0.5, 1.0]
methods:
  - {name: gauss_sphere}
  - {name: thesis}
seed: 3
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    file = tmp_path / "few.yaml"
    file.write_text(CONFIG, encoding="utf-8")
    return file


def trials_of(file: Path, *overrides: str) -> Sequence[Trial]:
    return build_random_trials(load_experiment(file, overrides), file)


def pair_of(trial: Trial) -> TrialSpec:
    return drawn_spec(trial.spec, lambda spec: execution.common(spec).shares)


def views_of(spec: TrialSpec) -> str:
    return canonical_json([spec.scene, spec.target, spec.source])


def test_every_pair_meets_every_method_and_ids_differ(config: Path) -> None:
    trials = trials_of(config)
    assert len({trial.id for trial in trials}) == len(trials) == 2 * (4 + 2)
    pairs = [trial.pair for trial in trials]
    assert pairs[:4] == ["desk 0", "desk 0", "clutter 0", "clutter 0"]
    assert {family_of(pair) for pair in pairs} == {"desk", "clutter"}
    assert [t.label for t in trials[:2]] == ["gauss_sphere", "thesis"]


def test_a_pair_is_the_same_for_every_method_and_noise(config: Path) -> None:
    ours, thesis, *_ = trials_of(config)
    assert views_of(pair_of(ours)) == views_of(pair_of(thesis))
    exact = trials_of(config, "sensor.params={noise: {enabled: false}}")[0]
    assert exact.spec.sensor.params.noise == NoiseParams.exact()
    assert views_of(pair_of(exact)) == views_of(pair_of(ours))


def test_a_pair_does_not_depend_on_the_other_pairs(config: Path) -> None:
    few = trials_of(config, "families.desk.pairs=1")
    many = trials_of(config)
    assert {trial.id for trial in few} < {trial.id for trial in many}
    other = trials_of(config, "seed=4")
    assert {trial.id for trial in other}.isdisjoint({trial.id for trial in many})


def test_pairs_lie_in_their_range_and_within_the_limits(config: Path) -> None:
    scenes = set()
    for trial in trials_of(config)[::2]:
        spec = pair_of(trial)
        scenes.add(canonical_json(spec.scene))
        least = min(execution.common(spec).shares)
        low, high = ((0.2, 0.5), (0.5, 1.0))[trial.spec.repeat % 2]
        assert low <= least <= high
        target, source = spec.target.aim, spec.source.aim
        assert abs(target.yaw_deg - source.yaw_deg) <= 40.0
        assert abs(target.yaw_deg + source.yaw_deg) <= 20.0
        for aim in (target, source):
            assert abs(aim.pitch_deg - 25.0) <= 10.0
            assert abs(aim.roll_deg) <= 10.0
            assert 800.0 <= aim.distance_mm <= 1000.0
    assert len(scenes) == 3  # the desk, and a new clutter for each pair


def test_a_row_holds_the_views_that_were_drawn(config: Path) -> None:
    trial = trials_of(config)[0]
    row = execution.perform(trial).row
    assert row.status == "ok", row.traceback
    assert row.id == trial.id
    spec = json.loads(row.spec)
    drawn = pair_of(trial)
    assert spec["target"]["aim"]["yaw_deg"] == drawn.target.aim.yaw_deg
    assert spec["method"]["name"] == "gauss_sphere"
    assert row.bounds is not None
    assert row.bounds.shape == (2, 6, 6)


def test_what_cannot_be_drawn_is_said(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(random_pairs, "MOST_DRAWS", 20)
    spec = trials_of(config, "families.desk.aim_mm=[0, 0, 9000]")[0].spec
    assert isinstance(spec, RandomSpec)
    with pytest.raises(NoPairError, match="none overlaps by 20% to 50%"):
        drawn_spec(spec, lambda drawn: (0.0, 0.0))
    row = execution.perform(Trial(spec, "desk 0", "gauss_sphere")).row
    assert row.status == "error"
    assert "aim closer" in row.reason


def test_what_cannot_be_drawn_is_searched_for_once_for_all_methods(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[RandomSpec] = []

    def search(spec: RandomSpec, shares: object) -> TrialSpec:
        searched.append(spec)
        raise NoPairError("none overlaps")

    monkeypatch.setattr(execution, "drawn_spec", search)
    trials = [trial for trial in trials_of(config, "seed=77") if trial.pair == "desk 0"]
    rows = [execution.perform(trial).row for trial in trials]
    assert [row.reason for row in rows] == ["NoPairError: none overlaps"] * 2
    assert len(searched) == 1


def test_the_time_limit_of_a_trial_covers_the_search_for_its_pair(config: Path) -> None:
    trial = trials_of(config, "overlap=[0.99, 1.0]", "sensor.params={pixels: 512}")[0]
    (ended,) = perform_all([Task(trial, keep=True)], Limits(trial_s=0.3))
    assert ended.row.status == "error"
    assert ended.row.reason == "did not end within 0.3 s and was killed"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("families.desk.new_scene=true", "families.desk.new_scene: scene 'desk' has no seed"),
        ("families.desk.distance_mm=[900, 800]", "distance_mm should hold the least"),
        ("families.desk.scene.name=dsk", "unknown scene 'dsk'; did you mean 'desk'"),
        ("overlap=[0.5, 0.2]", "rising order"),
        ("overlap=[0.5]", "overlap"),
        ("methods=[{name: thesis}, {name: thesis}]", "names two methods"),
        ("yaw_within=40", "did you mean 'yaw_within_deg'"),
        ("families.desk.pairs=0", "families.desk.pairs"),
    ],
)
def test_wrong_files_are_refused_in_a_line(config: Path, override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        trials_of(config, override)
    assert "\n" not in str(caught.value)


def test_a_missing_peer_is_refused_before_anything_runs(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)  # what Python takes for uninstalled
    with pytest.raises(ConfigError, match=r"methods.0.name: kiss_matcher: .*pip install"):
        trials_of(config, "methods=[{name: kiss_matcher}]")


def test_a_missing_calibration_is_refused(config: Path) -> None:
    with pytest.raises(ConfigError, match=r"methods.0.params.calibration: gone.json is no file"):
        trials_of(config, "methods=[{name: gauss_sphere, params: {calibration: gone.json}}]")


def test_rows_of_another_calibration_are_not_reused(config: Path, tmp_path: Path) -> None:
    file = tmp_path / "own.json"
    codes = []
    for depth_mm in (-65.0, -66.0):
        values = Table(np.array([200.0, 1500.0]), np.array([0.0, 3.0]), np.ones((2, 2)))
        apex_mm = np.array([0.0, 0.0, depth_mm])
        Calibration("incidence", apex_mm, values, values).write(file)
        override = f"methods=[{{name: gauss_sphere, params: {{calibration: {file}}}}}]"
        codes.append(open_session(config, None, [override]).code)
    assert codes[0] != codes[1]


def test_specs_are_frozen(config: Path) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        trials_of(config)[0].spec.seed = 1


def test_the_pairs_stay_those_that_were_drawn_for() -> None:
    study = load_experiment(CONFIGS / "step_profiles.yaml")
    assert isinstance(study, RandomPairsExperiment)
    views = set()
    for profiles in (15, 30):
        scan = study.scan.model_copy(update={"profiles": profiles, "step_mm": 300.0 / profiles})
        changed = study.model_copy(update={"scan": scan, "sweep": None, "study": None})
        trial = build_random_trials(changed, CONFIGS / "step_profiles.yaml")[0]
        spec = full_spec(trial)
        assert (spec.profiles, spec.step_mm) == (profiles, 300.0 / profiles)
        views.add((spec.target, spec.source))
    assert len(views) == 1
