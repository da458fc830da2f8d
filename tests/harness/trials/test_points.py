"""The points of a sweep: what each design makes of lists, ranges and distributions."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from harness.config.reading import validated
from harness.config.sweep_schema import Sweep
from harness.trials.points import Point, point_count, short_names, sweep_points, unit_design


def sweep_of(text: str) -> Sweep:
    return validated(Sweep, yaml.safe_load(text), "file", ("sweep",))


def points_of(text: str) -> list[Point]:
    sweep = sweep_of(text)
    points = list(sweep_points(sweep))
    assert len(points) == point_count(sweep)
    assert [point.number for point in points] == list(range(len(points)))
    return points


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


def test_names_are_as_short_as_tells_them_apart() -> None:
    keys = ["a.x.w", "a.y.w", "scan.step_mm"]
    assert short_names(keys) == {"a.x.w": "x.w", "a.y.w": "y.w", "scan.step_mm": "step_mm"}
    keys = ["scene.name", "arm.bracket_deg.0", "arm.bracket_deg.1"]
    names = ["scene.name", "bracket_deg.0", "bracket_deg.1"]
    assert list(short_names(keys).values()) == names
    point = Point(0, "", {}, {"left.yaw_deg": 1, "right.yaw_deg": 2.00001, "scene.name": "desk"})
    assert str(point) == "left.yaw_deg 1, right.yaw_deg 2, scene.name desk"
