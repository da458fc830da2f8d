from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from experiments.cli import main
from experiments.profile_figures import telling_pair
from experiments.profile_losses import kind_of, loss_table
from experiments.profile_means import MOTION, mean_motion, middle, outliers
from experiments.profile_pairs import (
    kept_rows,
    load_profiles,
    measure,
    one_profile,
    register_profiles,
    run_profiles,
)
from experiments.profile_tables import profile_tables
from harness.config.errors import ConfigError
from harness.scoring import six_parameters
from harness.trials.specs import TrialSpec
from harness.workers.pool import process_pool
from registration import Scan
from registration.methods import find_method
from sensors.arm import ArmPath

CONFIG = Path(__file__).parents[2] / "configs" / "foam_2d.yaml"
EXACT = "sensor.params={noise: {enabled: false}}"
NO_ARM = "arm=null"


@pytest.fixture(scope="module")
def exact_rows() -> pd.DataFrame:
    _, trials = load_profiles(CONFIG, [EXACT, NO_ARM, "repeats=1"])
    return measure(trials)


def test_exact_profiles_give_the_pose_of_the_views(exact_rows: pd.DataFrame) -> None:
    exact = exact_rows[[f"exact_{name}" for name in MOTION]].to_numpy()
    np.testing.assert_allclose(exact, np.tile([-58.40, -458.2, 383.2], (len(exact), 1)), atol=1e-9)
    found = exact_rows[exact_rows["method"] == "planar"].dropna(subset=["rotation_error_deg"])
    assert len(found) >= 22
    # WARP lets lines run past their corners, which turns them a little even without noise.
    assert found["rotation_error_deg"].max() < 1.0
    assert found["translation_error_mm"].max() < 7.0


def test_a_pair_without_an_answer_says_why(exact_rows: pd.DataFrame) -> None:
    open_ = exact_rows[exact_rows["rotation_x_deg"].isna()]
    assert len(open_)
    assert (open_["status"] != "ok").all()
    assert (open_["reason"].str.len() > 20).all()
    assert not open_["outlier"].any()


def test_the_elevations_are_equal_steps_along_the_vertical(exact_rows: pd.DataFrame) -> None:
    heights = exact_rows["elevation_mm"].to_numpy()[:44]
    np.testing.assert_allclose(np.diff(heights), 5.0)
    assert heights[0] == pytest.approx(115.0 - 0.5 * 43 * 5.0)


def test_rows_are_the_same_in_every_run_and_by_any_number_of_processes() -> None:
    _, trials = load_profiles(CONFIG, ["scan.profiles=5", "repeats=2"])
    first, second = (measure(trials, how).drop(columns="ms") for how in (None, process_pool(2)))
    pd.testing.assert_frame_equal(first, second)


def test_the_arm_carries_both_views_unless_told_otherwise() -> None:
    _, trials = load_profiles(CONFIG, ["repeats=1", "scan.profiles=3"])
    spec = trials[0].spec
    assert isinstance(spec, TrialSpec)
    target, source = spec.path(spec.target), spec.path(spec.source)
    assert isinstance(target, ArmPath)
    assert isinstance(source, ArmPath)
    exact = target.T_world_profile.inv() * source.T_world_profile
    found = [pair.exact for pair in register_profiles(trials[0])]
    for k, pose in enumerate(found):
        np.testing.assert_allclose(pose.as_matrix(), exact[k].as_matrix(), atol=1e-9)
    # The bracket separates the exact pose from the one that was asked for.
    asked = six_parameters(found[0])[[0, 4, 5]] - [-58.40, -458.2, 383.2]
    assert 1.0 < np.linalg.norm(asked[1:]) < 10.0
    with pytest.raises(ConfigError, match="joint 2 would have to turn to"):
        load_profiles(CONFIG, ["arm.base_mm=[-1050, -1300, 125]"])


def test_outliers_are_far_from_the_median_in_any_parameter() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal([-58.0, -450.0, 380.0], [0.3, 2.0, 2.0], (40, 3)).clip(-460.0, 390.0)
    values[5, 0] += 5.0
    values[6, 2] -= 30.0
    values[7] = np.nan
    far = set(np.flatnonzero(outliers(values)))
    assert {5, 6} <= far
    assert 7 not in far
    assert len(far) < 5
    assert not outliers(np.full((3, 3), np.nan)).any()
    assert not outliers(np.zeros((4, 3)) + 1e-9 * np.arange(4)[:, None]).any()


