"""A bias that no calibration, or that of another sensor, leaves in the scans is seen and told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plane_scans import APEX_BEHIND_MM, Pair, clutter_pair, plates_from, scan_plates

from registration import RegistrationResult, Scan, register
from registration.calibration import Calibration, Table
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.evidence import PlaneEvidence
from registration.gauss_sphere.fan.calibrated import NOTHING_KNOWN, read_known
from registration.gauss_sphere.judging import free_planes
from registration.gauss_sphere.judging.bending import PARABOLA_MM, bending, doubted
from registration.gauss_sphere.params import GaussSphereParams, WholePlaneParams

SEEDS = (1, 2, 3)
DEPTH_MM, SLOPE = np.linspace(100.0, 1500.0, 57), np.linspace(-0.3, 0.3, 61)


def bulged(scan: Scan, share: float) -> Scan:
    """The scan of a sensor with a lateral bias, a parabola over the field."""
    reach_mm = scan.points_mm[..., 2] + APEX_BEHIND_MM
    slope = scan.points_mm[..., 1] / reach_mm
    off_mm = share * PARABOLA_MM * slope**2 * (reach_mm / 1000.0) ** 2
    points_mm = scan.points_mm.copy()
    points_mm[..., 1] += slope * off_mm
    points_mm[..., 2] += off_mm
    return replace(scan, points_mm=points_mm)


def calibration(share: float, folder: Path) -> GaussSphereParams:
    """The method with what a flat target would have told of that sensor."""
    bias = share * PARABOLA_MM * SLOPE**2 * ((DEPTH_MM[:, None] + APEX_BEHIND_MM) / 1000.0) ** 2
    sigma = Table(DEPTH_MM, np.array([0.0, 3.0]), np.outer(0.1 + 1e-3 * DEPTH_MM, [1.0, 1.0]))
    apex_mm = np.array([0.0, 0.0, -APEX_BEHIND_MM])
    table = Table(DEPTH_MM, SLOPE, bias)
    Calibration("lateral", apex_mm, table, sigma, known_to_mm=0.03).write(folder / "c.json")
    return GaussSphereParams(calibration=str(folder / "c.json"))


def answer(pair: Pair, share: float, params: GaussSphereParams) -> RegistrationResult:
    return register(bulged(pair.target, share), bulged(pair.source, share), params=params)


def distance2(result: RegistrationResult, pair: Pair) -> float:
    """Squared error in units of the covariance, six degrees of freedom."""
    off = pair.T_target_source * result.T_target_source.inv()
    error = np.append(off.rotation.as_rotvec(), off.translation)
    return float(error @ np.linalg.solve(result.covariance, error))


@pytest.mark.parametrize("mark_mm", [1e5, float(np.finfo(np.float32).max)])
def test_marks_of_no_return_are_named_where_no_answer_is_found(mark_mm: float) -> None:
    points_mm = np.full((20, 64, 3), mark_mm)
    points_mm[5, :3] = np.nan
    result = register(*[Scan.from_points(points_mm, 5.0)] * 2)
    assert result.status != "ok"
    assert result.notes[1].startswith("1277 of 1277 points of the target scan lie more than 90 m")
    assert "NaN" in result.notes[2]


def test_marks_are_named_where_the_sensor_moves_at_a_slant() -> None:
    points_mm = np.full((20, 64, 3), 1e-3)
    points_mm[:, :, 0] = 5.0 * np.arange(20)[:, None]
    scan = Scan.from_points(points_mm, 5.0, apex_mm=(0.0, 0.0, -60.0), travel=(1.0, 0.0, 0.5))
    assert any(note.startswith("1280 of 1280 points") for note in register(scan, scan).notes)


@pytest.mark.parametrize("calibrated", [False, True])
def test_zeros_in_place_of_no_return_are_named_where_no_answer_is_found(
    calibrated: bool, tmp_path: Path
) -> None:
    points_mm = np.full((20, 64, 3), 1e-3)  # exact zeros are left out
    points_mm[:, :, 0] = 5.0 * np.arange(20)[:, None]
    scan = Scan.from_points(points_mm, 5.0, apex_mm=(0.0, 0.0, -60.0))
    params = calibration(1.0, tmp_path) if calibrated else GaussSphereParams()
    result = register(scan, scan, params=params)
    assert result.status != "ok"
    target, source = result.notes[-2:]
    assert target.startswith("1280 of 1280 points of the target scan lie within 10 mm of Y")
    assert "NaN" in source


def test_scans_in_metres_are_told_that_lengths_are_in_mm() -> None:
    pair = clutter_pair(0, noise=1.0)
    scans = [Scan.from_points(1e-3 * scan.points_mm, 5e-3) for scan in (pair.target, pair.source)]
    result = register(*scans)
    assert result.status == "failed"
    assert result.notes[-1].endswith("NaN where nothing returned, lengths in mm")


@pytest.mark.parametrize("seed", SEEDS)
def test_shallow_roofs_do_not_speak_against_the_right_calibration(
    seed: int, tmp_path: Path
) -> None:
    """Two faces that meet at four degrees are taken for one bent plane, which no bias bends so."""
    rng, tilt, params = np.random.default_rng(seed), np.radians(2.0), calibration(1.0, tmp_path)
    sides, middles_mm = (-1.0, 1.0), ((60.0, 800.0), (220.0, 900.0))
    normals = [[0.0, s * np.sin(tilt), -np.cos(tilt)] for _ in middles_mm for s in sides]
    centres_mm = [[x, s * 75.0, z + 75.0 * np.tan(tilt)] for x, z in middles_mm for s in sides]
    roofs = plates_from(np.array(normals), np.array(centres_mm), np.array([[60.0, 75.0]] * 4))
    target, source = (
        describe(bulged(scan_plates(roofs, noise=0.1, rng=rng), 1.0), params) for _ in range(2)
    )
    found = bending(target, source, read_known(params.calibration), params.bending)
    assert abs(found.lateral) <= params.bending.sure * found.lateral_deviation
    blind = bending(target, source, NOTHING_KNOWN, params.bending)
    assert abs(blind.lateral) > params.bending.sure * blind.lateral_deviation


@pytest.mark.parametrize("seed", SEEDS)
def test_the_bending_is_measured(seed: int) -> None:
    seen = answer(clutter_pair(seed, 1.0), 1.0, GaussSphereParams()).evidence["planes"]
    assert isinstance(seen, PlaneEvidence)
    found = bending(seen.target, seen.source, NOTHING_KNOWN, seen.params.bending)
    assert found.lateral == pytest.approx(1.0, abs=0.25)
    assert abs(found.lateral - 1.0) < 4.0 * found.lateral_deviation
    assert (found.share, found.share_deviation) == (0.0, np.inf)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("of_sensor", "of_file"), [(0.0, 1.0), (1.0, -1.0), (0.0, -1.0)])
def test_a_calibration_of_another_sensor_is_told_and_widens_the_covariance(
    of_sensor: float, of_file: float, seed: int, tmp_path: Path
) -> None:
    pair, params = clutter_pair(seed, 1.0), calibration(of_file, tmp_path)
    result = answer(pair, of_sensor, params)
    (note,) = result.notes
    assert note.startswith("the calibration does not fit the scans")
    assert result.status in ("ok", "underdetermined")
    if result.status == "ok":
        assert distance2(result, pair) < 16.8


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("share", [0.0, 1.0, -1.0])
def test_the_right_calibration_is_left_in_peace(share: float, seed: int, tmp_path: Path) -> None:
    result = answer(clutter_pair(seed, 1.0), share, calibration(share, tmp_path))
    assert (result.status, result.reason, result.notes) == ("ok", "", ())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_without_a_calibration_a_bulge_is_told_and_widens_the_covariance(
    noise: float, seed: int
) -> None:
    pair = clutter_pair(seed, noise)
    result = answer(pair, 1.0, GaussSphereParams())
    assert len(result.notes) == 2
    assert result.notes[1].startswith("planes are bent as by a bias of up to")
    if result.status == "ok":
        assert distance2(result, pair) < 16.8
    assert len(answer(pair, 0.0, GaussSphereParams()).notes) == 1


def test_a_bias_of_nothing_leaves_the_pose_as_sure_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What noisy normals seem to add to the information is taken out there, too."""
    judged = []
    judge = free_planes.judge
    monkeypatch.setattr(free_planes, "judge", lambda *given: judged.append(given) or judge(*given))
    # Or whole planes would move the pose afterwards.
    params = GaussSphereParams(whole_planes=WholePlaneParams(most_floor_mm=0.0))
    pair = clutter_pair(1, 1.0)
    register(pair.target, pair.source, params=params)
    ((settled, target, source, *_),) = judged
    again = doubted(settled[0], target.patches, source.patches, 0.0, params)
    np.testing.assert_array_equal(again.sure, settled[0].sure)
