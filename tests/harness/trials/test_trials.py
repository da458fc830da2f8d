from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_configs import CONFIGS, OF_TRIALS

from harness.config.choices import Chosen, canonical_json
from harness.config.errors import ConfigError
from harness.config.reading import load_experiment
from harness.config.resolved import resolved_config
from harness.config.schema import AimedView
from harness.session import open_session
from harness.trials.specs import TrialSpec, build_trials
from harness.trials.views import PoseStep, ViewSpec
from sensors.noise import NoiseParams


def trials_of(file: Path, *overrides: str):
    return build_trials(load_experiment(file, overrides), file)


def test_ids_are_the_same_in_every_process(small_file: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from harness.session import open_session\n"
        "print(*[t.id for t in open_session(Path(sys.argv[1]), None).trials])"
    )
    command = [sys.executable, "-c", script, str(small_file)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, cwd=CONFIGS.parent)
    assert answer.stdout.split() == [trial.id for trial in trials_of(small_file)]


def test_every_coordinate_changes_the_id_and_names_do_not(small_file: Path) -> None:
    ids = {trial.id for trial in trials_of(small_file)}
    assert len(ids) == 4
    for override in (
        "seed=4", "scan.profiles=47", "scan.step_mm=5.5", "views.left.yaw_deg=-8.5",
        "sensor.params.noise.gaussian=false", "methods.0.params.segments.warp_mm=4.5",
        "scene.name=desk",
    ):  # fmt: skip
        assert ids.isdisjoint(trial.id for trial in trials_of(small_file, override)), override
    assert ids == {trial.id for trial in trials_of(small_file, "methods.0.label=x", "title=y")}
    assert ids < {trial.id for trial in trials_of(small_file, "repeats=3")}


def test_a_default_written_out_is_the_same_trial(small_file: Path) -> None:
    written = trials_of(
        small_file, "methods.0.params.segments.warp_mm=4", "sensor.params.pixels=256"
    )
    assert [t.id for t in written] == [t.id for t in trials_of(small_file)]


def test_every_method_sees_the_same_scans(small_file: Path) -> None:
    spec = trials_of(small_file)[0].spec
    other = replace(spec, method=Chosen("icp", {"any": 1}), given="patches")
    assert other.id != spec.id
    assert other.view_key(other.target) == spec.view_key(spec.target)
    draws = [s.view_rng(s.target).standard_normal(3) for s in (spec, other)]
    np.testing.assert_array_equal(*draws)


def test_a_view_is_scanned_alike_in_both_of_its_pairs_and_anew_in_each_repeat(
    small_file: Path,
) -> None:
    first, second, again, _ = (trial.spec for trial in trials_of(small_file))
    assert first.source == second.target
    assert first.view_key(first.source) == second.view_key(second.target)
    keys = [first.view_key(first.source), again.view_key(again.source),
            first.view_key(first.target)]  # fmt: skip
    assert len(set(keys)) == 3
    assert len({float(s.view_rng(s.source).random()) for s in (first, again)}) == 2


@pytest.mark.parametrize("file", OF_TRIALS, ids=lambda file: file.stem)
def test_the_resolved_configuration_makes_the_same_trials(file: Path, tmp_path: Path) -> None:
    session = open_session(file, tmp_path)
    written = tmp_path / "config.yaml"
    data = resolved_config(session.experiment, session.base)
    written.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    again = open_session(written, tmp_path)
    assert [(t.id, t.pair, t.label) for t in again.trials] == [
        (t.id, t.pair, t.label) for t in session.trials
    ]


def test_a_preset_can_be_refined(small_file: Path) -> None:
    (trial, *_) = trials_of(
        small_file, "methods.0.preset=literal", "methods.0.params.merge.rotation_th_rad=0.03"
    )
    assert trial.spec.method.params.segments.seed == "first_points"
    assert trial.spec.method.params.merge.rotation_th_rad == 0.03


def test_truth_is_entered_once_where_it_holds_no_noise(small_file: Path) -> None:
    trials = trials_of(small_file, "methods.0.given=[patches, rotation]")
    entered = [(t.spec.given, t.spec.repeat) for t in trials if t.pair == "plain"]
    assert entered == [("", 0), ("patches", 0), ("rotation", 0), ("", 1), ("rotation", 1)]
    assert json.loads(json.dumps([t.id for t in trials])) == list(
        dict.fromkeys(t.id for t in trials)
    )


def test_a_calibration_lies_beside_its_config_or_below_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    desk = (CONFIGS / "desk.yaml").read_text(encoding="utf-8")
    (tmp_path / "bench").mkdir()
    config = tmp_path / "bench" / "desk.yaml"
    config.write_text(desk, encoding="utf-8")
    override = "methods=[{name: gauss_sphere, params: {calibration: sensor.json}}]"
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"methods\.0\.params\.calibration: sensor\.json is no"):
        trials_of(config, override)
    measured = (CONFIGS / "calibration" / "jupiter.json").read_bytes()

    def found() -> str:
        params = trials_of(config, override)[0].spec.method.params
        return str(params.calibration)

    (tmp_path / "sensor.json").write_bytes(measured)
    assert found() == "sensor.json"
    beside = tmp_path / "bench" / "sensor.json"
    beside.write_bytes(measured)
    # Told from where the command is started: no trial's id holds a path of this machine.
    assert found() == "bench/sensor.json"
    monkeypatch.chdir(tmp_path / "bench")
    assert found() == "sensor.json"


def test_shipped_configs_find_their_calibration_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = CONFIGS / "ablation.yaml"
    paths = {
        getattr(trial.spec.method.params, "calibration", "")
        for trial in open_session(file, tmp_path / "out").trials
    }
    assert paths
    assert all(Path(path).is_file() for path in paths if path)


@given(st.data())
@settings(max_examples=25)
def test_kept_texts_are_the_canonical_ones(data: st.DataObject) -> None:
    """Ids are hashes of texts put together from kept pieces; they are those of the whole."""
    numbers = st.floats(-1e6, 1e6)
    vectors = st.tuples(numbers, numbers, numbers)
    aim = AimedView(aim_mm=data.draw(vectors), distance_mm=700.0, yaw_deg=3.5)
    view = ViewSpec(
        data.draw(st.text()), aim, (PoseStep(data.draw(vectors), (0.0, 1.0, 2.0), True),)
    )
    chosen = Chosen(data.draw(st.text()), {"x": data.draw(numbers), "ä": [1, None, 'q"']})
    spec = TrialSpec(chosen, Chosen("jupiter", NoiseParams()), 40, data.draw(st.floats(1e-9, 1e9)),
                     view, view, chosen, "", 3, data.draw(st.integers(0, 2**60)))  # fmt: skip
    assert spec.text == canonical_json(spec)
    assert spec.place_key(view) == canonical_json(
        [spec.scene, spec.sensor, spec.profiles, spec.step_mm, view]
    )
