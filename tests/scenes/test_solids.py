from dataclasses import replace

import numpy as np
import pytest

from scenes import SCENES
from scenes.materials import MATERIALS
from scenes.rays import cast_rays
from scenes.scene import Scene
from scenes.solids import assemble, box, frustum, plate, prism, turned

ALL = [(name, entry.builder(entry.params_type())) for name, entry in SCENES.items()]
SOLIDS = [
    box("box", [0.1, 0.2, 0.3], [0.4, -0.1, 0.2], turned(25.0, 10.0, -15.0)),
    prism("prism", [(0.0, 0.0), (0.2, 0.0), (0.1, 0.1)], 0.3, [1.0, 0.0, 0.0], turned(-40.0)),
    frustum(
        "frustum", [(-0.1, -0.1), (0.1, -0.1), (0.0, 0.2)], 0.3, [0.0, 1.0, 0.0], top_scale=0.4
    ),
    plate("plate", (0.2, 0.1), [0.0, -1.0, 0.0], turned(10.0, 20.0, 30.0)),
]


def _inside_points(polygon: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points inside of a convex polygon, many of them near its corners."""
    weights = rng.dirichlet(np.full(len(polygon), 0.5), count)
    return 0.95 * weights @ polygon + 0.05 * polygon.mean(axis=0)


def _covered(scene: Scene, geom: str, points: np.ndarray) -> np.ndarray:
    """Whether each point lies inside of a solid other than its own."""
    covered = np.zeros(len(points), dtype=bool)
    for other in {s.geom for s in scene.surfaces} - {geom}:
        heights = [(points - s.polygon_m[0]) @ s.normal for s in scene.surfaces if s.geom == other]
        covered |= np.max(heights, axis=0) < 1e-9
    return covered


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: solid.name)
def test_faces_close_around_the_solid_and_look_outwards(solid) -> None:
    surfaces = solid.surfaces()
    middle = solid.rotation.apply(solid.corners_m.mean(axis=0)) + solid.position_m
    area_vectors = np.zeros(3)
    for surface in surfaces:
        corners = surface.polygon_m
        assert (corners - corners[0]) @ surface.normal == pytest.approx(0.0, abs=1e-12)
        assert (middle - corners[0]) @ surface.normal < -1e-4
        area_vectors += 0.5 * np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    assert area_vectors == pytest.approx(np.zeros(3), abs=1e-12)
    edges = [
        edge for _, loop in solid.faces for edge in zip(loop, (*loop[1:], loop[0]), strict=True)
    ]
    # Every edge belongs to two faces, which run along it in opposite directions.
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)


@pytest.mark.parametrize(("name", "scene"), ALL, ids=[name for name, _ in ALL])
def test_a_ray_meets_every_surface_where_it_is_said_to_be(name: str, scene: Scene) -> None:
    """Polygons that touching or intersecting solids cover are left out, point by point."""
    rng = np.random.default_rng(7)
    gap_m = 1e-4
    wholly_covered = []
    for index, surface in enumerate(scene.surfaces):
        inside = _inside_points(surface.polygon_m, 40, rng)
        origins = inside + gap_m * surface.normal
        free = ~(_covered(scene, surface.geom, origins) | _covered(scene, surface.geom, inside))
        if not free.any():
            wholly_covered.append(surface.name)
            continue
        origins = origins[free]
        inward = np.repeat(-surface.normal[None], len(origins), axis=0)
        distance, met = cast_rays(scene, origins, inward, np.arange(len(origins)))
        assert (met == index).all(), surface.name
        assert distance == pytest.approx(gap_m, abs=1e-12)
    touching = {
        "desk": {
            *(f"{solid}.bottom" for solid in ("case", "foot", "stem", "keyboard", "lectern")),
            *(f"{solid}.bottom" for solid in ("roof", "left_speaker", "right_speaker")),
            "desk.back",
        },
        "foam_chair": {
            "seat.bottom",
            *(f"{side}_{part}.bottom" for side in ("left", "right") for part in ("wing", "arm")),
            *(f"{side}_wing.inner" for side in ("left", "right")),
        },
    }
    if name in touching:
        assert set(wholly_covered) == touching[name]


@pytest.mark.parametrize(("name", "scene"), ALL, ids=[name for name, _ in ALL])
def test_scenes_are_named_and_made_of_known_materials(name: str, scene: Scene) -> None:
    assert scene.name == name
    assert len({s.name for s in scene.surfaces}) == len(scene.surfaces)
    assert {s.material for s in scene.surfaces} <= MATERIALS.keys()
    assert {g.name for g in scene.spec.geoms} == {s.geom for s in scene.surfaces}


def test_a_plate_shows_only_its_front_to_a_view_off_its_normal() -> None:
    thin = plate("thin", (0.1, 0.08), [0.0, 0.0, 0.0])
    front, *rear = thin.surfaces()
    assert front.normal == pytest.approx([-1.0, 0.0, 0.0])
    turn_rad = np.radians(84.0)
    for angle in np.linspace(0.0, 2.0 * np.pi, 24):
        towards_viewer = [
            -np.cos(turn_rad),
            *(np.sin(turn_rad) * np.array([np.cos(angle), np.sin(angle)])),
        ]
        assert all(surface.normal @ towards_viewer < 0.0 for surface in rear)


def test_turned_follows_its_description() -> None:
    front = [-1.0, 0.0, 0.0]
    assert turned(tilt_deg=30.0).apply(front)[2] > 0.0
    assert turned(yaw_deg=90.0).apply(front) == pytest.approx([0.0, -1.0, 0.0])
    assert turned(lean_deg=30.0).apply([0.0, -1.0, 0.0])[2] < 0.0


def test_wrong_descriptions_are_refused_in_one_line() -> None:
    clockwise = [(0.0, 0.0), (0.1, 0.1), (0.1, 0.0)]
    dented = [(0.0, 0.0), (0.1, 0.0), (0.05, 0.02), (0.0, 0.1)]
    for outline in (clockwise, dented):
        with pytest.raises(ValueError, match="solid 'p': the outline must be convex"):
            prism("p", outline, 0.1, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="3 corners need 3 labels, got 1"):
        frustum("p", clockwise[::-1], 0.1, [0.0, 0.0, 0.0], labels=["only"])
    with pytest.raises(ValueError, match="unknown material 'cheese'; known are rough_foam"):
        assemble("s", [replace(SOLIDS[0], material="cheese")])
    with pytest.raises(ValueError, match="two solids are called 'box'"):
        assemble("s", [SOLIDS[0], SOLIDS[0]])
