"""A flat board, as for the precision analysis of section 3.2.3."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from scenes.scene import Scene
from scenes.solids import assemble, box


@dataclass(frozen=True)
class FlatTargetParams:
    """Size of the board, in mm; the default fills the sensor's field at its far limit."""

    width_mm: float = 800.0
    height_mm: float = 800.0
    thickness_mm: float = 10.0

    def __post_init__(self) -> None:
        for name in ("width_mm", "height_mm", "thickness_mm"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}; expected a length above 0 mm")


@lru_cache(maxsize=8)
def flat_target(params: FlatTargetParams) -> Scene:
    """Stand the board upright, its front, which faces -X, centred on the world's origin.

    Half turns about its three axes map it onto itself, and a square one is mapped so by quarter
    turns about its normal and half turns about its diagonals too.
    """
    depth_m, width_m, height_m = (
        length_mm / 1000.0 for length_mm in (params.thickness_mm, params.width_mm, params.height_mm)
    )
    size_m, base_m = [depth_m, width_m, height_m], [depth_m / 2.0, 0.0, -height_m / 2.0]
    middle = RigidTransform.from_translation([params.thickness_mm / 2.0, 0.0, 0.0])
    square = params.width_mm == params.height_mm
    about_normal = np.arange(1, 4) * (np.pi / 2.0) if square else np.array([np.pi])
    in_plane = np.arange(4 if square else 2) * (np.pi / (4.0 if square else 2.0))
    turns = [[angle, 0.0, 0.0] for angle in about_normal]
    turns += [[0.0, np.pi * np.cos(angle), np.pi * np.sin(angle)] for angle in in_plane]
    symmetries = tuple(
        middle * RigidTransform.from_rotation(Rotation.from_rotvec(turn)) * middle.inv()
        for turn in turns
    )
    board = box("board", size_m, base_m, material="white_paper")
    return assemble("flat_target", [board], symmetries)
