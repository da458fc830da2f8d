from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from harness.scoring.bound import parameter_deviations
from harness.scoring.normalised_errors import squared_distances
from harness.scoring.poses import FINE, PARAMETERS, parameter_errors, pose_error, six_parameters
from harness.tables.pairs import NAMES
from harness.tables.random_groups import PARTS, THRESHOLDS, with_family
from harness.tables.random_pairs import (
    bound_table,
    calibration_table,
    random_tables,
    success_table,
    wrong_table,
)

COVARIANCE = np.diag([1e-3, 2e-3, 5e-4, 0.4, 0.3, 0.6]) ** 2


def rows_with(errors: list[np.ndarray], statuses: list[str], overlaps: list[float]) -> pd.DataFrame:
    """Rows of one method whose estimates are off by perturbations (rad, mm) on the left."""
    rng = np.random.default_rng(0)
    records = []
    for i, (error, status, overlap) in enumerate(zip(errors, statuses, overlaps, strict=True)):
        exact = RigidTransform.from_components(
            rng.uniform(-300, 300, 3), Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
        )
        off = RigidTransform.from_components(error[3:], Rotation.from_rotvec(error[:3]))
        estimated = off * exact
        apart = pose_error(exact, estimated)
        six = parameter_errors(six_parameters(exact), six_parameters(estimated))
        records.append(
            {
                "id": f"{i:016x}", "pair": f"{'desk' if i % 2 else 'clutter'} {i}",
                "method": "ours", "status": status, "reason": "" if status == "ok" else "no 7",
                "notes": "",
                "overlap_target": overlap, "overlap_source": overlap + 0.1,
                "T_exact": exact.as_matrix(), "T_estimated": estimated.as_matrix(),
                "rotation_error_deg": np.rad2deg(apart.rotation_rad),
                "translation_error_mm": apart.translation_mm,
                "bounds": np.stack([COVARIANCE, 4.0 * COVARIANCE]), "covariance": COVARIANCE,
                "ms_registration": 10.0 + i, "ms_planes": 4.0,
            }
            | {f"error_{c}": value for c, value in zip(PARAMETERS, six, strict=True)}
        )  # fmt: skip
    return with_family(pd.DataFrame(records))


@pytest.fixture(scope="module")
def normal_rows() -> pd.DataFrame:
    """Errors drawn from the very covariance that the rows claim, which is also the bound."""
    rng = np.random.default_rng(1)
    count = 400
    errors = list(rng.multivariate_normal(np.zeros(6), COVARIANCE, count))
    return rows_with(errors, ["ok"] * count, rng.uniform(0.2, 0.9, count).tolist())


def test_errors_at_the_bound_have_ratio_one(normal_rows: pd.DataFrame) -> None:
    table = bound_table(normal_rows).frame.set_index(["Scenes", "Bound from", "Error"])
    whole = table.loc[("all", "all points of shared faces", "root mean square"), list(NAMES)]
    np.testing.assert_allclose(whole.astype(float), 1.0, atol=4.0 / np.sqrt(800))
    half = table.loc[("all", "points in the overlap only", "root mean square"), list(NAMES)]
    np.testing.assert_allclose(half.astype(float), whole.astype(float) / 2.0)
    median = table.loc[("all", "all points of shared faces", "by the median"), list(NAMES)]
    np.testing.assert_allclose(median.astype(float), 1.0, atol=0.25)


def test_right_covariances_hold_their_share(normal_rows: pd.DataFrame) -> None:
    table = calibration_table(normal_rows).frame.set_index(["Scenes", "Over"])
    row = table.loc[("all", "marked ok")]
    assert row["Pairs"] == 400
    assert abs(row["NEES mean"] - 6.0) < 4.0 * np.sqrt(12.0 / 400)
    for level in (0.5, 0.9, 0.99):
        spread = np.sqrt(level * (1.0 - level) / 400)
        assert abs(row[f"Inside {level:.0%}"] - level) < 4.0 * spread + 0.003


