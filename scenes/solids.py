"""Convex solids, and how a list of them becomes a scene: one description for geoms and surfaces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from scenes.materials import MATERIALS
from scenes.scene import BODY, FloatArray, Scene, Surface

UPRIGHT = Rotation.identity()


@dataclass(frozen=True)
class Solid:
    """A convex polyhedron in its own frame, and where that frame stands in the world.

    The own frame has its origin in the middle of the base, X away from a viewer who looks along the
    world's X, Z up.

    corners_m: (k, 3) in the own frame.
    faces: label and corner indices of each face, counter-clockwise seen from outside.
    position_m: (3,) of the own origin in the world.
    half_size_m: (3,) when the solid is a box, which MuJoCo intersects faster than a mesh, or None.
    """

    name: str
    material: str
    corners_m: FloatArray
    faces: tuple[tuple[str, tuple[int, ...]], ...]
    rotation: Rotation
    position_m: FloatArray
    half_size_m: FloatArray | None = None

    def surfaces(self) -> tuple[Surface, ...]:
        """Every face as a surface in world coordinates, named `solid.label`."""
        corners_m = self.rotation.apply(self.corners_m) + self.position_m
        return tuple(
            Surface(f"{self.name}.{label}", self.name, corners_m[list(indices)], self.material)
            for label, indices in self.faces
        )


def turned(yaw_deg: float = 0.0, tilt_deg: float = 0.0, lean_deg: float = 0.0) -> Rotation:
    """A solid's orientation: lean to its right, then tilt back, then yaw to its left.

    Positive tilt lets the front face look up, positive yaw turns it counter-clockwise seen from
    above, positive lean lowers the side at -Y.
    """
    return Rotation.from_euler("ZYX", [yaw_deg, tilt_deg, lean_deg], degrees=True)


def box(
    name: str,
    size_m: ArrayLike,
    position_m: ArrayLike,
    rotation: Rotation = UPRIGHT,
    material: str = "matt_plastic",
) -> Solid:
    """A box of the given depth (X), width (Y) and height (Z) on the middle of its base."""
    half = np.asarray(size_m, dtype=float) / 2.0
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)
    corners_m = signs * half + [0.0, 0.0, half[2]]
    faces = (
        ("front", (0, 1, 3, 2)),
        ("back", (4, 6, 7, 5)),
        ("right", (0, 4, 5, 1)),
        ("left", (2, 3, 7, 6)),
        ("bottom", (0, 2, 6, 4)),
        ("top", (1, 5, 7, 3)),
    )
    return Solid(name, material, corners_m, faces, rotation, _vector(position_m), half)


def prism(
    name: str,
    outline_m: Sequence[tuple[float, float]],
    width_m: float,
    position_m: ArrayLike,
    rotation: Rotation = UPRIGHT,
    material: str = "matt_plastic",
    labels: Sequence[str] | None = None,
) -> Solid:
    """A convex outline in the own X-Z plane, drawn out along Y on both sides of the origin.

    outline_m: (x, z) corners, counter-clockwise when X points right and Z up.
    labels: a name for the face between each corner and the next; "face0", "face1", ... when None.
    Raises ValueError for an outline that is not convex or runs the other way round.
    """
    outline = _convex(name, outline_m)
    k = len(outline)
    corners_m = np.zeros((2 * k, 3))
    corners_m[:, [0, 2]] = np.tile(outline, (2, 1))
    corners_m[:k, 1], corners_m[k:, 1] = -width_m / 2.0, width_m / 2.0
    # Seen along +Y, X points right and Z up, so the face at -Y keeps the order of the outline.
    faces = _drawn_out(name, k, labels, ("right", "left"))
    return Solid(name, material, corners_m, faces, rotation, _vector(position_m))


def frustum(
    name: str,
    outline_m: Sequence[tuple[float, float]],
    height_m: float,
    position_m: ArrayLike,
    rotation: Rotation = UPRIGHT,
    material: str = "matt_plastic",
    labels: Sequence[str] | None = None,
    top_scale: float = 1.0,
    top_shift_m: tuple[float, float] = (0.0, 0.0),
) -> Solid:
    """A convex outline in the own X-Y plane, drawn up to a scaled and shifted copy of itself.

    outline_m: (x, y) corners of the base, counter-clockwise seen from above.
    labels: a name for the face over each edge of the base; "face0", "face1", ... when None.
    Raises ValueError for an outline that is not convex or runs the other way round.
    """
    outline = _convex(name, outline_m)
    k = len(outline)
    corners_m = np.zeros((2 * k, 3))
    corners_m[:k, :2] = top_scale * outline + top_shift_m
    corners_m[:k, 2] = height_m
    corners_m[k:, :2] = outline
    faces = _drawn_out(name, k, labels, ("top", "bottom"))
    return Solid(name, material, corners_m, faces, rotation, _vector(position_m))


def plate(
    name: str,
    size_m: tuple[float, float],
    position_m: ArrayLike,
    rotation: Rotation = UPRIGHT,
    material: str = "white_paper",
) -> Solid:
    """A rectangle (width along Y, height along Z) around the origin that looks along -X.

    Behind it stands a pyramid so flat (its height a twentieth of the shorter side) that nothing
    but the rectangle, labelled "front", is seen from less than 84 degrees off its normal.
    """
    half_y, half_z = size_m[0] / 2.0, size_m[1] / 2.0
    corners_m = np.array(
        [
            [0.0, -half_y, -half_z],
            [0.0, -half_y, half_z],
            [0.0, half_y, half_z],
            [0.0, half_y, -half_z],
            [min(size_m) / 20.0, 0.0, 0.0],
        ]
    )
    rim = tuple((f"rear{i}", ((i + 1) % 4, i, 4)) for i in range(4))
    faces = (("front", (0, 1, 2, 3)), *rim)
    return Solid(name, material, corners_m, faces, rotation, _vector(position_m))


def assemble(
    name: str, solids: Iterable[Solid], symmetries: tuple[RigidTransform, ...] = ()
) -> Scene:
    """Build the scene: a geom for every solid and a surface for every face of it.

    Raises ValueError for an unknown material or a name used twice.
    """
    spec = mujoco.MjSpec()
    spec.modelname = name
    body = spec.worldbody.add_body(name=BODY)
    surfaces: list[Surface] = []
    seen: set[str] = set()
    for solid in solids:
        if solid.name in seen:
            raise ValueError(f"scene {name!r}: two solids are called {solid.name!r}")
        if solid.material not in MATERIALS:
            raise ValueError(
                f"solid {solid.name!r}: unknown material {solid.material!r}; "
                f"known are {', '.join(MATERIALS)}"
            )
        seen.add(solid.name)
        _add_geom(spec, body, solid)
        surfaces.extend(solid.surfaces())
    return Scene(name, spec, tuple(surfaces), symmetries)


def _add_geom(spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid) -> None:
    position_m = solid.position_m
    quat_wxyz = solid.rotation.as_quat(scalar_first=True)
    rgba = [*MATERIALS[solid.material].rgb, 1.0]
    if solid.half_size_m is not None:
        # MuJoCo's boxes have their origin in the middle, ours in the middle of the base.
        centre_m = position_m + solid.rotation.apply([0.0, 0.0, solid.half_size_m[2]])
        body.add_geom(
            name=solid.name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=solid.half_size_m,
            pos=centre_m,
            quat=quat_wxyz,
            rgba=rgba,
        )
        return
    triangles = [
        (loop[0], loop[i], loop[i + 1]) for _, loop in solid.faces for i in range(1, len(loop) - 1)
    ]
    spec.add_mesh(
        name=solid.name, uservert=solid.corners_m.ravel(), userface=np.array(triangles).ravel()
    )
    body.add_geom(
        name=solid.name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=solid.name,
        pos=position_m,
        quat=quat_wxyz,
        rgba=rgba,
    )


def _vector(values: ArrayLike) -> FloatArray:
    vector: FloatArray = np.asarray(values, dtype=float)
    if vector.shape != (3,):
        raise ValueError(f"expected three coordinates, got shape {vector.shape}")
    return vector


def _convex(name: str, outline_m: Sequence[tuple[float, float]]) -> FloatArray:
    """The outline (k, 2), after making sure that it turns left at every corner."""
    outline: FloatArray = np.asarray(outline_m, dtype=float)
    edges = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edges, -1, axis=0)
    if (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] <= 0.0).any():
        raise ValueError(f"solid {name!r}: the outline must be convex and run counter-clockwise")
    return outline


def _drawn_out(
    name: str, k: int, labels: Sequence[str] | None, ends: tuple[str, str]
) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Faces between two outlines of k corners, the first seen counter-clockwise from outside."""
    names = [f"face{i}" for i in range(k)] if labels is None else list(labels)
    if len(names) != k:
        raise ValueError(f"solid {name!r}: {k} corners need {k} labels, got {len(names)}")
    sides = tuple((names[i], (i, k + i, k + (i + 1) % k, (i + 1) % k)) for i in range(k))
    return (*sides, (ends[0], tuple(range(k))), (ends[1], tuple(range(2 * k - 1, k - 1, -1))))