@pytest.mark.parametrize("turn", [0.0, 90.0, 179.0])
def test_outliers_and_mean_do_not_mind_where_angles_are_cut(turn: float) -> None:
    rng = np.random.default_rng(8)
    values = np.column_stack([rng.normal(0.0, 1.0, 31), rng.normal(0.0, 1.0, (31, 2))])
    values[4, 0] = 60.0
    moved = values.copy()
    moved[:, 0] = np.mod(values[:, 0] + turn + 180.0, 360.0) - 180.0
    far = outliers(values)
    np.testing.assert_array_equal(outliers(moved), far)
    apart = (middle(moved) - middle(values) - [turn, 0.0, 0.0])[0]
    assert np.mod(apart + 180.0, 360.0) - 180.0 == pytest.approx(0.0, abs=1e-9)
    means = [
        mean_motion(pd.DataFrame(v, columns=list(MOTION)).assign(outlier=far))
        for v in (values, moved)
    ]
    assert means[0][0] == pytest.approx(values[~far, 0].mean())
    apart = means[1][0] - means[0][0] - turn
    assert np.mod(apart + 180.0, 360.0) - 180.0 == pytest.approx(0.0, abs=1e-9)


def test_one_profile_lies_in_its_own_frame() -> None:
    points = np.random.default_rng(0).normal(size=(4, 7, 3))
    points[..., 0] = 5.0 * np.arange(4)[:, None]
    cut = one_profile(Scan.from_points(points, 5.0, intensity=points[..., 1]), 2)
    np.testing.assert_array_equal(cut.points_mm[0, :, 1:], points[2, :, 1:])
    np.testing.assert_array_equal(cut.points_mm[..., 0], 0.0)
    np.testing.assert_array_equal(cut.intensity[0], points[2, :, 1])


def test_the_mean_stands_beside_the_thesis(exact_rows: pd.DataFrame) -> None:
    experiment, _ = load_profiles(CONFIG, ["repeats=1"])
    means, left_out = profile_tables(experiment, exact_rows)
    frame = means.frame.set_index("Source")
    thesis = frame.loc["thesis, experiment"]
    np.testing.assert_allclose(
        thesis[["Rotation error (deg)", "Y error (mm)", "Z error (mm)"]].astype(float),
        [-0.55, 4.4, 0.4],
    )
    assert thesis["In the mean"] == "42 of 44"
    of_planar = exact_rows[exact_rows["method"] == "planar"]
    assert frame.loc["planar", "Rotation X (deg)"] == pytest.approx(mean_motion(of_planar)[0])
    used = int((of_planar["rotation_x_deg"].notna() & ~of_planar["outlier"]).sum())
    assert frame.loc["planar", "In the mean"] == f"{used} of 44"
    assert left_out.frame.loc[left_out.frame["Method"] == "planar", "Pairs"].sum() == 44 - used


def test_the_pair_that_is_drawn_has_most_matches() -> None:
    _, trials = load_profiles(CONFIG, [EXACT, "repeats=1", "scan.profiles=8"])
    pairs = list(register_profiles(trials[0]))
    shown = telling_pair(pairs)
    assert shown is not None
    counts = [len(p.result.evidence["planar"].matches.pairs) for p in pairs]
    assert len(shown[1].matches.pairs) == max(counts)
    assert telling_pair([]) is None


