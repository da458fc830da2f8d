"""Rays cast at a scene: which surface each one meets first, and exactly where."""

from __future__ import annotations

import itertools
import threading
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from numpy.typing import NDArray

from scenes.scene import FloatArray, IntArray, Scene


class RayError(ValueError):
    """The rays cannot be cast at this scene; the message says why."""


@dataclass(frozen=True)
class RayTarget:
    """A scene compiled for MuJoCo, with its surfaces sorted by the geom they belong to.

    normal: (surfaces + 1, 3) outward unit normals; the last row, NaN, stands for no surface.
    offset_m: (surfaces + 1,) with normal . p = offset on the surface.
    surface_of_geom: (geoms + 1, faces) surface indices, filled up with the last row's index; the
        last geom stands for a miss, so that MuJoCo's geom -1 indexes it.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    normal: FloatArray
    offset_m: FloatArray
    surface_of_geom: IntArray


class _Targets(threading.local):
    """Compiled scenes of one thread: mj_multiRay writes into the MjData it is given."""

    def __init__(self) -> None:
        self.by_scene: WeakKeyDictionary[Scene, RayTarget] = WeakKeyDictionary()


_targets = _Targets()


def ray_target(scene: Scene) -> RayTarget:
    """Compile a scene for ray-casting, once as long as the scene lives."""
    target = _targets.by_scene.get(scene)
    if target is None:
        target = _targets.by_scene[scene] = _compile(scene)
    return target


def cast_rays(
    scene: Scene, origins_m: FloatArray, directions: FloatArray, fan: IntArray
) -> tuple[FloatArray, IntArray]:
    """Cast rays that leave from a few origins: fans of rays.

    origins_m: (fans, 3) in world coordinates, outside of every solid.
    directions: (n, 3), of any length.
    fan: (n,) the origin of each ray, in ascending order: MuJoCo is called once a fan.
    Returns the distance (n,) in units of the length of each direction, NaN for a ray that meets
    nothing, and the surface (n,) as an index into scene.surfaces, -1 for none; a ray within a
    microradian of a face's plane meets nothing, nor does one that slips in between two faces along
    their edge, whose mesh is that imprecise. Raises RayError for an origin inside of a solid.

    MuJoCo finds the face, and the distance is then taken from the face's exact plane: meshes are
    stored in single precision, which would cost up to 1e-4 mm.
    """
    target = ray_target(scene)
    n = len(directions)
    geom = np.full(n, -1, dtype=np.int32)
    normal = np.zeros((n, 3))
    distance = np.empty(n)
    vectors = np.ascontiguousarray(directions, dtype=np.float64)
    ends = np.searchsorted(fan, np.arange(len(origins_m) + 1)).tolist()
    for k, (first, end) in enumerate(itertools.pairwise(ends)):
        if first == end:
            continue
        mujoco.mj_multiRay(
            target.model,
            target.data,
            origins_m[k],
            vectors[first:end].reshape(-1),
            None,  # every geom group
            True,  # static geoms too: all of ours are
            -1,  # exclude no body
            geom[first:end],
            distance[first:end],
            normal[first:end].reshape(-1),
            end - first,
            mujoco.mjMAXVAL,
        )
    surface = _face_met(target, geom, normal)
    plane = target.normal[surface]
    ahead = np.einsum("ni,ni->n", plane, vectors)
    grazing = 1e-6 * np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    for i in np.flatnonzero(ahead > grazing):
        if _is_inside(target, geom[i], origins_m[fan[i]]):
            solid = scene.surfaces[surface[i]].geom
            raise RayError(
                f"scene {scene.name!r}: a ray starts inside of {solid!r}; the sensor has to stay "
                "outside of every solid"
            )
    surface[ahead >= -grazing] = -1
    plane = target.normal[surface]
    height_m = target.offset_m[surface] - np.einsum("ni,ni->n", plane, origins_m[fan])
    return height_m / ahead, surface


def cast_fans(
    scene: Scene, origins_m: FloatArray, directions: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Cast fans of equally many rays: cast_rays with directions (fans, rays, 3).

    Returns distance and surface, both (fans, rays).
    """
    fans, rays = directions.shape[:2]
    fan = np.repeat(np.arange(fans), rays)
    distance, surface = cast_rays(scene, origins_m, directions.reshape(-1, 3), fan)
    return distance.reshape(fans, rays), surface.reshape(fans, rays)


def _face_met(target: RayTarget, geom: NDArray[np.int32], normal: FloatArray) -> IntArray:
    """The face of the geom whose outward normal is nearest to the one MuJoCo reports."""
    surface = np.full(len(geom), -1)
    best = np.full(len(geom), -np.inf)
    for faces in target.surface_of_geom.T:
        candidate = faces[geom]
        likeness = np.einsum("ni,ni->n", target.normal[candidate], normal)
        nearer = likeness > best  # False where there is no further face: its normal is NaN
        surface[nearer], best[nearer] = candidate[nearer], likeness[nearer]
    return surface


def _is_inside(target: RayTarget, geom: int, point_m: FloatArray) -> bool:
    """Whether a point lies inside of a geom: solids are convex."""
    faces = target.surface_of_geom[geom]
    height_m = target.normal[faces] @ point_m - target.offset_m[faces]
    return not (height_m > 0.0).any()  # heights above faces that there are none of are NaN


def _compile(scene: Scene) -> RayTarget:
    model = scene.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)  # before it every ray silently misses
    normal = np.full((len(scene.surfaces) + 1, 3), np.nan)
    offset_m = np.full(len(scene.surfaces) + 1, np.nan)
    members: list[list[int]] = [[] for _ in range(model.ngeom)]
    for i, surface in enumerate(scene.surfaces):
        normal[i] = surface.normal
        offset_m[i] = normal[i] @ surface.polygon_m.mean(axis=0)
        members[model.geom(surface.geom).id].append(i)
    surface_of_geom = np.full(
        (model.ngeom + 1, max(len(faces) for faces in members)), len(scene.surfaces)
    )
    for row, faces in zip(surface_of_geom, members, strict=False):
        row[: len(faces)] = faces
    return RayTarget(model, data, normal, offset_m, surface_of_geom)
