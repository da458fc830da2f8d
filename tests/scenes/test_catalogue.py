import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from scenes import SCENES
from scenes.clutter import WALL_GAP_M, ClutterParams, clutter
from scenes.flat_target import FlatTargetParams, flat_target
from scenes.scene import Scene, moved
from scenes.separated_planes import SeparatedPlanesParams, separated_planes


def _corners(scene: Scene) -> np.ndarray:
    corners = np.concatenate([s.polygon_m for s in scene.surfaces])
    return corners[np.lexsort(np.round(corners, 9).T)]


@pytest.mark.parametrize("name", SCENES)
def test_equal_params_give_an_equal_scene(name: str) -> None:
    builder, params_type = SCENES[name]
    first, second = (builder.__wrapped__(params_type()) for _ in range(2))
    assert first is not second
    assert [s.name for s in first.surfaces] == [s.name for s in second.surfaces]
    assert (_corners(first) == _corners(second)).all()


def test_another_seed_gives_another_clutter_of_the_size_asked_for() -> None:
    one, other = clutter(ClutterParams(seed=1)), clutter(ClutterParams(seed=2))
    assert not np.array_equal(one.surfaces[20].polygon_m, other.surfaces[20].polygon_m)
    for count in (1, 5):
        scene = clutter(ClutterParams(seed=3, solids=count))
        solids = {s.geom for s in scene.surfaces} - {"floor", "wall"}
        assert len(solids) == count


@pytest.mark.parametrize("seed", range(20))
def test_clutter_stands_on_the_floor_in_front_of_the_wall(seed: int) -> None:
    scene = clutter(ClutterParams(seed=seed))
    wall = next(s for s in scene.surfaces if s.name == "wall.front")
    gaps = []
    for geom in {s.geom for s in scene.surfaces} - {"floor", "wall"}:
        corners = np.concatenate([s.polygon_m for s in scene.surfaces if s.geom == geom])
        assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-12)
        gaps.append(((corners - wall.polygon_m[0]) @ wall.normal).min())
    assert min(gaps) == pytest.approx(WALL_GAP_M)


@pytest.mark.parametrize(
    "params", [FlatTargetParams(), FlatTargetParams(width_mm=600.0, height_mm=400.0)]
)
def test_symmetries_map_the_flat_target_onto_itself(params: FlatTargetParams) -> None:
    rng = np.random.default_rng(2)
    T_world = RigidTransform.from_components(
        rng.uniform(-300.0, 300.0, 3), Rotation.random(rng=rng)
    )
    for scene in (flat_target(params), moved(flat_target(params), T_world)):
        assert len(scene.symmetries) == (7 if params.width_mm == params.height_mm else 3)
        turns = [symmetry.rotation.as_matrix() for symmetry in scene.symmetries]
        for i, turn in enumerate(turns):
            assert not any(np.allclose(turn, other) for other in [np.eye(3), *turns[:i]])
        for symmetry in scene.symmetries:
            mapped = moved(scene, symmetry)
            gaps = np.linalg.norm(_corners(mapped)[:, None] - _corners(scene)[None], axis=2)
            assert gaps.min(axis=1).max() < 1e-12
            assert gaps.min(axis=0).max() < 1e-12


def test_separated_planes_differ_in_direction() -> None:
    scene = separated_planes(SeparatedPlanesParams())
    normals = np.array([s.normal for s in scene.surfaces if s.name.endswith(".front")])
    assert len(normals) == 7
    i, j = np.triu_indices(7, 1)
    sines = np.linalg.norm(np.cross(normals[i], normals[j]), axis=1)
    assert sines.min() > np.sin(np.radians(11.0))
    # All of them look towards the side from which they are scanned.
    assert (normals[:, 0] < -np.cos(np.radians(45.0))).all()


@pytest.mark.parametrize(
    ("params_type", "wrong", "message"),
    [
        (ClutterParams, {"seed": -1}, "seed is -1; expected 0 or above"),
        (ClutterParams, {"solids": 0}, "solids is 0; expected at least 1"),
        (ClutterParams, {"size_min_mm": 300.0}, "the maximum not below the minimum"),
        (ClutterParams, {"spread_mm": -5.0}, "spread_mm is -5.0"),
        (ClutterParams, {"tilt_max_deg": 95.0}, "expected 0 to 90 degrees"),
        (FlatTargetParams, {"width_mm": 0.0}, "width_mm is 0.0; expected a length above 0 mm"),
    ],
)
def test_impossible_params_are_refused(params_type: type, wrong: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        params_type(**wrong)
