"""Pictures of the arm before a scene: how it stands for each view, and the lines it drives."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from scenes.scene import Scene
from sensors import f3
from sensors.arm import ArmParams, ArmPath

Image = NDArray[np.uint8]

LINE_RGBA = ((0.84, 0.15, 0.16, 1), (0.17, 0.63, 0.17, 1), (0.12, 0.47, 0.71, 1), (1, 0.5, 0.05, 1))


def model_with_arm(scene: Scene, params: ArmParams) -> mujoco.MjModel:
    """Compile a scene with the arm on its track; the arm's joints are named "arm/..."."""
    spec = scene.spec.copy()
    T_world_base = params.T_world_base
    frame = spec.worldbody.add_frame(
        pos=T_world_base.translation / 1000.0,
        quat=T_world_base.rotation.as_quat(scalar_first=True),
    )
    spec.attach(f3.model_spec(), prefix="arm/", frame=frame)
    spec.visual.global_.offwidth = spec.visual.global_.offheight = 2000
    spec.visual.headlight.ambient = [0.45, 0.45, 0.45]
    spec.visual.headlight.diffuse = [0.55, 0.55, 0.55]
    white = [1.0, 1.0, 1.0]
    spec.add_texture(
        name="arm_picture_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=white,
        rgb2=white,
        width=64,
        height=64,
    )
    return spec.compile()


def place_arm(model: mujoco.MjModel, path: ArmPath, profile: int) -> mujoco.MjData:
    """Data of model_with_arm with the joints as the encoders read them at one profile."""
    data = mujoco.MjData(model)
    data.qpos[:] = f3.to_qpos(f3.from_pulses(path.counts[profile]))
    mujoco.mj_forward(model, data)
    return data


def picture(
    scene: Scene,
    params: ArmParams,
    path: ArmPath,
    paths: Mapping[str, ArmPath],
    size_px: tuple[int, int] = (900, 700),
) -> Image:
    """Render (height, width, 3) the arm half-way along one path, with all viewing lines drawn.

    paths: the lines to draw, in the order of LINE_RGBA; of each, the named ball is the first
    profile, the arrow the optical axis half-way. Needs a graphics library that MuJoCo can draw
    with (off-screen: the environment variable MUJOCO_GL=egl).
    """
    model = model_with_arm(scene, params)
    data = place_arm(model, path, path.profiles // 2)
    camera = mujoco.MjvCamera()
    points_m = np.concatenate([p.T_world_profile.translation for p in paths.values()]) / 1000.0
    camera.lookat = 0.5 * (points_m.min(axis=0) + points_m.max(axis=0)) + [0.15, 0.0, -0.2]
    camera.distance, camera.azimuth, camera.elevation = 2.6, 35.0, -25.0
    with mujoco.Renderer(model, height=size_px[1], width=size_px[0]) as renderer:
        renderer.update_scene(data, camera)
        for (name, line), rgba in zip(paths.items(), itertools.cycle(LINE_RGBA), strict=False):
            _draw_line(renderer.scene, name, line, rgba)
        image: Image = renderer.render().copy()
    return image


def _draw_line(scene: mujoco.MjvScene, name: str, path: ArmPath, rgba: tuple[float, ...]) -> None:
    places_m = path.T_world_profile.translation / 1000.0
    middle = path.T_world_profile[path.profiles // 2]
    ahead_m = middle.apply([0.0, 0.0, 400.0]) / 1000.0
    _add(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, places_m[0], places_m[-1], 0.008, rgba)
    _add(scene, mujoco.mjtGeom.mjGEOM_ARROW, middle.translation / 1000.0, ahead_m, 0.008, rgba)
    _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, places_m[0], None, 0.02, rgba)
    scene.geoms[scene.ngeom - 1].label = name


def _add(
    scene: mujoco.MjvScene,
    kind: int,
    start_m: NDArray[np.float64],
    end_m: NDArray[np.float64] | None,
    width_m: float,
    rgba: tuple[float, ...],
) -> None:
    geom = scene.geoms[scene.ngeom]
    scene.ngeom += 1
    colour = np.array(rgba, dtype=np.float32)
    mujoco.mjv_initGeom(geom, kind, np.full(3, width_m), start_m, np.eye(3).ravel(), colour)
    if end_m is not None:
        mujoco.mjv_connector(geom, kind, width_m, start_m, end_m)
