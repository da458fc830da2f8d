"""Laws of the whole method and of its later stages, entered with patches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_patches import assert_same_pose, move_patches, random_plates, random_pose, true_patches
from plane_scans import Plates, move_plates, plates_from, pose_error, scan_plates
from scipy.spatial.transform import RigidTransform, Rotation

from registration import register
from registration.thesis.gauss_sphere import compact_sphere
from registration.thesis.params import RotationParams, ThesisParams, TranslationParams
from registration.thesis.pipeline import register_patches, register_segments
from registration.thesis.rotation import match_normals
from registration.thesis.translation import estimate_translation, oriented_pairs

READINGS = {
    "default": ThesisParams(),
    "literal": ThesisParams.literal(),
    "svd": ThesisParams(rotation=RotationParams(solver="svd")),
    "refit": ThesisParams(rotation=RotationParams(refit=True)),
    "3d": ThesisParams(translation=TranslationParams(density="3d")),
    "plain mean": ThesisParams(translation=TranslationParams(area_ratio_weights=False)),
}
IN_3D = replace(ThesisParams(), translation=TranslationParams(density="3d"))


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("seed", range(4))
def test_true_patches_give_the_true_pose(reading: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    patches, T_target_source = true_patches(random_plates(rng)), random_pose(rng)
    source = move_patches(patches, T_target_source.inv())

    result = register_patches(patches, source, READINGS[reading])

    assert result.status == "ok"
    assert_same_pose(result.T_target_source, T_target_source)


@pytest.mark.parametrize("density", ["per_axis", "3d"])
def test_translation_stage_alone_is_exact_for_the_true_rotation(density: str) -> None:
    rng = np.random.default_rng(10)
    target, T_target_source = true_patches(random_plates(rng)), random_pose(rng)
    source = move_patches(target, T_target_source.inv())
    params = ThesisParams()
    R = T_target_source.rotation.as_matrix()
    spheres = [compact_sphere(view, params.sphere) for view in (target, source)]
    matches = match_normals(*spheres, R, params.rotation.overlap_tolerance_rad)

    pairs = oriented_pairs(*spheres, matches)
    translation_mm, shifts = estimate_translation(
        target, source, pairs, R, TranslationParams(density=density)
    )

    assert len(matches) == len(spheres[0])
    np.testing.assert_allclose(translation_mm, T_target_source.translation, atol=1e-9)
    assert shifts.agreeing == len(target)


@pytest.mark.parametrize("reading", READINGS)
def test_moving_the_sources_patches_moves_the_estimate(reading: str, noisy_pair) -> None:
    params = READINGS[reading]
    views = register(noisy_pair.target, noisy_pair.source, "thesis", IN_3D).evidence
    target, source = views["target"].patches, views["source"].patches
    T_new_source = random_pose(np.random.default_rng(3))

    before = register_patches(target, source, params)
    after = register_patches(target, move_patches(source, T_new_source), params)

    assert before.status == after.status == "ok"
    assert_same_pose(after.T_target_source * T_new_source, before.T_target_source)


def test_moving_both_views_patches_moves_the_estimate_in_3d(noisy_pair) -> None:
    """Not so for densities axis by axis: they depend on the axes."""
    views = register(noisy_pair.target, noisy_pair.source, "thesis", IN_3D).evidence
    target, source = views["target"].patches, views["source"].patches
    T_new_target = random_pose(np.random.default_rng(4))

    before = register_patches(target, source, IN_3D)
    after = register_patches(move_patches(target, T_new_target), source, IN_3D)

    assert before.status == after.status == "ok"
    assert_same_pose(after.T_target_source, T_new_target * before.T_target_source)


@pytest.mark.parametrize("solver", ["nine_by_nine", "svd"])
def test_swapping_target_and_source_inverts_the_estimate(solver: str, noisy_pair) -> None:
    params = replace(IN_3D, rotation=RotationParams(solver=solver))

    there = register(noisy_pair.target, noisy_pair.source, "thesis", params)
    back = register(noisy_pair.source, noisy_pair.target, "thesis", params)

    assert there.status == back.status == "ok"
    assert_same_pose(back.T_target_source, there.T_target_source.inv())


@pytest.mark.parametrize("reading", READINGS)
def test_swapping_true_patches_inverts_the_estimate(reading: str) -> None:
    rng = np.random.default_rng(11)
    target = true_patches(random_plates(rng))
    source = move_patches(target, random_pose(rng))
    there = register_patches(target, source, READINGS[reading])
    back = register_patches(source, target, READINGS[reading])
    assert_same_pose(back.T_target_source, there.T_target_source.inv())


def test_entering_with_segments_repeats_the_whole(noisy_pair) -> None:
    whole = register(noisy_pair.target, noisy_pair.source, "thesis")
    views = [whole.evidence[name] for name in ("target", "source")]
    halfway = register_segments(
        *(v.segments for v in views), ThesisParams(), *(v.scan_filtered for v in views)
    )
    np.testing.assert_array_equal(
        halfway.T_target_source.as_matrix(), whole.T_target_source.as_matrix()
    )


SCANNING = {"profiles": 84, "step_mm": 5.0}


def separated_plates(rng: np.random.Generator) -> Plates:
    """Two rows of three plates, no two of them near enough to parallel to be united."""
    while True:
        tilts = np.radians(rng.uniform(8, 25, (6, 2))) * rng.choice([-1, 1], (6, 2))
        normals = Rotation.from_euler("XY", tilts).apply([0.0, 0.0, -1.0])
        if np.linalg.norm(normals[:, None] - normals + np.eye(6)[..., None], axis=2).min() > 0.06:
            break
    centres = np.array([[x, y, 0.0] for x in (110.0, 290.0) for y in (-125.0, 0.0, 125.0)])
    centres += rng.uniform([-10, -10, 900], [10, 10, 1020], (6, 3))
    return plates_from(normals, centres, rng.uniform(28, 42, (6, 2)))


def seen_whole(plates: Plates) -> bool:
    """Nothing hides a part of a plate, and no plate reaches out of the field or the sweep."""
    alone = 0
    for m in range(len(plates)):
        one = Plates(plates.centre_mm[m : m + 1], plates.axes[m : m + 1], plates.half_mm[m : m + 1])
        scan = scan_plates(one, **SCANNING)
        if scan.valid[[0, -1]].any() or scan.valid[:, [0, -1]].any():
            return False
        alone += scan.n_valid
    return alone == scan_plates(plates, **SCANNING).n_valid


@pytest.mark.parametrize("seed", range(10))
def test_noise_free_scans_of_plates_seen_whole_register_to_a_sample(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    while True:
        plates = separated_plates(rng)
        angles_deg = [*rng.uniform(-3, 3, 2), rng.uniform(-20, 20)]
        turn = Rotation.from_euler("ZYX", np.radians(angles_deg))
        pivot = np.array([200.0, 0.0, 950.0])
        T_source_target = RigidTransform.from_components(pivot - turn.apply(pivot), turn)
        moved = move_plates(plates, T_source_target)
        if seen_whole(plates) and seen_whole(moved):
            break

    result = register(scan_plates(plates, **SCANNING), scan_plates(moved, **SCANNING), "thesis")

    assert result.status == "ok"
    angle_deg, distance_mm = pose_error(result.T_target_source, T_source_target.inv())
    assert angle_deg < 0.02
    assert distance_mm < SCANNING["step_mm"]


def test_noisy_scans_register_to_the_size_of_the_thesiss_own_errors(noisy_pair) -> None:
    result = register(noisy_pair.target, noisy_pair.source, "thesis")
    assert result.status == "ok"
    angle_deg, distance_mm = pose_error(result.T_target_source, noisy_pair.T_target_source)
    assert angle_deg < 1.5
    assert distance_mm < 15.0


def test_the_same_input_gives_the_same_bits(noisy_pair) -> None:
    first, second = (register(noisy_pair.target, noisy_pair.source, "thesis") for _ in range(2))
    np.testing.assert_array_equal(
        first.T_target_source.as_matrix(), second.T_target_source.as_matrix()
    )
