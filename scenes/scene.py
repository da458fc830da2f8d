"""What a scene is: MuJoCo geometry to cast rays at, and the exact surfaces it stands for."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """One planar face, known exactly.

    polygon_m: (k, 3) corners in world coordinates, counter-clockwise seen from outside.
    geom: name of the MuJoCo geom that the face belongs to.
    """

    name: str
    geom: str
    polygon_m: FloatArray
    material: str

    @property
    def normal(self) -> FloatArray:
        """(3,) unit normal that points out of the object (Newell's method)."""
        following = np.roll(self.polygon_m, -1, axis=0)
        area_vector = np.cross(self.polygon_m, following).sum(axis=0)
        unit: FloatArray = area_vector / np.linalg.norm(area_vector)
        return unit


@dataclass(frozen=True)
class Scene:
    """A named arrangement of objects, in metres, Z up.

    symmetries: world poses other than the identity that map the scene onto itself; translations
        in mm, as every pose of this project.
    """

    name: str
    spec: mujoco.MjSpec
    surfaces: tuple[Surface, ...]
    symmetries: tuple[RigidTransform, ...] = field(default=())
