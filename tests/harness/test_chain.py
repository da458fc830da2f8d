from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from harness.chain import Link, middle_view, poses_in

RNG = np.random.default_rng(8)
NAMES = ["a", "b", "c", "d"]
T_WORLD = {
    name: RigidTransform.from_components(RNG.uniform(-500, 500, 3), Rotation.random(rng=RNG))
    for name in NAMES
}


def link(target: str, source: str) -> Link:
    return Link(target, source, T_WORLD[target].inv() * T_WORLD[source])


@pytest.mark.parametrize("reference", NAMES)
@pytest.mark.parametrize(
    "pairs", [["ab", "bc", "cd"], ["dc", "ba", "cb"], ["ab", "ac", "ad"], ["ca", "cb", "dc", "da"]]
)
def test_exact_links_give_exact_poses_whichever_way_they_point(
    reference: str, pairs: list[str]
) -> None:
    poses = poses_in(reference, [link(*pair) for pair in pairs])
    assert set(poses) == set(NAMES)
    for name, pose in poses.items():
        expected = T_WORLD[reference].inv() * T_WORLD[name]
        np.testing.assert_allclose(pose.as_matrix(), expected.as_matrix(), atol=1e-9)


def test_what_no_link_leads_to_is_left_out() -> None:
    assert set(poses_in("a", [link("a", "b"), link("c", "d")])) == {"a", "b"}
    assert set(poses_in("a", [])) == {"a"}


def test_the_shortest_chain_is_taken() -> None:
    wrong = Link("b", "c", RigidTransform.from_translation([1e4, 0.0, 0.0]))
    poses = poses_in("a", [link("a", "b"), wrong, link("a", "c")])
    np.testing.assert_allclose(poses["c"].as_matrix(), link("a", "c")[2].as_matrix(), atol=1e-9)


def test_the_middle_view_has_the_most_links() -> None:
    assert middle_view([link("c", "a"), link("b", "c")], NAMES) == "c"
    assert middle_view([link("b", "a")], NAMES) == "a"