def test_the_command_writes_rows_tables_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["scan.profiles=6", "repeats=2", "methods=[{name: planar, preset: thesis}]"]
    arguments = [part for option in options for part in ("--set", option)]
    assert main([str(CONFIG), "--out", str(tmp_path / "out"), *arguments]) == 0
    assert len(pd.read_csv(tmp_path / "out" / "profiles.csv")) == 12
    tables = {path.stem for path in (tmp_path / "out" / "tables").glob("*.csv")}
    assert {"arm", "sensor_card"} < tables
    arm = pd.read_csv(tmp_path / "out" / "tables" / "arm.csv").set_index("View")
    assert set(arm.index) == {"left", "right"}
    # As far as the bracket of the config is off: the encoders do not know of it.
    np.testing.assert_allclose(arm["Exact from encoders (mm)"], np.sqrt(27.0), atol=0.1)
    names = {path.name[:11] for path in (tmp_path / "out" / "figures").glob("*.png")}
    assert names == {f"figure_{n}" for n in ("4_04", "4_05", "4_06", "4_07", "4_08", "4_09",
                                             "6_02", "6_03")}  # fmt: skip
    shown = capsys.readouterr().out
    assert "Written:" in shown
    assert "Card of the sensor" not in shown


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("methods=[{name: thesis}]", "'thesis' registers whole scans; .* planar"),
        ("methods=[{name: planar, preset: exact}]", "unknown preset 'exact'"),
        ("methods=[{name: planar, params: {refinement: points}}]", "refinement"),
        ("scan.step_mm=-5", "scan.step_mm"),
        ("pairs.6.2 foam.source=west", "unknown view 'west'"),
    ],
)
def test_a_wrong_config_is_one_line(change: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as raised:
        load_profiles(CONFIG, [change])
    assert "\n" not in str(raised.value)


def test_a_dry_run_counts_the_profiles_and_report_only_needs_their_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    request = [str(CONFIG), "--set", "scan.profiles=6", "--set", "repeats=1", "--out", str(out)]
    assert main([*request, "--dry-run"]) == 0
    trials = len(load_profiles(CONFIG, ["scan.profiles=6", "repeats=1"])[1])
    assert f"{6 * trials} pairs of profiles to register" in capsys.readouterr().out
    assert main([*request, "--report-only"]) == 2
    assert "has no rows of this config" in capsys.readouterr().err
    assert not out.exists()
    assert main(request) == 0
    rows = (out / "profiles.csv").read_bytes()
    capsys.readouterr()
    assert main([*request, "--dry-run"]) == 0
    assert "all at hand" in capsys.readouterr().out
    assert main([*request, "--report-only"]) == 0
    assert (out / "profiles.csv").read_bytes() == rows


def test_kept_rows_are_those_that_were_measured(tmp_path: Path) -> None:
    overrides = ["scan.profiles=4", "repeats=1"]
    experiment, trials = load_profiles(CONFIG, overrides)
    assert kept_rows(experiment, trials, tmp_path) is None
    run_profiles(CONFIG, tmp_path, overrides)
    kept = kept_rows(experiment, trials, tmp_path)
    assert kept is not None
    pd.testing.assert_frame_equal(
        kept.drop(columns="ms"), measure(trials).drop(columns="ms"), check_exact=True
    )
    other = load_profiles(CONFIG, [*overrides, "seed=1"])
    assert kept_rows(*other, tmp_path) is None


def test_a_pair_that_the_search_cannot_find_is_told_from_one_that_shares_little() -> None:
    (trial,) = load_profiles(CONFIG, ["repeats=1", "methods=[{name: planar, preset: thesis}]"])[1]
    rows = measure([trial])
    losses = loss_table(trial, rows)
    assert losses is not None
    frame = losses.frame
    assert frame["Pairs"].sum() == 44
    lost = rows["rotation_x_deg"].isna() | rows["outlier"]
    assert frame["Left out of the mean"].sum() == lost.sum() > 0
    # What both views share in full, and see the middle of, is never left out here.
    assert frame["Left out of the mean"].tolist()[2] == 0
    assert frame["Pairs"].tolist()[2] > 10


def test_a_profile_beside_itself_is_neither_far_nor_little() -> None:
    (trial,) = load_profiles(CONFIG, ["repeats=1", "methods=[{name: planar, preset: thesis}]"])[1]
    method, params = find_method("planar").function, trial.spec.method.params
    for pair in list(register_profiles(trial))[::10]:
        twice = dataclasses.replace(
            pair,
            source=pair.target,
            exact=RigidTransform.identity(),
            result=method(pair.target, pair.target, params),
        )
        assert kind_of(twice, params) == "neither"
        away = RigidTransform.from_translation([0.0, 40.0, 90.0])
        assert kind_of(dataclasses.replace(twice, exact=away), params) == "far"
