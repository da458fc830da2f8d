from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from shipped_configs import CONFIGS

from harness.config.reading import load_experiment
from harness.scoring.multiview import (
    NO_COVARIANCE,
    estimates,
    loop_tables,
    middle_view,
    pairs_in_loops,
    poses_in,
    relative_poses,
    usable,
)
from registration.pose_graph import RelativePose

CONFIG = CONFIGS / "desk.yaml"
LOOP = "pairs.left-right={source: left, target: right}"


@pytest.fixture(scope="module")
def experiment():
    return load_experiment(CONFIG, [LOOP])


def pose(rng: np.random.Generator, size: float = 1.0) -> RigidTransform:
    turn = Rotation.from_rotvec(size * rng.uniform(-0.5, 0.5, 3))
    return RigidTransform.from_components(size * rng.uniform(-400.0, 400.0, 3), turn)


def loop_rows(experiment, noise: float, repeats: int = 1, covariance: bool = True) -> pd.DataFrame:
    """Rows of a method whose estimates are off by small poses."""
    rng = np.random.default_rng(5)
    T_world_view = {name: pose(rng) for name in experiment.views}
    rows = []
    for repeat in range(repeats):
        for name, pair in experiment.pairs.items():
            exact = T_world_view[pair.target].inv() * T_world_view[pair.source]
            found = pose(rng, noise) * exact
            rows.append(
                {
                    "pair": name, "method": "m", "repeat": repeat, "status": "ok",
                    "T_exact": exact.as_matrix(), "T_estimated": found.as_matrix(),
                    "covariance": np.diag([1e-6] * 3 + [1.0] * 3) if covariance else None,
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def test_only_pairs_with_another_way_round_are_in_a_loop(experiment) -> None:
    assert pairs_in_loops(experiment) == ["6.4", "6.5", "left-right"]
    chain = experiment.model_copy(
        update={"pairs": {name: experiment.pairs[name] for name in ("6.4", "6.5")}}
    )
    assert pairs_in_loops(chain) == []
    assert loop_tables(chain, loop_rows(chain, 0.0)) == []


@pytest.mark.parametrize("covariance", [True, False])
def test_exact_registrations_are_exact_every_way(experiment, covariance: bool) -> None:
    (table,) = loop_tables(experiment, loop_rows(experiment, 0.0, 2, covariance))
    assert len(table.frame) == 9
    assert table.frame["Pair"].iloc[0] == "left-right: left to right"
    assert set(table.frame["Answered"]) == {"2/2"}
    errors = table.frame[["Rotation (deg)", "Translation (mm)", "X error (mm)", "Y error (mm)"]]
    np.testing.assert_allclose(errors.to_numpy(dtype=float), 0.0, atol=1e-6)
    graphs = table.frame[table.frame["How"] == "pose graph"]
    np.testing.assert_allclose(graphs["Loop, p"].astype(float), 1.0)


def test_the_way_by_the_others_is_their_product(experiment) -> None:
    rows = loop_rows(experiment, 1e-3)
    edges = relative_poses(experiment, rows)
    found = {e.way: e for e in estimates(experiment, "left-right", edges)}
    product = edges["6.5"].T_target_source * edges["6.4"].T_target_source
    by_others = found["by way of the others"].T_target_source
    np.testing.assert_allclose(by_others.as_matrix(), product.as_matrix(), atol=1e-9)
    directly = found["directly"].T_target_source.as_matrix()
    np.testing.assert_allclose(directly, rows["T_estimated"].iloc[2], atol=1e-12)
    graph = found["pose graph"]
    assert 0.0 < graph.p_value < 1.0
    gaps = [
        np.linalg.norm(graph.T_target_source.translation - end[:3, 3])
        for end in (product.as_matrix(), directly)
    ]
    apart = np.linalg.norm(product.translation - directly[:3, 3])
    assert max(gaps) < apart


def test_what_was_not_answered_is_left_out_not_taken_for_zero(experiment) -> None:
    rows = loop_rows(experiment, 1e-3, repeats=3)
    rows.loc[rows["pair"] == "left-right", ["status", "T_estimated"]] = ["failed", None]
    (table,) = loop_tables(experiment, rows)
    of_pair = table.frame[table.frame["Pair"].str.startswith("left-right")].set_index("How")
    assert of_pair["Answered"].to_dict() == {"directly": "0/3", "by way of the others": "3/3"}
    assert np.isnan(of_pair.loc["directly", "Rotation (deg)"])
    rows["status"] = "failed"
    assert loop_tables(experiment, rows) == []


def test_a_registration_that_contradicts_the_others_is_told(experiment) -> None:
    rows = loop_rows(experiment, 1e-4)
    wrong = RigidTransform.from_translation([0.0, 60.0, 0.0]).as_matrix()
    rows.at[1, "T_estimated"] = wrong @ rows.at[1, "T_estimated"]
    (table,) = loop_tables(experiment, rows)
    told = table.frame.loc[table.frame["How"] == "pose graph", "Loop, p"].astype(float)
    assert (told < 1e-6).all()


RNG = np.random.default_rng(8)
NAMES = ["a", "b", "c", "d"]
T_WORLD = {name: pose(RNG) for name in NAMES}


def edge(target: str, source: str) -> RelativePose:
    T_target_source = T_WORLD[target].inv() * T_WORLD[source]
    return RelativePose(target, source, T_target_source, NO_COVARIANCE)


@pytest.mark.parametrize("reference", NAMES)
@pytest.mark.parametrize(
    "pairs", [["ab", "bc", "cd"], ["dc", "ba", "cb"], ["ab", "ac", "ad"], ["ca", "cb", "dc", "da"]]
)
def test_exact_edges_give_exact_poses_whichever_way_they_point(
    reference: str, pairs: list[str]
) -> None:
    poses = poses_in(reference, [edge(*pair) for pair in pairs])
    assert set(poses) == set(NAMES)
    for name, found in poses.items():
        expected = T_WORLD[reference].inv() * T_WORLD[name]
        np.testing.assert_allclose(found.as_matrix(), expected.as_matrix(), atol=1e-6)


def test_what_no_edge_leads_to_is_left_out() -> None:
    assert set(poses_in("a", [edge("a", "b"), edge("c", "d")])) == {"a", "b"}
    assert set(poses_in("a", [])) == {"a"}


def test_a_loop_is_closed_by_how_sure_its_edges_are() -> None:
    off = RigidTransform.from_translation([0.0, 3.0, 0.0]) * edge("a", "b").T_target_source
    loop = [edge("a", "c"), edge("b", "c"), RelativePose("a", "b", off, 1e-6 * NO_COVARIANCE)]
    exact = edge("a", "b").T_target_source.translation
    shift = poses_in("a", loop)["b"].translation - exact
    np.testing.assert_allclose(shift, [0.0, 3.0, 0.0], atol=1e-2)
    shift = (
        poses_in("a", [*loop[:2], replace(loop[2], covariance=NO_COVARIANCE)])["b"].translation
        - exact
    )
    assert 0.5 < shift[1] < 2.5


def test_the_middle_view_has_the_most_edges() -> None:
    assert middle_view([edge("c", "a"), edge("b", "c")], NAMES) == "c"
    assert middle_view([edge("b", "a")], NAMES) == "a"


@pytest.mark.parametrize("bad", [None, np.zeros((6, 6)), np.full((6, 6), np.nan), np.eye(3)])
def test_a_covariance_that_is_none_weighs_like_every_other(bad) -> None:
    np.testing.assert_array_equal(usable(bad), NO_COVARIANCE)
    np.testing.assert_array_equal(usable(2.0 * np.eye(6)), 2.0 * np.eye(6))
