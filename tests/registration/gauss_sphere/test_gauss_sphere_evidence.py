"""What the method leaves for figures: pieces on the measured points, and the poses proposed."""

from __future__ import annotations

import numpy as np

from registration import Scan, register
from registration.gauss_sphere.evidence import PlaneEvidence, segment_ends, shifts_of_middle


def stairs(travel: tuple[float, float, float] | None = None) -> Scan:
    """Three boards at angles, without noise, whose beams meet 60 mm behind the front."""
    profiles, slope = 5.0 * np.arange(40), np.linspace(-0.23, 0.23, 128)
    x, s = np.meshgrid(profiles, slope, indexing="ij")
    tilt = np.where(s < -0.08, 0.5, np.where(s < 0.08, -0.1, -0.6))
    depth = (700.0 + np.where(s < 0.0, 0.3, -0.2) * x) / (1.0 + tilt * s)
    points = np.stack([x, s * depth, depth - 60.0], axis=2)
    if travel is None:
        return Scan.from_points(points, 5.0)
    axis = np.asarray(travel) / np.linalg.norm(travel)
    points += x[..., None] * (axis / axis[0] - [1.0, 0.0, 0.0])
    return Scan.from_points(points, 5.0, travel=tuple(axis))


def test_line_segments_end_on_the_measured_points() -> None:
    for scan in (stairs(), stairs((1.0, 0.2, -0.3))):
        seen = register(scan, scan).evidence["planes"]
        assert isinstance(seen, PlaneEvidence)
        ends = segment_ends(seen.target.fan, seen.params)
        assert len(ends) >= 2 * 40
        points = scan.points_mm.reshape(-1, 3)
        for end in ends[:: len(ends) // 20].reshape(-1, 3):
            assert np.linalg.norm(points - end, axis=1).min() < 0.5


def test_the_proposed_shifts_hold_the_answer() -> None:
    result = register(stairs(), stairs())
    assert result.T_target_source is not None
    seen = result.evidence["planes"]
    pose = result.T_target_source
    shifts, angle, area = shifts_of_middle(seen, pose.rotation.as_matrix())
    assert shifts.shape == (len(angle), 3) == (len(area), 3)
    near = (np.linalg.norm(shifts - pose.translation, axis=1) < 15.0) & (angle < 0.05)
    assert near.any()


def test_a_pair_without_a_pose_still_shows_its_planes() -> None:
    flat = np.stack(
        [*np.meshgrid(5.0 * np.arange(30), np.linspace(-150, 150, 64), indexing="ij"),
         np.full((30, 64), 700.0)], axis=2,
    )  # fmt: skip
    result = register(Scan.from_points(flat, 5.0), stairs())
    assert result.T_target_source is None
    seen = result.evidence["planes"]
    assert len(seen.pairs) == 0
    assert len(segment_ends(seen.target.fan, seen.params)) == 30
