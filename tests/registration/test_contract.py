"""What other programs rely on, for every method."""

from __future__ import annotations

import numpy as np
import pytest
from plane_scans import plates_from, pose_error, scan_plates
from scipy.spatial.transform import RigidTransform

from registration import METHODS, RegistrationResult, Scan, register
from registration.peers import PEERS

# Other libraries answer whatever they are given; what holds for them is in test_peers.py.
pytestmark = pytest.mark.parametrize("method", [name for name in METHODS if name not in PEERS])


def empty(profiles: int = 20, pixels: int = 64) -> Scan:
    return Scan.from_points(np.full((profiles, pixels, 3), np.nan), step_mm=5.0)


def one_point() -> Scan:
    points_mm = np.full((20, 64, 3), np.nan)
    points_mm[7, 30] = [35.0, 1.0, 800.0]
    return Scan.from_points(points_mm, step_mm=5.0)


def faces(*normals: tuple[float, float, float]) -> Scan:
    """Plates side by side that face the sensor with these normals."""
    n = np.array(normals) / np.linalg.norm(normals, axis=1, keepdims=True)
    centres = np.array([[100.0, y, 900.0] for y in np.linspace(-130.0, 130.0, len(n))])
    centres[len(n) == 1] = [100.0, 0.0, 900.0]
    return scan_plates(plates_from(n, centres, np.full((len(n), 2), 50.0)), 40, 128)


POOR = {
    "no point": empty(),
    "one point": one_point(),
    "one profile": Scan.from_points(
        faces((0.1, 0.2, -1), (0.1, -0.3, -1), (0.4, 0, -1)).points_mm[20:21], step_mm=5.0
    ),
    "one plane": faces((0.1, 0.2, -1)),
    "parallel planes": faces((0.1, 0.2, -1), (0.1, 0.2, -1), (0.1, 0.2, -1)),
    "two planes": faces((0.1, 0.4, -1), (0.1, -0.4, -1)),
    "one pixel": Scan.from_points([[[0.0, 0.0, 500.0]]], step_mm=5.0),
    "two by two": Scan.from_points(
        [[[0, 0, 500], [0, 2, 500]], [[5, 0, 500], [5, 2, 500]]], step_mm=5.0
    ),
}


@pytest.mark.parametrize("poor", POOR)
@pytest.mark.parametrize("partner", ["itself", "good", "reversed"])
def test_poor_scans_come_back_with_status_and_reason(
    method: str, poor: str, partner: str, exact_pair
) -> None:
    scan = POOR[poor]
    pairs = {
        "itself": (scan, scan),
        "good": (scan, exact_pair.source),
        "reversed": (exact_pair.target, scan),
    }
    result = register(*pairs[partner], method=method)
    assert result.status != "ok"
    assert len(result.reason) > 20
    assert "\n" not in result.reason
    if result.T_target_source is not None:
        assert result.status in ("ambiguous", "underdetermined")


def test_scans_of_different_things_are_not_registered(method: str, exact_pair) -> None:
    other = faces((0.3, 0.2, -1), (-0.2, -0.5, -1), (0.5, 0.1, -1))
    result = register(exact_pair.target, other, method=method)
    assert result.status != "ok"
    assert result.reason


def test_an_overlapping_pair_is_registered(method: str, exact_pair) -> None:
    result = register(exact_pair.target, exact_pair.source, method=method)
    assert isinstance(result, RegistrationResult)
    assert (result.status, result.reason) == ("ok", "")
    angle_deg, distance_mm = pose_error(result.T_target_source, exact_pair.T_target_source)
    assert angle_deg < 1.0
    assert distance_mm < 15.0
    assert result.stage_ms
    assert all(0.0 <= ms < 60e3 for ms in result.stage_ms.values())
    assert result.undetermined.shape == (0, 6)
    assert all(isinstance(c.T_target_source, RigidTransform) for c in result.candidates)


def test_scans_are_not_altered_and_answers_repeat(method: str, noisy_pair) -> None:
    before = noisy_pair.target.points_mm.copy()
    results = [register(noisy_pair.target, noisy_pair.source, method=method) for _ in range(2)]
    np.testing.assert_array_equal(noisy_pair.target.points_mm, before)
    first, second = (r.T_target_source.as_matrix() for r in results)
    np.testing.assert_array_equal(first, second)
