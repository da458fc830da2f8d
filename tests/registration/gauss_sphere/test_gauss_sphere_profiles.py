"""Profiles that lie at uneven distances, and profiles that brought nothing back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from plane_scans import (
    join,
    move_plates,
    plates_from,
    pose_error,
    random_clutter,
    random_view,
    scan_plates,
)

from registration import Scan, register
from registration.gauss_sphere.beams import fan_of
from registration.gauss_sphere.evidence import patch_of_points
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.pipeline import describe
from registration.gauss_sphere.view import NEAREST

DEFAULTS = GaussSphereParams()
DENSE = 120  # profiles, 2.5 mm apart

Profiles = Callable[[np.random.Generator], np.ndarray]


def faster(rng: np.random.Generator) -> np.ndarray:
    """A sensor that starts slowly and ends at some three times its speed."""
    return np.unique((DENSE - 1) * np.linspace(0.0, 1.0, DENSE // 2) ** 1.5).astype(int)


def shaken(rng: np.random.Generator) -> np.ndarray:
    even = np.arange(0, DENSE, 2)
    return np.clip(even + rng.integers(-1, 2, even.size), 0, DENSE - 1)


def half_of_them(rng: np.random.Generator) -> np.ndarray:
    return np.sort(rng.choice(DENSE, DENSE // 2, replace=False))


def taken(scan: Scan, profiles: np.ndarray) -> Scan:
    return Scan.from_points(scan.points_mm[profiles], 5.0, apex_mm=scan.apex_mm)


def emptied(scan: Scan, profiles: np.ndarray) -> Scan:
    points_mm = scan.points_mm.copy()
    points_mm[profiles] = np.nan
    return Scan.from_points(points_mm, scan.step_mm, apex_mm=scan.apex_mm)


def dense_pair(seed: int) -> tuple[Scan, Scan, np.ndarray]:
    rng = np.random.default_rng([7, seed])
    plates = random_clutter(rng)
    T_source_target = random_view(rng)
    target, source = (
        scan_plates(seen, DENSE, step_mm=2.5, noise=1.0, rng=rng)
        for seen in (plates, move_plates(plates, T_source_target))
    )
    return target, source, T_source_target.inv()


@pytest.mark.parametrize("profiles", [faster, shaken, half_of_them])
@pytest.mark.parametrize("seed", range(4))
def test_profiles_need_not_be_evenly_spaced(profiles: Profiles, seed: int) -> None:
    rng = np.random.default_rng([32, seed])
    target, source, T_true = dense_pair(seed)
    result = register(taken(target, profiles(rng)), taken(source, profiles(rng)))
    assert result.status == "ok", result.reason
    angle_deg, distance_mm = pose_error(result.T_target_source, T_true)
    assert angle_deg < 0.5
    assert distance_mm < 5.0


def test_a_profile_without_a_return_is_as_one_not_taken() -> None:
    target, source, _ = dense_pair(4)
    rng = np.random.default_rng(33)
    lost = [rng.choice(np.arange(1, DENSE - 1), DENSE // 3, replace=False) for _ in range(2)]
    kept = [np.delete(np.arange(DENSE), each) for each in lost]
    empty = register(
        *(emptied(scan, each) for scan, each in zip((target, source), lost, strict=True))
    )
    closed = register(
        *(taken(scan, each) for scan, each in zip((target, source), kept, strict=True))
    )
    assert empty.status == closed.status == "ok"
    pose, same = empty.T_target_source.as_matrix(), closed.T_target_source.as_matrix()
    np.testing.assert_array_equal(pose, same)
    np.testing.assert_array_equal(empty.covariance, closed.covariance)


def test_profiles_before_and_after_all_others_keep_their_places() -> None:
    scan, _, _ = dense_pair(5)
    outside = np.r_[0:9, 100:DENSE]
    fan = fan_of(emptied(scan, outside))
    np.testing.assert_allclose(fan.x_mm, 2.5 * np.arange(DENSE), atol=1e-9)
    nothing = fan_of(emptied(scan, np.arange(DENSE)))
    np.testing.assert_allclose(nothing.x_mm, 2.5 * np.arange(DENSE), atol=1e-9)


def test_the_apex_is_found_from_uneven_profiles_of_a_slanted_motion() -> None:
    slanted, rng = np.array([1.0, 0.2, -0.3]), np.random.default_rng(3)
    scan, _, _ = dense_pair(6)
    points_mm = scan.points_mm + scan.points_mm[..., :1] * (slanted - [1.0, 0.0, 0.0])
    uneven = Scan.from_points(points_mm[faster(rng)], 5.0, travel=slanted)
    np.testing.assert_allclose(fan_of(uneven).apex_mm[1:], [0.0, -60.0], atol=3.0)


def test_every_point_keeps_its_patch() -> None:
    scan, _, _ = dense_pair(7)
    lost = np.r_[20:23, 50, 80:95]
    empty = emptied(scan, lost)
    view = describe(empty, DEFAULTS)
    patch = patch_of_points(empty, view)
    assert patch.shape == empty.points_mm.shape[:2]
    assert (patch[lost] == -1).all()
    assert (patch >= 0).mean() > 0.5
    for i, (normal, offset_mm) in enumerate(
        zip(view.patches.normal, view.patches.offset_mm, strict=True)
    ):
        away_mm = empty.points_mm[patch == i] @ normal - offset_mm
        assert abs(away_mm).max() < 8.0


def two_boards(gap_mm: float) -> Scan:
    """Two boards of one plane, one after the other along X, before a wall at a slant."""
    boards = plates_from(
        np.array([[0.0, 0.1, -1.0]] * 2) / np.linalg.norm([0.1, 1.0]),
        np.array([[60.0, 0.0, 700.0], [180.0 + gap_mm, 0.0, 700.0]]),
        np.array([[60.0, 120.0]] * 2),
    )
    return scan_plates(join(boards), int((240.0 + gap_mm) / 5.0) + 1)


@pytest.mark.parametrize("closed_up", [False, True])
def test_nothing_is_known_of_a_wide_gap(closed_up: bool) -> None:
    scan = two_boards(150.0)
    measured = scan.valid.any(axis=1)
    assert 25 < (~measured).sum() < 32
    if closed_up:
        scan = Scan.from_points(scan.points_mm[measured], 5.0, apex_mm=scan.apex_mm)
    view = describe(scan, DEFAULTS)
    assert view.patches.n_points.size == 2
    seen, x_mm = view.seen, view.fan.x_mm
    cell = int((0.5 * (x_mm[0] + x_mm[-1]) - seen.x_low_mm) * seen.cells_per_mm)
    assert seen.profile_of[cell] == -1
    nearest = seen.image.reshape(x_mm.size, -1, 3)[..., NEAREST]
    edge = np.argmax(np.diff(x_mm))
    assert (nearest[[edge, edge + 1]] == -np.inf).all()
    assert np.isfinite(nearest[[edge - 1, edge + 2]]).any(axis=1).all()
