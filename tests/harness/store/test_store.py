from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from harness.scoring import six_parameters
from harness.scoring.poses import COARSE
from harness.scoring.row_scores import within
from harness.session import open_session
from harness.store import FILE_NAME, Row, Store, StoreError, load


def poses(rng: np.random.Generator) -> tuple[RigidTransform, RigidTransform]:
    return tuple(
        RigidTransform.from_components(rng.normal(0.0, 300.0, 3), Rotation.random(rng=rng))
        for _ in range(2)
    )


def example_row(identity: str, seed: int = 0) -> Row:
    rng = np.random.default_rng(seed)
    exact, estimated = poses(rng)
    return Row(
        identity,
        "{}",
        "ok",
        T_exact=exact,
        T_estimated=estimated,
        rotation_error_deg=float(rng.random()),
        translation_error_mm=float(rng.random()),
        overlap_target=0.25,
        overlap_source=0.5,
        covariance=rng.normal(size=(6, 6)),
        undetermined=np.zeros((0, 6)),
        counts={"points_target": 7},
        stage_ms={"rotation": 1.5},
        notes=("one thing", "another"),
    )


def test_a_row_comes_back_bit_for_bit(small_file: Path, tmp_path: Path) -> None:
    trials = open_session(small_file, None).trials
    row = example_row(trials[0].id)
    with Store(tmp_path) as store:
        store.begin(trials)
        store.add(row, "code")
    (record,) = load(tmp_path).to_dict("records")
    np.testing.assert_array_equal(record["T_exact"], row.T_exact.as_matrix())
    np.testing.assert_array_equal(record["T_estimated"], row.T_estimated.as_matrix())
    np.testing.assert_array_equal(record["covariance"], row.covariance)
    assert record["rotation_error_deg"] == row.rotation_error_deg
    assert record["n_points_target"] == 7
    assert record["ms_rotation"] == 1.5
    assert record["notes"] == "one thing\nanother"
    assert (record["pair"], record["method"], record["repeat"]) == ("a.b", "thesis", 0)
    assert record["error_x_mm"] == pytest.approx(
        row.T_estimated.translation[0] - row.T_exact.translation[0]
    )


def test_a_failure_has_no_pose_and_is_no_zero(small_file: Path, tmp_path: Path) -> None:
    trials = open_session(small_file, None).trials
    with Store(tmp_path) as store:
        store.begin(trials)
        store.add(Row(trials[0].id, "{}", "failed", reason="why"), "code")
        store.add(example_row(trials[1].id), "code")
    failed, good = load(tmp_path).to_dict("records")
    assert failed["T_estimated"] is None
    assert np.isnan(failed["rotation_error_deg"])
    assert np.isnan(failed["estimated_x_mm"])
    assert np.isfinite(good["estimated_x_mm"])


def test_a_row_says_where_the_method_stopped(small_file: Path, tmp_path: Path) -> None:
    trials = open_session(small_file, None).trials
    with Store(tmp_path) as store:
        store.begin(trials)
        store.add(Row(trials[0].id, "{}", "failed", reason="why", stage="rotation"), "code")
        store.add(example_row(trials[1].id), "code")
        assert list(load(tmp_path)["stage"]) == ["rotation", ""]
        store.add(example_row(trials[0].id), "other code")
    assert list(load(tmp_path)["stage"]) == ["", ""]


def test_only_rows_of_the_present_configuration_are_loaded(
    small_file: Path, tmp_path: Path
) -> None:
    first, second = (open_session(small_file, None, o).trials for o in ([], ["seed=8"]))
    with Store(tmp_path) as store:
        for trials in (first, second):
            store.begin(trials)
            for trial in trials[:2]:
                store.add(example_row(trial.id), "code")
    assert list(load(tmp_path)["id"]) == [trial.id for trial in second[:2]]
    with Store(tmp_path) as store:
        store.begin(first)
    assert list(load(tmp_path)["id"]) == [trial.id for trial in first[:2]]


