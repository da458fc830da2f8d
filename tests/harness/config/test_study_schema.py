"""Which sweeps a study can make something of, and which keys go along."""

from __future__ import annotations

from typing import Any

import pytest

from harness.config.errors import ConfigError
from harness.config.reading import validated
from harness.config.study_schema import Study
from harness.config.sweep_schema import Sweep


@pytest.mark.parametrize(
    ("kind", "names", "sweep", "message"),
    [
        ("curves", {}, None, "needs a sweep of design one_at_a_time, there is none"),
        ("indices", {}, {"over": {"a": [1]}}, "needs a sweep of design saltelli, not product"),
        (
            "indices",
            {},
            {
                "design": "saltelli",
                "samples": 2,
                "over": {"a": {"distribution": "uniform", "from": 0, "to": 1}},
            },
            "sweeps two keys or more",
        ),
        ("overlap", {}, {"over": {"a": [1]}}, "has no sweep; take `sweep` out"),
        ("ranking", {"a": "b"}, None, "`names` says nothing"),
        ("effects", {}, {"over": {"a": [1], "b": [1]}}, "sweeps one key, not 2"),
        ("effects", {"b": "B"}, {"over": {"a": [1]}}, "`names` has b, which is not swept"),
        ("grid", {}, {"over": {"a": [1]}}, "sweeps scan.profiles and scan.step_mm"),
        (
            "grid",
            {},
            {"over": {"scan.profiles": [8], "scan.step_mm": {"named": {"a": 1}}}},
            "needs numbers of scan.step_mm, not names",
        ),
        (
            "curves",
            {},
            {"design": "one_at_a_time", "over": {"a": [1, "b"]}},
            "needs numbers, or names that are, of a, not 'b'",
        ),
        (
            "curves",
            {},
            {"design": "one_at_a_time", "over": {"a": {"named": {"5": 1, "b": 2}}}},
            "needs numbers, or names that are, of a, not 'b'",
        ),
        ("effects", {}, {"over": {"a": {"named": {"only x": 1}}}}, "'all' among them"),
        ("effects", {}, {"over": {"a": {"named": {"all": 1, "no x": 2}}}}, "'twice X', not 'no x'"),
        ("effects", {}, {"over": {"a": [1, 2]}}, "needs values of a named 'none', 'all'"),
    ],
)
def test_a_study_needs_its_sweep(
    kind: str, names: dict[str, str], sweep: dict[str, Any] | None, message: str
) -> None:
    study: Study = validated(Study, {"kind": kind, "names": names}, "file")
    made = None if sweep is None else validated(Sweep, sweep, "file")
    with pytest.raises(ValueError, match=message):
        study.check(made)


def test_keys_that_go_along() -> None:
    data = {"over": {"a": [1, 2]}, "along": {"b": ["c"]}}
    with pytest.raises(ConfigError, match="`along` names b, which is not swept"):
        validated(Sweep, data, "file")
    with pytest.raises(ConfigError, match="a is swept twice"):
        validated(Sweep, data | {"along": {"a": ["a"]}}, "file")
