"""The arm before a scene as faces to draw, and as a model that tells where it would touch it."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from scenes.materials import MATERIALS
from scenes.raster import Polygons, joined
from scenes.scene import FloatArray, Scene
from sensors import f3
from sensors.arm import ArmParams, ArmPath

PREFIX = "arm/"
CYLINDER_SIDES = 40


def model_with_arm(scene: Scene, params: ArmParams) -> mujoco.MjModel:
    """Compile a scene with the arm on its track; names of the arm begin with PREFIX."""
    spec = scene.spec.copy()
    T_world_base = params.T_world_base
    frame = spec.worldbody.add_frame(
        pos=T_world_base.translation / 1000.0,
        quat=T_world_base.rotation.as_quat(scalar_first=True),
    )
    spec.attach(f3.model_spec(), prefix=PREFIX, frame=frame)
    return spec.compile()


def place_arm(model: mujoco.MjModel, path: ArmPath, profile: int) -> mujoco.MjData:
    """Data of model_with_arm with the joints as the encoders read them at one profile."""
    data = mujoco.MjData(model)
    data.qpos[:] = f3.to_qpos(f3.from_pulses(path.counts[profile]))
    mujoco.mj_forward(model, data)
    return data


def faces_before(scene: Scene, params: ArmParams, path: ArmPath, profile: int) -> Polygons:
    """All faces of a scene and of the arm as it stands at one profile of a path."""
    model = model_with_arm(scene, params)
    data = place_arm(model, path, profile)
    return joined([scene_faces(scene), _arm_faces(model, data)])


def scene_faces(scene: Scene) -> Polygons:
    """All faces of a scene in the colours of their materials."""
    surfaces = scene.surfaces
    rgb = np.array([MATERIALS[surface.material].rgb for surface in surfaces])
    return Polygons(tuple(s.polygon_m for s in surfaces), rgb, np.arange(len(surfaces)))


def _arm_faces(model: mujoco.MjModel, data: mujoco.MjData) -> Polygons:
    corners_m: list[FloatArray] = []
    rgb: list[FloatArray] = []
    body: list[int] = []
    for geom in range(model.ngeom):
        if not model.body(int(model.geom_bodyid[geom])).name.startswith(PREFIX):
            continue
        pose = RigidTransform.from_components(
            data.geom_xpos[geom], Rotation.from_matrix(data.geom_xmat[geom].reshape(3, 3))
        )
        round_side = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
        if not round_side and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_BOX:
            raise ValueError("the arm's model holds a geom that is neither a box nor a cylinder")
        outline, half_height_m = _outline(model.geom_size[geom], round_side)
        faces = _drawn_out(outline, half_height_m)
        corners_m += [pose.apply(face) for face in faces]
        rgb += [model.geom_rgba[geom, :3]] * len(faces)
        start = body[-1] + 1 if body else 0
        # The narrow faces round a cylinder meet without a line; its ends come last.
        sides = [0] * len(outline) if round_side else list(range(len(outline)))
        body += [start + part for part in (*sides, sides[-1] + 1, sides[-1] + 2)]
    return Polygons(tuple(corners_m), np.array(rgb, dtype=np.float64), np.array(body))


def _outline(size_m: FloatArray, round_side: bool) -> tuple[FloatArray, float]:
    """Corners (k, 2) of a geom across its Z, counter-clockwise, and half of its height."""
    if round_side:
        turn = 2.0 * np.pi * np.arange(CYLINDER_SIDES) / CYLINDER_SIDES
        return size_m[0] * np.stack([np.cos(turn), np.sin(turn)], axis=1), float(size_m[1])
    return size_m[:2] * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]), float(size_m[2])


def _drawn_out(outline_m: FloatArray, half_height_m: float) -> list[FloatArray]:
    """The faces between an outline and its copy above: the sides, then bottom and top."""
    low = np.column_stack([outline_m, np.full(len(outline_m), -half_height_m)])
    high = low * np.array([1.0, 1.0, -1.0])
    following = np.roll(np.arange(len(outline_m)), -1)
    sides = [np.array([low[i], low[j], high[j], high[i]]) for i, j in enumerate(following.tolist())]
    return [*sides, low[::-1], high]