def test_a_squared_distance_is_that_of_the_left_perturbation() -> None:
    error = np.array([1e-3, -2e-3, 5e-4, 0.4, 0.6, -0.6])
    rows = rows_with([error], ["ok"], [0.5])
    expected = error @ np.linalg.inv(COVARIANCE) @ error
    # Opposite signs, as from exact to estimated: for small errors the same distance.
    assert squared_distances(rows)[0] == pytest.approx(expected, rel=0.01)


def test_successes_are_counted_in_their_bands() -> None:
    small, medium, large = np.zeros(6), np.array([0, 0, 0.05, 0, 0, 3.0]), np.full(6, 0.5)
    rows = rows_with(
        [small, small, medium, large, small, large],
        ["ok", "ok", "ok", "ok", "ambiguous", "failed"],
        [0.25, 0.45, 0.45, 0.7, 0.7, 0.7],
    )
    table = success_table(rows).frame.set_index(["Scenes", "Overlap"])
    assert table.loc[("all", "any"), "Pairs"] == 6
    assert table.loc[("all", "over 0.4"), "Pairs"] == 5
    assert table.loc[("all", "0.2 to 0.4"), "Within 1 deg and 5 mm"].startswith("100.0%")
    assert table.loc[("all", "0.4 to 0.6"), "Within 1 deg and 5 mm"].startswith("50.0%")
    assert table.loc[("all", "0.4 to 0.6"), "Within 5 deg and 30 mm"].startswith("100.0%")
    assert table.loc[("all", "any"), "Marked ok"] == 4
    assert table.loc[("all", "any"), "of these wrong"] == 1
    wrong = wrong_table(rows).frame
    assert list(wrong["Trial"]) == [f"{3:016x}"]


def test_errors_of_the_program_are_counted_as_failures() -> None:
    rows = rows_with([np.zeros(6)] * 3, ["ok", "error", "error"], [0.3, np.nan, np.nan])
    rows["pair"] = ["desk 0", "desk 0", "desk 1"]  # the last was never drawn
    rows["method"] = ["ours", "theirs", "theirs"]
    table = success_table(with_family(rows))
    of = table.frame.set_index(["Method", "Overlap"])
    assert of.loc[("theirs", "0.2 to 0.4"), "Pairs"] == 1
    assert of.loc[("theirs", "0.2 to 0.4"), "Within 5 deg and 30 mm"].startswith("0.0%")
    assert "1 of 3 trials are not counted" in table.note
    assert "not counted" not in success_table(with_family(rows[:2])).note


def test_every_table_is_made_and_bands_and_thresholds_are_whole(normal_rows) -> None:
    tables = {table.name for table in random_tables(normal_rows.drop(columns="family"))}
    assert tables == {
        "success", "accuracy", "curves", "bound", "calibration", "times", "statuses",
    }  # fmt: skip
    assert FINE in THRESHOLDS
    for overlap in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.0):
        assert sum(band.low <= overlap < band.high for band in PARTS) == 1


def test_pairs_of_little_overlap_are_counted_by_themselves() -> None:
    rows = rows_with([np.zeros(6)] * 3, ["ok", "ok", "failed"], [0.1, 0.3, 0.15])
    of = success_table(rows).frame.set_index(["Scenes", "Overlap"])
    assert of.loc[("all", "below 0.2"), "Pairs"] == 2
    assert of.loc[("all", "0.2 to 0.4"), "Pairs"] == 1
    assert of.loc[("all", "0.2 to 0.4"), "Within 1 deg and 5 mm"].startswith("100.0%")


def test_bounds_of_a_pair_scale_its_own_errors(normal_rows: pd.DataFrame) -> None:
    row = normal_rows.iloc[0]
    pose = RigidTransform.from_matrix(row["T_exact"])
    ratio = np.array([row[f"error_{c}"] for c in PARAMETERS]) / parameter_deviations(
        COVARIANCE, pose
    )
    table = bound_table(normal_rows.iloc[:1]).frame
    first = table[table["Bound from"] == "all points of shared faces"].iloc[0]
    np.testing.assert_allclose(first[list(NAMES)].astype(float), np.abs(ratio))
