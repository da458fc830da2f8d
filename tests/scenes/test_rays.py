import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from scenes import SCENES
from scenes.rays import RayError, cast_fans, cast_rays, ray_target
from scenes.scene import Scene, moved
from scenes.solids import assemble, box, prism

ALL = [(name, entry.builder(entry.params_type())) for name, entry in SCENES.items()]
SCENE_IDS = [name for name, _ in ALL]


def _fans(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Fans of 200 rays towards the scene, from a metre away and of different lengths."""
    towards = rng.normal(size=(12, 3))
    towards[:, 0] = -np.abs(towards[:, 0])
    towards[:, 2] = np.abs(towards[:, 2])
    origins = 1.1 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    aims = rng.uniform([-0.45, -0.45, -0.35], [0.45, 0.45, 0.55], (12, 200, 3))
    return origins, (aims - origins[:, None]) * rng.uniform(0.5, 3.0, (12, 200, 1))


@pytest.mark.parametrize(("name", "scene"), ALL, ids=SCENE_IDS)
def test_many_rays_meet_what_single_rays_meet(name: str, scene: Scene) -> None:
    origins, directions = _fans(np.random.default_rng(3))
    target = ray_target(scene)
    distance, surface = cast_fans(scene, origins, directions)
    geom_of = [target.model.geom(s.geom).id for s in scene.surfaces] + [-1]
    hits = 0
    for k, fan in enumerate(directions):
        together = np.empty(len(fan))
        mujoco.mj_multiRay(
            target.model, target.data, origins[k], fan.ravel(), None, True, -1,
            np.empty(len(fan), np.int32), together, None, len(fan), mujoco.mjMAXVAL,
        )  # fmt: skip
        for i, direction in enumerate(fan):
            geom, normal = np.full(1, -1, np.int32), np.zeros(3)
            alone = mujoco.mj_ray(
                target.model, target.data, origins[k], direction, None, True, -1, geom, normal
            )
            assert together[i] == alone
            assert geom_of[surface[k, i]] == geom[0]
            if geom[0] < 0:
                assert np.isnan(distance[k, i])
                continue
            hits += 1
            plane = target.normal[surface[k, i]]
            assert plane @ normal == pytest.approx(1.0, abs=1e-6)
            # Along the normal: MuJoCo keeps the corners of meshes in single precision.
            assert abs((distance[k, i] - alone) * (plane @ direction)) < 1e-7
    assert hits > 100


def test_a_hit_lies_inside_of_the_polygon_it_is_said_to_meet() -> None:
    scene = dict(ALL)["desk"]
    origins, directions = _fans(np.random.default_rng(4))
    distance, surface = cast_fans(scene, origins, directions)
    met = surface >= 0
    points = (origins[:, None] + distance[..., None] * directions)[met]
    for point, index in zip(points, surface[met], strict=True):
        corners = scene.surfaces[index].polygon_m
        edges = np.roll(corners, -1, axis=0) - corners
        inwards = np.cross(scene.surfaces[index].normal, edges)
        inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
        assert np.einsum("ki,ki->k", inwards, point - corners).min() > -1e-6


def test_fans_of_different_size_and_empty_ones() -> None:
    scene = assemble("one", [box("cube", [1.0, 1.0, 1.0], [2.0, 0.0, -0.5])])
    origins = np.array([[0.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.5, 0.1, 0.0]])
    ahead, up = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    directions = np.array([ahead, up, ahead])
    distance, surface = cast_rays(scene, origins, directions, np.array([0, 0, 2]))
    assert distance == pytest.approx([1.5, np.nan, 1.0], nan_ok=True)
    assert [scene.surfaces[i].name if i >= 0 else None for i in surface] == [
        "cube.front",
        None,
        "cube.front",
    ]


def test_distances_are_in_units_of_the_direction() -> None:
    scene = dict(ALL)["foam_chair"]
    origins, directions = _fans(np.random.default_rng(5))
    distance, surface = cast_fans(scene, origins, directions)
    halved, again = cast_fans(scene, origins, 2.0 * directions)
    assert (again == surface).all()
    assert 2.0 * halved == pytest.approx(distance, rel=1e-12, nan_ok=True)


@pytest.mark.parametrize("name", ["desk", "clutter"])
def test_a_moved_scene_meets_moved_rays_alike(name: str) -> None:
    scene = dict(ALL)[name]
    rng = np.random.default_rng(6)
    T_world = RigidTransform.from_components(
        rng.uniform(-800.0, 800.0, 3), Rotation.random(rng=rng)
    )
    origins, directions = _fans(rng)
    moved_origins = T_world.apply(1000.0 * origins) / 1000.0
    moved_directions = directions @ T_world.rotation.as_matrix().T
    distance, surface = cast_fans(scene, origins, directions)
    again, same = cast_fans(moved(scene, T_world), moved_origins, moved_directions)
    assert (same == surface).all()
    assert again == pytest.approx(distance, abs=1e-9, nan_ok=True)


def test_moving_twice_is_moving_by_the_product() -> None:
    scene = assemble(
        "two",
        [
            box("cube", [0.1, 0.2, 0.3], [0.4, 0.0, 0.0]),
            prism("wedge", [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1)], 0.1, [0.0, 0.3, 0.0]),
        ],
    )
    rng = np.random.default_rng(8)
    first, second = (
        RigidTransform.from_components(rng.uniform(-500.0, 500.0, 3), Rotation.random(rng=rng))
        for _ in range(2)
    )
    twice, once = moved(moved(scene, first), second), moved(scene, second * first)
    for a, b in zip(twice.surfaces, once.surfaces, strict=True):
        assert a.polygon_m == pytest.approx(b.polygon_m, abs=1e-12)
    a, b = ray_target(twice).data.geom_xpos, ray_target(once).data.geom_xpos
    assert a == pytest.approx(b, abs=1e-12)


def test_a_scene_is_compiled_once() -> None:
    scene = dict(ALL)["desk"]
    assert ray_target(scene) is ray_target(scene)


@pytest.mark.parametrize("solid", ["cube", "wedge"])
def test_a_ray_from_inside_of_a_solid_is_refused(solid: str) -> None:
    scene = assemble(
        "two",
        [
            box("cube", [0.2, 0.2, 0.2], [0.0, 0.0, 0.0]),
            prism("wedge", [(0.0, 0.0), (0.2, 0.0), (0.2, 0.2)], 0.2, [1.0, 0.0, 0.0]),
        ],
    )
    inside = {"cube": [0.0, 0.0, 0.1], "wedge": [1.15, 0.0, 0.1]}[solid]
    for direction in np.random.default_rng(1).normal(size=(20, 3)):
        with pytest.raises(RayError, match=f"scene 'two': a ray starts inside of '{solid}'"):
            cast_fans(scene, np.array([inside]), direction[None, None])


def test_rays_at_the_edges_of_a_solid_do_not_start_inside_of_it() -> None:
    # Meshes are of single precision: along one edge in some hundred, rays slip in between faces.
    rng = np.random.default_rng(0)
    outline = [(0.0, 0.0), (0.2, 0.0), (0.13, 0.17)]
    for _ in range(20):
        scene = assemble("one", [prism("wedge", outline, 0.2, rng.uniform(-0.1, 0.1, 3))])
        ends = [
            (a, b)
            for face in scene.surfaces
            for a, b in zip(face.polygon_m, np.roll(face.polygon_m, -1, axis=0), strict=True)
        ]
        origins = np.repeat(rng.normal(size=(20, 3)), len(ends), axis=0)
        origins /= np.linalg.norm(origins, axis=1, keepdims=True)
        first, last = np.array(20 * ends).transpose(1, 0, 2)
        ahead = first + rng.uniform(size=(len(first), 1)) * (last - first) - origins
        distance, surface = cast_fans(scene, origins, ahead[:, None])
        assert (np.isnan(distance) == (surface < 0)).all()
        met = surface[:, 0] >= 0
        # What is met is an end of the solid that faces the sensor, at the edge or before it.
        assert (distance[met] < 1.0 + 1e-6).all()


def test_a_ray_along_a_face_meets_nothing() -> None:
    scene = assemble("cube", [box("cube", [0.2, 0.2, 0.2], [0.0, 0.0, 0.0])])
    origin = np.array([[-1.0, 0.0, 0.2]])
    names = [s.name for s in scene.surfaces]
    for slope, met in ((1e-3, None), (-1e-3, "cube.front")):
        distance, surface = cast_fans(scene, origin, np.array([[[1.0, 0.0, slope]]]))
        assert surface[0, 0] == (names.index(met) if met else -1)
        assert np.isnan(distance[0, 0]) == (met is None)
    above = np.array([[-1.0, 0.0, 0.2 + 4e-8]])
    distance, surface = cast_fans(scene, above, np.array([[[1.0, 0.0, -4e-8]]]))
    assert surface[0, 0] == -1
    assert np.isnan(distance[0, 0])
