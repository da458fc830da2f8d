"""Profiles that lie at uneven distances, and profiles that brought nothing back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from plane_scans import (
    Plates,
    join,
    move_plates,
    plates_from,
    pose_error,
    random_clutter,
    random_view,
    scan_plates,
)

from registration import Scan, register
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.evidence import patch_of_points
from registration.gauss_sphere.fan.beams import _usual_gap, fan_of, measured
from registration.gauss_sphere.outlines.ends import ends_of
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.view import NEAREST

DEFAULTS = GaussSphereParams()
DENSE = 120  # profiles, 2.5 mm apart

Profiles = Callable[[np.random.Generator], np.ndarray]


def faster(rng: np.random.Generator) -> np.ndarray:
    """A sensor that starts slowly and ends at some three times its speed."""
    return np.unique((DENSE - 1) * np.linspace(0.0, 1.0, DENSE // 2) ** 1.5).astype(int)


def shaken(rng: np.random.Generator) -> np.ndarray:
    even = np.arange(0, DENSE, 2)
    return np.unique(np.clip(even + rng.integers(-1, 2, even.size), 0, DENSE - 1))


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


def standing(plates: Plates, rng: np.random.Generator) -> Scan:
    """Two profiles in three are of a sensor that stands still half-way, each with its own noise."""
    scans = [scan_plates(plates, noise=1.0, rng=rng) for _ in range(121)]
    still = np.stack([scan.points_mm[30] for scan in scans[1:]])
    points_mm = np.concatenate([scans[0].points_mm[:30], still, scans[0].points_mm[30:]])
    return Scan.from_points(points_mm, 5.0, apex_mm=scans[0].apex_mm)


def stop_and_go(plates: Plates, rng: np.random.Generator, trembling_mm: float = 0.0) -> Scan:
    """Each place is measured four times."""
    scans = [scan_plates(plates, step_mm=5.1, noise=1.0, rng=rng) for _ in range(4)]
    points_mm = np.stack([scan.points_mm for scan in scans], axis=1).reshape(-1, 256, 3)
    points_mm[..., 0] += rng.uniform(-trembling_mm, trembling_mm, (len(points_mm), 1))
    return Scan.from_points(points_mm, 5.1 / 4.0, apex_mm=scans[0].apex_mm)


def trembling(plates: Plates, rng: np.random.Generator) -> Scan:
    return stop_and_go(plates, rng, trembling_mm=0.01)


def with_one_astray(plates: Plates, rng: np.random.Generator) -> Scan:
    """The last profile claims to be 2 m off."""
    scan = scan_plates(plates, noise=1.0, rng=rng)
    points_mm = scan.points_mm.copy()
    points_mm[-1, :, 0] += 2e3
    return Scan.from_points(points_mm, 5.0, apex_mm=scan.apex_mm)


def backwards(plates: Plates, rng: np.random.Generator) -> Scan:
    """X falls, and nothing is seen at first and at last."""
    points_mm = scan_plates(plates, noise=1.0, rng=rng).points_mm[::-1].copy()
    points_mm[:8] = points_mm[-8:] = np.nan
    return Scan.from_points(points_mm, 5.0)


@pytest.mark.parametrize("scanned", [standing, stop_and_go, trembling, with_one_astray, backwards])
@pytest.mark.parametrize("seed", [0, 1, 9, 11])
def test_motions_of_other_kinds_are_taken(
    scanned: Callable[[Plates, np.random.Generator], Scan], seed: int
) -> None:
    rng = np.random.default_rng([34, seed])
    plates, T_source_target = random_clutter(rng), random_view(rng)
    result = register(scanned(plates, rng), scanned(move_plates(plates, T_source_target), rng))
    assert result.status == "ok", result.reason
    angle_deg, distance_mm = pose_error(result.T_target_source, T_source_target.inv())
    assert angle_deg < 0.5
    assert distance_mm < 5.0


@pytest.mark.parametrize(
    ("x_mm", "gap_mm"),
    [
        (5.0 * np.arange(9), 5.0),
        (-5.0 * np.arange(9), 5.0),
        (np.repeat(5.0 * np.arange(9), 4), 5.0),  # four of each
        (np.r_[0:50:5, 1050:1100:5], 5.0),  # a hole
        (np.r_[np.zeros(400), 5.0 * np.arange(9)], 5.0),  # stood still
        (np.array([0.0, 2.0, 4.0, 10.0]), 4.4),  # each by its length: (4 + 4 + 36) / 10
        (np.zeros(9), 0.0),
        (np.zeros(1), 0.0),
    ],
)
def test_the_usual_gap(x_mm: np.ndarray, gap_mm: float) -> None:
    assert _usual_gap(x_mm.astype(np.float64)) == pytest.approx(gap_mm)


@pytest.mark.parametrize("trembling_mm", [0.0, 0.01])
def test_faces_end_between_places_not_between_profiles_of_one_place(trembling_mm: float) -> None:
    rng = np.random.default_rng(35)
    view = describe(stop_and_go(random_clutter(rng), rng, trembling_mm), DEFAULTS)
    how = DEFAULTS.outlines
    ends = ends_of(view.fan, view.patches, how.behind_mm, how.missing_pixels, 1)
    across = abs(ends.outward[:, 0]) > 0.01
    assert across.sum() > 20
    np.testing.assert_allclose(np.linalg.norm(ends.outward, axis=1), 1.0)
    # Half-way to the next place, though not of one that is measured later.
    nearest_mm = abs(ends.point_mm[across, :1] - 5.1 * np.arange(60)).min(axis=1)
    assert (nearest_mm > 2.5).all()


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
    fan = fan_of(measured(emptied(scan, outside)))
    np.testing.assert_allclose(fan.x_mm, 2.5 * np.arange(DENSE), atol=1e-9)
    nothing = fan_of(measured(emptied(scan, np.arange(DENSE))))
    np.testing.assert_allclose(nothing.x_mm, 2.5 * np.arange(DENSE), atol=1e-9)


def test_the_apex_is_found_from_uneven_profiles_of_a_slanted_motion() -> None:
    slanted, rng = np.array([1.0, 0.2, -0.3]), np.random.default_rng(3)
    scan, _, _ = dense_pair(6)
    points_mm = scan.points_mm + scan.points_mm[..., :1] * (slanted - [1.0, 0.0, 0.0])
    uneven = Scan.from_points(points_mm[faster(rng)], 5.0, travel=slanted)
    np.testing.assert_allclose(fan_of(measured(uneven)).apex_mm[1:], [0.0, -60.0], atol=3.0)


def test_every_point_keeps_its_patch() -> None:
    scan, _, _ = dense_pair(7)
    lost = np.r_[20:23, 50, 80:95]
    kept = np.delete(np.arange(DENSE), lost)
    empty, closed = emptied(scan, lost), taken(scan, kept)
    patch = patch_of_points(empty, describe(empty, DEFAULTS))
    assert patch.shape == empty.points_mm.shape[:2]
    assert (patch[lost] == -1).all()
    np.testing.assert_array_equal(patch[kept], describe(closed, DEFAULTS).patches.label)


def test_a_patch_goes_on_over_a_gap_of_two_and_a_half() -> None:
    board = plates_from(
        np.array([[0.0, 0.1, -1.0]]), np.array([[150.0, 0, 700]]), np.full((1, 2), 500.0)
    )
    scan = scan_plates(board)
    for lost, patches in ((1, 1), (2, 2)):  # gaps of 2 and 3 steps
        kept = np.delete(np.arange(60), np.arange(30, 30 + lost))
        assert describe(taken(scan, kept), DEFAULTS).patches.n_points.size == patches


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
    edge = int(np.argmax(np.diff(x_mm)))

    def profile_at(x: float) -> int:
        return int(seen.profile_of[int((x - seen.x_low_mm) * seen.cells_per_mm)])

    assert profile_at(0.5 * (x_mm[edge] + x_mm[edge + 1])) == -1
    assert profile_at(x_mm[edge] + 2.0) == edge
    assert profile_at(x_mm[edge] + 9.0) == profile_at(x_mm[edge + 1] - 9.0) == -1
    nearest = seen.image.reshape(x_mm.size, -1, 3)[..., NEAREST]
    assert (nearest[[edge, edge + 1]] == -np.inf).all()
    assert np.isfinite(nearest[[edge - 1, edge + 2]]).any(axis=1).all()
