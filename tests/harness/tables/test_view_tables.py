from __future__ import annotations

from pathlib import Path

import numpy as np
from shipped_configs import CONFIGS

from harness.config.reading import load_experiment
from harness.session import open_session
from harness.store import Row, Store, load
from harness.tables.views import compaction_table

FOAM = CONFIGS / "foam.yaml"
TWICE = ["methods=[{name: thesis}, {name: gauss_sphere}]", "repeats=2"]


def test_views_are_compacted_beside_what_the_thesis_counted(tmp_path: Path) -> None:
    session = open_session(FOAM, tmp_path, TWICE)
    with Store(tmp_path) as store:
        store.begin(session.trials)
        for trial in session.trials:
            counts = {"points_target": 8000, "points_source": 9000}
            if trial.label == "thesis":
                more = 10 * trial.spec.repeat
                counts |= {
                    "segments_target": 200, "segments_source": 300,
                    "patches_target": 30 + more, "patches_source": 40 + more,
                    "normals_target": 9, "normals_source": 11,
                }  # fmt: skip
            store.add(Row(trial.id, "{}", "failed", reason="why", counts=counts), "code")
    table = compaction_table(load_experiment(FOAM, TWICE), load(tmp_path))
    assert table is not None
    assert table.text() == [
        ["right", "thesis", "2", "8000", "200", "35", "9"],
        ["right", "the thesis's own", "1", "5280", "", "32", "9"],
        ["left", "thesis", "2", "9000", "300", "45", "11"],
        ["left", "the thesis's own", "1", "5280", "", "46", "10"],
    ]


def test_without_patches_there_is_no_table(tmp_path: Path) -> None:
    session = open_session(FOAM, tmp_path, TWICE)
    with Store(tmp_path) as store:
        store.begin(session.trials)
        for trial in session.trials:
            store.add(Row(trial.id, "{}", "failed", reason="why"), "code")
    assert compaction_table(load_experiment(FOAM, TWICE), load(tmp_path)) is None


def test_a_view_that_two_pairs_share_counts_once_for_each_scan(tmp_path: Path) -> None:
    file = FOAM.with_name("desk_virtual.yaml")
    overrides = ["methods=[{name: thesis}]", "repeats=3", "arm=null"]
    session = open_session(file, tmp_path, overrides)
    with Store(tmp_path) as store:
        store.begin(session.trials)
        for trial in session.trials:
            counts = {f"patches_{role}": 7 for role in ("target", "source")}
            store.add(Row(trial.id, "{}", "failed", reason="why", counts=counts), "code")
    table = compaction_table(load_experiment(file, overrides), load(tmp_path))
    assert table is not None
    ours = table.frame[table.frame["Method"] == "thesis"]
    np.testing.assert_array_equal(ours["Scans"], 3)
    assert list(ours["View"]) == ["center", "left", "right"]
