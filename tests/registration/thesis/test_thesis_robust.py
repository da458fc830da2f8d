"""Whatever a scan contains, the answer is a result with a status and a reason."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from plane_scans import clutter_pair, join, move_plates, plates_from, pose_error, scan_plates
from scipy.spatial.transform import RigidTransform, Rotation

from registration import Scan, register
from registration.thesis.outcome import open_directions
from registration.thesis.params import RotationParams, ThesisParams, TranslationParams

PRESETS = {
    "default": ThesisParams(),
    "literal": ThesisParams.literal(),
    "two rotations": ThesisParams(rotation=RotationParams(zero_rotation="z")),
    "3d": ThesisParams(translation=TranslationParams(density="3d")),
}
PRESET = st.sampled_from(list(PRESETS))
BIT = st.booleans()


@functools.cache
def clutter() -> tuple[Scan, Scan]:
    pair = clutter_pair(seed=1001, noise=0.5)
    return tuple(
        Scan.from_points(scan.points_mm[::2, ::4], 2 * scan.step_mm)
        for scan in (pair.target, pair.source)
    )


def check(target: Scan, source: Scan, preset: str) -> None:
    result = register(target, source, "thesis", PRESETS[preset])
    assert result.status in ("ok", "ambiguous", "underdetermined", "failed")
    assert (result.status == "ok") == (result.reason == "")
    assert (result.T_target_source is not None) == (result.status in ("ok", "ambiguous"))
    if result.T_target_source is not None:
        matrix = result.T_target_source.as_matrix()
        assert np.isfinite(matrix).all()
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)
    assert set(result.evidence) >= {"target", "source", "shifts", "normal_matches"}
    norms = np.linalg.norm(result.undetermined, axis=1)
    np.testing.assert_allclose(norms, 1.0)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(0.0, 1.0), st.integers(0, 2**32 - 1), PRESET)
def test_missing_points_never_raise(share: float, seed: int, preset: str) -> None:
    target, source = clutter()
    gone = np.random.default_rng(seed).random(target.valid.shape) < share
    points = np.where(gone[..., None], np.nan, target.points_mm)
    check(Scan.from_points(points, target.step_mm), source, preset)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(1, 6), st.integers(1, 12), st.data(), PRESET)
def test_arbitrary_small_scans_never_raise(
    profiles: int, pixels: int, data: st.DataObject, preset: str
) -> None:
    coordinate = st.floats(-2000.0, 2000.0) | st.just(np.nan) | st.sampled_from([0.0, 500.0])
    shape = (profiles, pixels, 3)
    first, second = (
        Scan.from_points(data.draw(arrays.arrays(np.float64, shape, elements=coordinate)), 5.0)
        for _ in range(2)
    )
    check(first, second, preset)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scans_of_any_size_never_raise(preset: str, scale: float) -> None:
    target, source = clutter()
    check(Scan.from_points(target.points_mm * scale, target.step_mm * scale), source, preset)


def test_scans_of_unrelated_things_are_refused() -> None:
    """What the beliefs are for: the thesis would have answered every one of these."""
    answers = []
    for seed in range(8):
        target, _, _ = clutter_pair(seed, 1.0)
        _, source, _ = clutter_pair(500 + seed, 1.0)
        result = register(target, source, "thesis")
        answers.append(result.status)
        assert result.reason
    assert answers.count("failed") == len(answers)


def test_most_overlapping_noisy_scans_register_and_none_is_wrong_in_silence() -> None:
    right = 0
    for seed in range(2000, 2012):
        target, source, T_target_source = clutter_pair(seed, 1.0)
        result = register(target, source, "thesis")
        if result.status == "ok":
            angle_deg, distance_mm = pose_error(result.T_target_source, T_target_source)
            assert angle_deg < 3.0
            assert distance_mm < 30.0
            right += 1
    assert right >= 9


def test_the_fallback_registers_a_prism_when_the_user_rules_out_a_turn_about_z() -> None:
    """Faces around one axis have no triplet; centroids still fix the pose along it."""
    angles = np.radians([-32.0, -12.0, 9.0, 31.0])
    normals = np.stack([0.0 * angles, np.sin(angles), -np.cos(angles)], axis=1)
    centres = np.array(
        [[120.0, y, z] for y, z in zip([-150, -50, 50, 150], [900, 940, 960, 920], strict=True)]
    )
    plates = plates_from(normals, centres, np.full((4, 2), [60.0, 35.0]))
    turn = Rotation.from_euler("YX", np.radians([0.0, 9.0]))
    pivot = np.array([120.0, 0.0, 930.0])
    T_source_target = RigidTransform.from_components(pivot - turn.apply(pivot), turn)
    target, source = (scan_plates(v, 50) for v in (plates, move_plates(plates, T_source_target)))

    refused = register(target, source, "thesis")
    assert refused.status == "underdetermined"
    assert "three that are not coplanar are needed" in refused.reason
    np.testing.assert_allclose(np.abs(refused.undetermined), [[0, 0, 0, 1, 0, 0]], atol=1e-6)

    params = ThesisParams(rotation=RotationParams(zero_rotation="z"))
    result = register(target, source, "thesis", params)
    assert result.status == "ok"
    assert result.evidence["two_rotations"]
    angle_deg, distance_mm = pose_error(result.T_target_source, T_source_target.inv())
    assert angle_deg < 0.02
    assert distance_mm < 5.0


def test_parallel_planes_leave_two_shifts_and_a_turn_open() -> None:
    n = np.array([[0.1, 0.2, -1.0]] * 2) / np.linalg.norm([0.1, 0.2, -1.0])
    plates = join(
        plates_from(n[:1], np.array([[100.0, -80.0, 900.0]]), np.array([[60.0, 60.0]])),
        plates_from(n[1:], np.array([[100.0, 80.0, 960.0]]), np.array([[60.0, 60.0]])),
    )
    scan = scan_plates(plates, 50)
    result = register(scan, scan, "thesis")
    assert result.status == "underdetermined"
    directions = result.undetermined
    assert directions.shape == (3, 6)
    np.testing.assert_allclose(directions @ directions.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(directions[1:, 3:] @ n[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(np.cross(directions[0, :3], n[0]), 0.0, atol=1e-6)
    again = open_directions(result.evidence["target"], 0.025)
    np.testing.assert_array_equal(again, directions)


def test_a_rotation_that_explains_as_much_makes_the_answer_ambiguous() -> None:
    """A three-sided pyramid, its faces alike: turned by 120 degrees it is itself."""
    tilt = np.radians(35.0)
    first = np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    third = Rotation.from_rotvec([[0.0, 0.0, a] for a in 2 * np.pi / 3 * np.arange(3)])
    centre = np.array([150.0, 0.0, 900.0])
    plates = plates_from(
        third.apply(first), centre + third.apply([80.0, 0.0, 40.0]), np.full((3, 2), 40.0)
    )
    scan = scan_plates(plates, 60)
    result = register(scan, scan, "thesis", PRESETS["3d"])
    assert result.status == "ambiguous"
    assert "120 degrees away" in result.reason
    assert len(result.candidates) >= 2
