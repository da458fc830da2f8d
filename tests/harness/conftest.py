from __future__ import annotations

from pathlib import Path

import pytest

SMALL = """\
title: Three plates, seen twice
scene: {name: separated_planes}
sensor:
  name: jupiter
  # What is left is random and gentle: these tests are about trials, not about the method.
  params:
    noise: {bulge: none, speckle: false, texture: false, dropout: false, shadow: false,
            ghosts: false, mixed: false, sigma_far_mm: 0.6}
scan: {profiles: 48, step_mm: 5.0}
views:
  left: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: -8, pitch_deg: 10}
  right: {placed_by: "a.b"}
  third: {relative_to: left, rotation_deg: [4, 0, 0], translation_mm: [0, -50, 0]}
pairs:
  "a.b":
    source: left
    target: right
    printed: {rotation_deg: [1, 2, 12], translation_mm: [5, -140, 10]}
    estimated: {rotation_deg: [1.5, 2, 11], translation_mm: [5, -144, 13]}
  plain: {source: third, target: left}
methods:
  - {name: thesis}
repeats: 2
seed: 3
"""


@pytest.fixture
def small_file(tmp_path: Path) -> Path:
    """An experiment of two pairs and two repeats that takes a moment."""
    path = tmp_path / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    return path
