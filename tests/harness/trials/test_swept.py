from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from shipped_configs import CONFIGS

from harness.config.errors import ConfigError
from harness.config.resolved import resolved_config
from harness.session import open_session
from harness.store import Row, Store, load
from harness.tables.sweeps import sweep_table
from harness.trials.points import sweep_points

NOISE = "sensor.params.noise.sigma_far_mm"
WARP = "methods.thesis.params.segments.warp_mm"


def swept(file: Path, sweep: str, *overrides: str):
    return open_session(file, file.parent / "out", ["repeats=1", *overrides, f"sweep={sweep}"])


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        ("{over: {}}", "sweep.over: needs at least 1 entry"),
        ("{over: {scan.step_mm: 3}}", "sweep.over.scan.step_mm: should be a list, not 3"),
        ("{over: {scan.step_mm: [3, -1]}}",
         "sweep.over: point 1 (scan.step_mm=-1): scan.step_mm: should be greater than 0, not -1"),
        (f"{{over: {{{WARP}: [3, yes]}}}}", f"point 1 ({WARP}=True): methods.0.params.segments"),
        ("{over: {scan.stp_mm: [3]}}", "scan.stp_mm: unknown key; did you mean 'step_mm'?"),
        ("{over: {methods.thesi.params.x: [3]}}", "did you mean 'thesis'?"),
        ("{over: {methods.3.params.x: [3]}}", "'3' is no index from 0 to 0"),
        ("{over: {scene.name: [desk, dsk]}}", "unknown scene 'dsk'; did you mean 'desk'?"),
        ("{over: {title: [a]}}", "'title' cannot be swept"),
        ("{design: sobol, samples: 3, over: {seed: [1]}}", "should be a power of two, not 3"),
        ("{design: sobol, over: {seed: [1]}}", "design sobol needs `samples`"),
        ("{samples: 3, over: {seed: [1]}}", "`samples` says nothing to design product"),
        ("{design: zip, over: {seed: [1], repeats: [1, 2]}}", "as many values of every key"),
        ("{over: {seed: {from: 1, to: 2}}}", "sweep.over.seed.count: is missing"),
        ("{over: {seed: {from: 0, to: 2, count: 2, scale: log}}}", "should lie above 0"),
        ("{over: {seed: {distribution: uniform, from: 0, to: 2}}}", "not a distribution"),
        ("{design: sobol, samples: 2, over: {seed: {from: 0, to: 2, count: 2}}}",
         "not a range with a count"),
        ("{over: {seed: {from: 0, to: 1000000, count: 1000000}, scan.step_mm: [1, 2]}}",
         "makes 2000000 points"),
        ("{design: morris, samples: 2, levels: 3, over: {seed: [1]}}", "should be even, not 3"),
        ("{over: {methods.0.params.x: [1], methods.thesis.params.x: [2]}}",
         "methods.thesis.params.x: sets again what methods.0.params.x has set"),
        ("{over: {scan.step_mm: [1], scan: [{profiles: 3, step_mm: 2}]}}",
         "scan: sets again what scan.step_mm has set"),
        ("{over: {arm: [null, {track_mm: 9000}]}}", "the track runs from 0 to 2600 mm"),
    ],
)  # fmt: skip
def test_a_wrong_sweep_gets_one_line(small_file: Path, sweep: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        swept(small_file, sweep)
    assert str(caught.value).startswith(f"{small_file}: sweep")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


ANYTHING = {
    WARP: "[3, 5]",
    "methods.0.params.patches.triplets": "[carried]",
    "methods": "[[{name: gauss_sphere}]]",
    "methods.thesis.preset": "[literal]",
    "methods.thesis.name": "[gauss_sphere]",
    "sensor.params.pixels": "[512]",
    NOISE: "[0.7, 0.9]",
    "sensor.params.noise": "{named: {exact: {enabled: false}}}",
    "scene.name": "[desk]",
    "scene": "[{name: desk}]",
    "scan.step_mm": "[4]",
    "scan.profiles": "[40]",
    "arm": "[null]",
    "views.left.yaw_deg": "[-9]",
    "pairs.a.b.printed.rotation_deg": "[[1, 2, 13]]",
    "seed": "[4, 5]",
    "repeats": "[3]",
}


@pytest.mark.parametrize("key", ANYTHING)
def test_a_point_is_the_experiment_with_these_keys_set(small_file: Path, key: str) -> None:
    """Whatever is kept while building, the trials are those that --set would give."""
    sweep = f"{{over: {{{key}: {ANYTHING[key]}, views.left.pitch_deg: [10, 11]}}}}"
    session = swept(small_file, sweep)
    found = [(trial.id, trial.pair, trial.label) for trial in session.trials]
    expected = []
    for point in sweep_points(session.experiment.sweep):
        overrides = [f"{k}={yaml.safe_dump(v, default_flow_style=True)}".removesuffix("...\n")
                     for k, v in point.values.items()]  # fmt: skip
        alone = open_session(small_file, None, ["repeats=1", *overrides])
        expected += [(trial.id, trial.pair, trial.label) for trial in alone.trials]
    assert found == expected
    assert len({identity for identity, *_ in found}) == len(found)
    written = small_file.parent / "config.yaml"
    data = resolved_config(session.experiment, session.base)
    written.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    again = open_session(written, None)
    assert [(trial.id, trial.pair, trial.label) for trial in again.trials] == found


def test_the_bracket_of_the_arm_is_swept_too(tmp_path: Path) -> None:
    desk = CONFIGS / "desk.yaml"
    small = ["repeats=1", "methods=[{name: thesis}]", "scan.profiles=24"]
    sweep = "sweep={over: {arm.bracket_deg: [[0, 0, 0], [0.4, 0, 0]]}}"
    trials = open_session(desk, tmp_path, [*small, sweep]).trials
    alone = open_session(desk, tmp_path, [*small, "arm.bracket_deg=[0.4, 0, 0]"]).trials
    assert [trial.id for trial in trials[2:]] == [trial.id for trial in alone]


def test_points_that_differ_in_the_method_alone_see_the_same_scans(small_file: Path) -> None:
    session = swept(small_file, f"{{over: {{{WARP}: [3, 4, 5], {NOISE}: [0.7, 0.8]}}}}")
    keys = {
        (trial.point.values[NOISE], trial.pair, trial.spec.view_key(trial.spec.target))
        for trial in session.trials
    }
    assert len(keys) == 4  # two levels of noise, two pairs
    more = swept(small_file, f"{{over: {{{WARP}: [3, 3.5, 4, 5], {NOISE}: [0.6, 0.7, 0.8]}}}}")
    assert {trial.id for trial in session.trials} < {trial.id for trial in more.trials}


def test_what_is_never_built_twice_is_shared(small_file: Path) -> None:
    session = swept(small_file, f"{{over: {{{WARP}: {{from: 1, to: 9, count: 200}}}}}}")
    assert len({id(trial.spec.sensor) for trial in session.trials}) == 1
    assert len({id(trial.spec.target) for trial in session.trials}) == 2  # one a pair


def test_rows_carry_their_point(small_file: Path, tmp_path: Path) -> None:
    noise = "sensor.params.noise: {named: {exact: {enabled: false}}}"
    session = swept(small_file, f"{{design: one_at_a_time, over: {{{WARP}: [4, 5], {noise}}}}}")
    with Store(tmp_path) as store:
        store.begin(session.trials)
        store.add_all(
            [Row(identity, "{}", "failed") for identity in {t.id for t in session.trials}], "code"
        )
    rows = load(str(tmp_path))
    # The default, 4, is the experiment itself: one trial, at both points.
    assert len(rows) == len(session.trials) == 8
    assert rows["id"].nunique() == 6
    assert rows["sweep.point"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert rows["sweep.varied"].tolist()[::2] == ["", WARP, WARP, "sensor.params.noise"]
    assert rows[f"sweep.{WARP}"].tolist()[::2] == [4.0, 4.0, 5.0, 4.0]
    assert rows["sweep.sensor.params.noise"].iloc[6] == "exact"
    assert rows["sweep.sensor.params.noise"].iloc[0] == "as it is"
    table = sweep_table(rows)
    assert table.text()[2][1] == "5"
    assert table.frame["Trials"].tolist() == [2, 2, 2, 2]
    with Store(tmp_path) as store:
        store.begin(session.base)
    assert not [name for name in load(tmp_path).columns if name.startswith("sweep.")]


def test_what_stays_as_it_is_goes_by_the_name_of_its_value(small_file: Path) -> None:
    scans = "scan: {named: {few: {profiles: 20, step_mm: 12}, own: {profiles: 48, step_mm: 5.0}}}"
    session = swept(
        small_file, f"{{design: one_at_a_time, over: {{{scans}, scene: [{{name: desk}}]}}}}"
    )
    first = session.trials[0].point
    assert first is not None
    assert first.shown == {"scan": "own", "scene": "as it is"}


def test_random_pairs_are_swept_too(tmp_path: Path) -> None:
    file = CONFIGS / "random_pairs.yaml"
    small = ["methods=[{name: thesis}]", "families.foam_chair.pairs=1", "families.desk.pairs=2",
             "families.clutter.pairs=1"]  # fmt: skip
    sweep = f"sweep={{over: {{overlap: [[0.2, 0.4], [0.4, 0.6]], {NOISE}: [1.5, 2.0]}}}}"
    session = open_session(file, tmp_path, [*small, sweep])
    assert len(session.trials) == len({trial.id for trial in session.trials}) == 4 * 4
    first, second = (
        [trial for trial in session.trials if trial.point.number == number] for number in (0, 1)
    )
    # The same pairs of views whatever the noise; and what --set gives.
    assert [t.spec.pair_key() for t in first] == [t.spec.pair_key() for t in second]
    assert [t.id for t in first] == [
        t.id for t in open_session(file, None, [*small, "overlap=[0.2, 0.4]"]).trials
    ]
