from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from registration.pose_graph import (
    PoseGraphError,
    RelativePose,
    ViewPoses,
    adjoint,
    chain_poses,
    close_loops,
)

LOOP = (("a", "b"), ("b", "c"), ("a", "c"))
MANY = (("a", "b"), ("b", "c"), ("c", "d"), ("d", "e"), ("e", "a"), ("a", "c"), ("b", "d"),
        ("c", "e"), ("d", "a"), ("e", "b"))  # fmt: skip


def random_pose(rng: np.random.Generator, turn: float = 0.8, shift_mm: float = 500.0):
    return RigidTransform.from_components(
        rng.uniform(-shift_mm, shift_mm, 3), Rotation.from_rotvec(rng.uniform(-turn, turn, 3))
    )


def perturbation(x: NDArray[np.float64]) -> RigidTransform:
    return RigidTransform.from_components(x[3:], Rotation.from_rotvec(x[:3]))


def random_covariance(rng: np.random.Generator) -> NDArray[np.float64]:
    root = rng.normal(size=(6, 6)) * np.array([2e-3] * 3 + [2.0] * 3)[:, None]
    return root @ root.T + np.diag([1e-6] * 3 + [0.5] * 3)


def graph(rng: np.random.Generator, links=LOOP, noise: float = 1.0):
    """True poses T_world_view, and relative poses with noise of their own covariances."""
    true = {name: random_pose(rng) for name in sorted({n for link in links for n in link})}
    edges = []
    for target, source in links:
        covariance = random_covariance(rng)
        error = noise * np.linalg.cholesky(covariance) @ rng.normal(size=6)
        pose = perturbation(error) * (true[target].inv() * true[source])
        edges.append(RelativePose(target, source, pose, covariance))
    return true, edges


def gap(a: RigidTransform, b: RigidTransform) -> NDArray[np.float64]:
    """(6,) perturbation on the left of b that makes it a."""
    d = a * b.inv()
    return np.concatenate([d.rotation.as_rotvec(), d.translation])


def close(a: RigidTransform, b: RigidTransform, rad: float = 1e-9, mm: float = 1e-6) -> bool:
    apart = np.abs(gap(a, b))
    return bool(apart[:3].max() < rad and apart[3:].max() < mm)


@pytest.mark.parametrize("solve", [chain_poses, close_loops])
@pytest.mark.parametrize("links", [LOOP, LOOP[:2], MANY])
def test_exact_relative_poses_close_exactly(solve, links) -> None:
    true, edges = graph(np.random.default_rng(1), links, noise=0.0)
    found = solve(edges, "b")
    assert found.views[0] == "b"
    assert sorted(found.views) == sorted(true)
    for name in true:
        assert close(found.relative("b", name).T_target_source, true["b"].inv() * true[name])
    np.testing.assert_allclose(found.distance2, 0.0, atol=1e-10)


def test_without_a_loop_the_graph_is_the_chain() -> None:
    _, edges = graph(np.random.default_rng(2), LOOP[:2])
    chained, closed = chain_poses(edges, "a"), close_loops(edges, "a")
    product = edges[0].T_target_source * edges[1].T_target_source
    for found in (chained, closed):
        assert close(found.relative("a", "c").T_target_source, product)
        assert found.p_value == 1.0
        np.testing.assert_array_equal(found.weight, 1.0)
    carried = adjoint(edges[0].T_target_source)
    expected = edges[0].covariance + carried @ edges[1].covariance @ carried.T
    for found in (chained, closed):
        covariance = found.relative("a", "c").covariance
        np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-9)


def test_a_chain_takes_the_fewest_edges_and_says_which() -> None:
    _, edges = graph(np.random.default_rng(3), LOOP)
    found = chain_poses(edges, "a")
    assert close(found.relative("a", "c").T_target_source, edges[2].T_target_source)
    np.testing.assert_array_equal(found.weight, [1.0, 0.0, 1.0])
    assert found.distance2[1] > 0.1


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("links", [LOOP, MANY])
def test_the_choice_of_the_reference_changes_nothing(robust: bool, links) -> None:
    _, edges = graph(np.random.default_rng(4), links)
    first, second = (close_loops(edges, name, robust) for name in ("a", "c"))
    for target, source in (("a", "b"), ("c", "b"), ("a", "c")):
        one, other = first.relative(target, source), second.relative(target, source)
        assert close(one.T_target_source, other.T_target_source, 1e-8, 1e-5)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(first.distance2, second.distance2, rtol=1e-5)
    assert first.p_value == pytest.approx(second.p_value, rel=1e-5)


def test_renaming_the_ends_of_an_edge_with_its_inverse_changes_nothing() -> None:
    _, edges = graph(np.random.default_rng(5), LOOP)
    inverse = edges[1].T_target_source.inv()
    carried = adjoint(inverse)
    turned = [
        edges[0],
        RelativePose("c", "b", inverse, carried @ edges[1].covariance @ carried.T),
        edges[2],
    ]
    first, second = close_loops(edges, "a"), close_loops(turned, "a")
    for name in ("b", "c"):
        assert close(
            first.relative("a", name).T_target_source, second.relative("a", name).T_target_source,
            1e-5, 1e-2,
        )  # fmt: skip