def test_rows_of_other_code_and_errors_are_not_finished(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.add(example_row("a"), "old")
        store.add(example_row("b"), "new")
        store.add(replace(example_row("c"), status="error", reason="a bug"), "new")
        assert store.finished("new") == {"b"}
        store.add(example_row("a"), "new")
        assert store.finished("new") == {"a", "b"}


def test_a_store_of_another_version_is_refused_with_the_way_out(tmp_path: Path) -> None:
    with Store(tmp_path):
        pass
    with sqlite3.connect(tmp_path / FILE_NAME) as connection:
        connection.execute("PRAGMA user_version = 99")
    with pytest.raises(StoreError, match=r"version 99 .* --out"):
        Store(tmp_path)


def test_a_file_that_is_no_store_is_refused(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text(
        "these are no rows, but enough text to be read as a header" * 9
    )
    with pytest.raises(StoreError, match="is no store of trials"):
        Store(tmp_path)


def test_a_foreign_database_is_refused(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / FILE_NAME) as connection:
        connection.execute("CREATE TABLE other (x)")
    with pytest.raises(StoreError, match="version 0"):
        Store(tmp_path)


def test_drawings_are_of_one_trial_and_go_with_their_method(
    small_file: Path, tmp_path: Path
) -> None:
    one, other = (open_session(small_file, None, o).trials for o in ([], ["seed=8"]))
    shared, own = tmp_path / "view.ply", tmp_path / "own.png"
    with Store(tmp_path) as store:
        for file in (shared, own):
            file.touch()
        store.note_drawing(one[0], [shared, own])
        store.note_drawing(one[1], [shared])
        assert store.is_drawn(one[0])
        assert not store.is_drawn(other[0])
        store.forget_drawings(one[1:2])
        assert shared.exists()
        assert not own.exists()
        assert not store.is_drawn(one[0])
        shared.unlink()
        assert not store.is_drawn(one[1])


def test_loading_nothing_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="run the experiment first"):
        load(tmp_path)


def test_the_state_tells_what_is_missing_reused_and_of_other_code(
    small_file: Path, tmp_path: Path
) -> None:
    first, second, third = open_session(small_file, None).trials[:3]
    with Store(tmp_path) as store:
        store.begin([first, second, third, first])
        store.add(example_row(first.id), "old")
        store.add(example_row(second.id), "new")
        store.add(replace(example_row(third.id), status="error", reason="a bug"), "new")
        store.add(example_row("of no trial"), "old")
        state = store.state("new")
    assert state.missing.tolist() == [0, 2]
    assert (state.reused, state.held, state.different, state.outdated) == (1, 4, 3, 1)


def test_trials_that_end_alike_keep_what_is_their_own(small_file: Path, tmp_path: Path) -> None:
    trials = open_session(small_file, None).trials
    error = Row(trials[0].id, "{}", "error", reason="a bug", traceback="line 1\nline 2")
    rows = [error, replace(error, id=trials[1].id), example_row(trials[2].id)]
    with Store(tmp_path) as store:
        store.begin(trials[:3])
        store.add_all(reversed(rows), "code")
    loaded = load(tmp_path, specs=True)
    assert list(loaded["id"]) == [row.id for row in rows]
    assert list(loaded["status"]) == ["error", "error", "ok"]
    assert list(loaded["traceback"]) == ["line 1\nline 2"] * 2 + [""]
    assert [pose is None for pose in loaded["T_exact"]] == [True, True, False]
    six = loaded.filter(regex="^exact_").to_numpy()
    np.testing.assert_array_equal(six[2], six_parameters(rows[2].T_exact))
    assert np.isnan(six[:2]).all()
    with sqlite3.connect(tmp_path / FILE_NAME) as connection:
        (alike,) = connection.execute("SELECT count(*) FROM endings").fetchone()
        whole = connection.execute("SELECT id, traceback FROM whole_rows").fetchall()
    assert alike == 2
    assert dict(whole) == {row.id: row.traceback for row in rows}


def test_rows_without_any_registration_have_its_time_too(small_file: Path, tmp_path: Path) -> None:
    trials = open_session(small_file, None).trials
    with Store(tmp_path) as store:
        store.begin(trials)
        assert list(load(tmp_path)["ms_registration"]) == []
        store.add(Row(trials[0].id, "{}", "no_overlap", stage_ms={"scan": 1.0}), "code")
    (record,) = load(tmp_path).to_dict("records")
    assert np.isnan(record["ms_registration"])
    assert record["ms_scan"] == 1.0


def test_a_row_is_right_where_tables_count_it_so(small_file: Path, tmp_path: Path) -> None:
    trials = open_session(small_file, None).trials
    ok = replace(example_row(trials[0].id), rotation_error_deg=5.0, translation_error_mm=30.0)
    rows = [
        ok,
        replace(ok, id=trials[1].id, translation_error_mm=30.1),
        replace(ok, id=trials[2].id, status="ambiguous"),
        Row(trials[3].id, "{}", "failed"),
    ]
    with Store(tmp_path) as store:
        store.begin(trials)
        store.add_all(rows, "code")
    assert [row.right for row in rows] == [True, False, False, False]
    assert within(load(tmp_path), COARSE).tolist() == [True, False, False, False]
