"""What a scene is: MuJoCo geometry to cast rays at, and the exact surfaces it stands for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# The one body that carries every geom, so that a whole scene is moved by moving it.
BODY = "scene"


@dataclass(frozen=True)
class Surface:
    """One planar face, known exactly.

    polygon_m: (k, 3) corners in world coordinates, counter-clockwise seen from outside.
    geom: name of the MuJoCo geom that the face belongs to.
    material: a key of scenes.materials.MATERIALS.
    """

    name: str
    geom: str
    polygon_m: FloatArray
    material: str

    @property
    def normal(self) -> FloatArray:
        """(3,) unit normal that points out of the object (Newell's method)."""
        # About the centroid: far from the origin the cross products would cancel badly.
        corners = self.polygon_m - self.polygon_m.mean(axis=0)
        area_vector = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
        unit: FloatArray = area_vector / np.linalg.norm(area_vector)
        return unit


@dataclass(frozen=True, eq=False)  # equal only to itself: an MjSpec cannot be compared
class Scene:
    """A named arrangement of objects, in metres, Z up; to be read, never altered.

    spec: every geom is a child of the body named BODY; build scenes with scenes.solids.assemble.
    symmetries: world poses other than the identity that map the scene onto itself; translations
        in mm, as every pose of this project.
    """

    name: str
    spec: mujoco.MjSpec
    surfaces: tuple[Surface, ...]
    symmetries: tuple[RigidTransform, ...] = field(default=())


def moved(scene: Scene, T_world: RigidTransform) -> Scene:
    """Carry everything in the scene by a world pose (mm): geoms, surfaces and symmetries."""
    spec = scene.spec.copy()
    body = spec.body(BODY)
    T_body = RigidTransform.from_components(
        1000.0 * body.pos, Rotation.from_quat(body.quat, scalar_first=True)
    )
    T_moved = T_world * T_body
    body.pos = T_moved.translation / 1000.0
    body.quat = T_moved.rotation.as_quat(scalar_first=True)
    surfaces = tuple(
        replace(surface, polygon_m=T_world.apply(1000.0 * surface.polygon_m) / 1000.0)
        for surface in scene.surfaces
    )
    symmetries = tuple(T_world * symmetry * T_world.inv() for symmetry in scene.symmetries)
    return Scene(scene.name, spec, surfaces, symmetries)