def test_poses_are_the_best_there_are() -> None:
    rng = np.random.default_rng(6)
    _, edges = graph(rng, MANY)
    found = close_loops(edges, "a", robust=False)

    def cost(poses: RigidTransform) -> float:
        place = {name: k for k, name in enumerate(found.views)}
        total = 0.0
        for e in edges:
            relative = poses[place[e.target]].inv() * poses[place[e.source]]
            r = gap(relative, e.T_target_source)
            total += r @ np.linalg.solve(e.covariance, r)
        return total

    best = cost(found.T_reference_view)
    assert best == pytest.approx(found.distance2.sum())
    for _ in range(20):
        steps = rng.normal(size=(len(found.views), 6)) * np.array([1e-5] * 3 + [1e-2] * 3)
        poses = RigidTransform.concatenate(
            [perturbation(s) * p for s, p in zip(steps, found.T_reference_view, strict=True)]
        )
        assert cost(poses) > best


def test_covariances_and_p_values_are_those_of_the_errors() -> None:
    rng = np.random.default_rng(7)
    squared, p_values, chained = [], [], []
    for _ in range(40):
        true, edges = graph(rng, LOOP)
        exact = true["a"].inv() * true["c"]
        for solve, kept in ((close_loops, squared), (chain_poses, chained)):
            found = solve(edges, "a", False) if solve is close_loops else solve(edges[:2], "a")
            relative = found.relative("a", "c")
            error = gap(exact, relative.T_target_source)
            kept.append(error @ np.linalg.solve(relative.covariance, error))
            if solve is close_loops:
                p_values.append(found.p_value)
    # Chi-squared with 6 degrees: mean 6, standard error of 40 of them 0.55; of p values 0.05.
    assert abs(np.mean(squared) - 6.0) < 1.6
    assert abs(np.mean(chained) - 6.0) < 1.6
    assert abs(np.mean(p_values) - 0.5) < 0.15


def test_a_loop_makes_poses_surer() -> None:
    _, edges = graph(np.random.default_rng(8), LOOP)
    loop = close_loops(edges, "a", robust=False).relative("a", "c").covariance
    for alone in (edges[2].covariance, chain_poses(edges[:2], "a").relative("a", "c").covariance):
        assert np.linalg.eigvalsh(alone - loop)[0] > -1e-9 * np.linalg.eigvalsh(alone)[-1]


@pytest.mark.parametrize("bad", range(0, 10, 3))
def test_an_inconsistent_edge_loses_its_weight(bad: int) -> None:
    true, edges = graph(np.random.default_rng(9), MANY, noise=0.3)
    wrong = perturbation(np.array([0.2, -0.1, 0.3, 40.0, -80.0, 60.0]))
    edges[bad] = replace(edges[bad], T_target_source=wrong * edges[bad].T_target_source)
    plain, robust = close_loops(edges, "a", robust=False), close_loops(edges, "a")
    assert robust.p_value < 1e-6
    assert int(robust.weight.argmin()) == bad
    assert robust.weight[bad] < 0.05
    assert np.delete(robust.weight, bad).min() > 0.3

    def worst(found: ViewPoses) -> float:
        return max(
            np.abs(gap(true["a"].inv() * true[n], found.relative("a", n).T_target_source))[3:].max()
            for n in true
        )

    assert worst(robust) < 0.2 * worst(plain)


@pytest.mark.parametrize("turn_rad", [0.2, 1.5])
def test_of_three_poses_of_one_pair_one_far_off_loses_its_weight(turn_rad: float) -> None:
    """However sure they are: at first all three are as far off as the wrong one pulls them."""
    true, edges = graph(np.random.default_rng(12), [("a", "b"), ("b", "a"), ("a", "b")], noise=0.01)
    edges = [replace(edge, covariance=1e-4 * edge.covariance) for edge in edges]
    wrong = perturbation(np.array([turn_rad, 0.0, 0.0, 500.0, 0.0, 0.0]))
    edges[2] = replace(edges[2], T_target_source=wrong * edges[2].T_target_source)
    found = close_loops(edges, "a")
    assert int(found.weight.argmin()) == 2
    assert found.weight[2] < 1e-3
    off = gap(true["a"].inv() * true["b"], found.relative("a", "b").T_target_source)
    exact = close_loops(edges[:2], "a").relative("a", "b").T_target_source
    assert np.abs(off).max() < 1.1 * np.abs(gap(true["a"].inv() * true["b"], exact)).max()


def test_a_single_loop_reports_that_it_does_not_close() -> None:
    _, edges = graph(np.random.default_rng(10), LOOP, noise=0.3)
    assert close_loops(edges, "a").p_value > 0.01
    wrong = perturbation(np.array([0.1, 0.0, 0.0, 0.0, 50.0, 0.0]))
    edges[2] = replace(edges[2], T_target_source=wrong * edges[2].T_target_source)
    assert close_loops(edges, "a").p_value < 1e-6


def test_wrong_graphs_are_refused_in_one_line() -> None:
    _, edges = graph(np.random.default_rng(11), LOOP)
    far = replace(edges[0], target="x", source="y")
    open_ = replace(edges[0], covariance=np.diag([1.0, 1, 1, 1, 1, 0]))
    for given, reference, message in (
        ([], "a", "no relative pose is given"),
        ([*edges, far], "a", "no chain of relative poses links 'x', 'y' to 'a'"),
        (edges, "z", "unknown reference 'z'; known are a, b, c"),
        ([replace(edges[0], source="a")], "a", "from view 'a' to itself"),
        ([open_, *edges[1:]], "a", "covariance from 'b' to 'a' is no positive definite"),
    ):
        for solve in (chain_poses, close_loops):
            with pytest.raises(PoseGraphError, match=message):
                solve(given, reference)
    with pytest.raises(PoseGraphError, match="unknown view 'q'"):
        close_loops(edges, "a").relative("a", "q")
