from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.config.errors import ConfigError
from harness.config.reading import validated
from harness.config.resolved import resolved_config
from harness.config.sweep_schema import Sweep
from harness.session import open_session
from harness.store import Row, Store, load
from harness.tables.sweeps import sweep_table
from harness.trials.points import Point, point_count, short_names, sweep_points, unit_design
from sensors.noise import NoiseParams

NOISE = "sensor.params.noise.sigma_far_mm"
WARP = "methods.thesis.params.segments.warp_mm"


def sweep_of(text: str) -> Sweep:
    return validated(Sweep, yaml.safe_load(text), "file", ("sweep",))


def points_of(text: str) -> list[Point]:
    sweep = sweep_of(text)
    points = list(sweep_points(sweep))
    assert len(points) == point_count(sweep)
    assert [point.number for point in points] == list(range(len(points)))
    return points


def swept(file: Path, sweep: str, *overrides: str):
    return open_session(file, file.parent / "out", ["repeats=1", *overrides, f"sweep={sweep}"])


@given(
    st.lists(st.lists(st.integers(0, 9), min_size=1, max_size=4), min_size=1, max_size=3),
)
def test_a_product_is_every_combination_once(lists: list[list[int]]) -> None:
    over = {f"k{i}": values for i, values in enumerate(lists)}
    points = points_of(yaml.safe_dump({"over": over}))
    assert [tuple(p.values.values()) for p in points] == list(itertools.product(*lists))


def test_zip_pairs_values_and_refuses_unequal_lengths() -> None:
    points = points_of("{design: zip, over: {a: [1, 2], b: {from: 1, to: 100, count: 2}}}")
    assert [p.values for p in points] == [{"a": 1, "b": 1}, {"a": 2, "b": 100}]
    with pytest.raises(ValueError, match="a has 2, b has 1"):
        list(sweep_points(sweep_of("{design: zip, over: {a: [1, 2], b: [3]}}")))


def test_one_at_a_time_begins_with_the_experiment_itself() -> None:
    points = points_of("{design: one_at_a_time, over: {a: [1, 2], b: [3]}}")
    assert [(p.varied, p.values) for p in points] == [
        ("", {}), ("a", {"a": 1}), ("a", {"a": 2}), ("b", {"b": 3}),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("{from: 0, to: 0.3, count: 4}", [0.0, 0.1, 0.2, 0.3]),
        ("{from: 20, to: 80, count: 4}", [20, 40, 60, 80]),
        ("{from: 1, to: 1000, count: 4, scale: log}", [1, 10, 100, 1000]),
        ("{from: 1, to: 4, count: 7, integers: true}", [1, 2, 3, 4]),
        ("{named: {none: {enabled: false}, all: {}}}", [{"enabled": False}, {}]),
    ],
)
def test_lists_of_values(text: str, values: list[Any]) -> None:
    points = points_of(f"over: {{a: {text}}}")
    found = [point.values["a"] for point in points]
    assert found == values
    assert [type(value) for value in found] == [type(value) for value in values]


def test_named_values_are_shown_by_their_names() -> None:
    points = points_of("over: {a: {named: {x: {k: 1}}}, b: [[0.2, 0.4]]}")
    assert points[0].shown == {"a": "x", "b": "[0.2, 0.4]"}


DRAWN = """\
design: {design}
samples: 64
over:
  a: {{distribution: uniform, from: -1, to: 3}}
  b: {{distribution: log_uniform, from: 0.01, to: 100}}
  c: {{distribution: integers, from: 1, to: 4}}
  d: {{distribution: normal, mean: 5, deviation: 2, from: 1, to: 9}}
  e: [x, y]
"""


@pytest.mark.parametrize("design", ["latin_hypercube", "sobol", "saltelli", "morris"])
def test_drawn_values_follow_their_distributions(design: str) -> None:
    points = points_of(DRAWN.format(design=design))
    a, b, c, d = (np.array([p.values[key] for p in points]) for key in "abcd")
    assert a.min() >= -1.0
    assert a.max() <= 3.0
    assert a.mean() == pytest.approx(1.0, abs=0.3)
    assert np.log10(b).mean() == pytest.approx(0.0, abs=0.4)
    assert set(c.tolist()) == {1, 2, 3, 4}
    assert all(isinstance(p.values["c"], int) for p in points)
    assert d.mean() == pytest.approx(5.0, abs=0.5)
    assert (d >= 1.0).all()
    assert (d <= 9.0).all()
    share = np.mean([p.values["e"] == "x" for p in points])
    assert share == pytest.approx(0.5, abs=0.15)
    assert [p.values for p in points_of(DRAWN.format(design=design))] == [p.values for p in points]
    other = points_of(DRAWN.format(design=design) + "seed: 1\n")
    assert [p.values for p in other] != [p.values for p in points]


def test_a_latin_hypercube_meets_every_stratum_once() -> None:
    design = unit_design(sweep_of(DRAWN.format(design="latin_hypercube")))
    for column in design.T:
        assert sorted((column * 64).astype(int)) == list(range(64))


def test_saltelli_changes_one_column_at_a_time() -> None:
    design = unit_design(sweep_of(DRAWN.format(design="saltelli"))).reshape(64, 7, 5)
    for block in design:
        for k in range(5):
            assert (block[k + 1] != block[0]).nonzero()[0].tolist() == [k]


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
    desk = Path(__file__).parents[3] / "configs" / "desk.yaml"
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
    file = Path(__file__).parents[3] / "configs" / "random_pairs.yaml"
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


@given(st.data())
@settings(max_examples=25)
def test_kept_texts_are_the_canonical_ones(data: st.DataObject) -> None:
    """Ids are hashes of texts put together from kept pieces; they are those of the whole."""
    from harness.config.choices import Chosen, canonical_json
    from harness.config.schema import AimedView
    from harness.trials.specs import TrialSpec
    from harness.trials.views import PoseStep, ViewSpec

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


def test_names_are_as_short_as_tells_them_apart() -> None:
    keys = ["a.x.w", "a.y.w", "scan.step_mm"]
    assert short_names(keys) == {"a.x.w": "x.w", "a.y.w": "y.w", "scan.step_mm": "step_mm"}
    keys = ["scene.name", "arm.bracket_deg.0", "arm.bracket_deg.1"]
    names = ["scene.name", "bracket_deg.0", "bracket_deg.1"]
    assert list(short_names(keys).values()) == names
    point = Point(0, "", {}, {"left.yaw_deg": 1, "right.yaw_deg": 2.00001, "scene.name": "desk"})
    assert str(point) == "left.yaw_deg 1, right.yaw_deg 2, scene.name desk"
