"""Laws of tables fitted to scattered values."""

from __future__ import annotations

import numpy as np
import pytest

from registration.calibration import Table
from registration.scan import FloatArray
from registration.table_fit import (
    ALONG_AT,
    ALONG_DEPTH,
    STIFFNESSES,
    FittedTable,
    Nuisance,
    fitted_table,
    roughness,
)

DEPTHS_MM = np.array([300.0, 380.0, 500.0, 640.0, 800.0, 930.0, 1100.0])
NODES = np.array([0.0, 0.03, 0.07, 0.12, 0.18, 0.26, 0.4, 0.6, 1.0])


def places(n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    return rng.uniform(300.0, 1100.0, n), rng.uniform(0.0, 1.0, n)


def fitted(
    of: FloatArray,
    at: tuple[FloatArray, FloatArray],
    nuisance: Nuisance | None = None,
    depths_mm: FloatArray = DEPTHS_MM,
) -> FittedTable:
    return fitted_table(*at, of, np.ones(len(of)), depths_mm, NODES, nuisance)


def test_what_has_no_roughness_comes_back_exactly_from_uneven_nodes() -> None:
    depth, node = np.meshgrid(DEPTHS_MM / 1000.0, NODES, indexing="ij")
    exact = (1.0 + depth - 3.0 * depth**2) * (0.5 - 2.0 * node)
    at = places(5000, np.random.default_rng(1))
    of = Table(DEPTHS_MM, NODES, exact).value(*at)
    # What rounds off by the condition of the stiffest table that is tried.
    stiffest = STIFFNESSES[-1] * len(of) / exact.size
    roughest = [np.linalg.eigvalsh(roughness(*each))[-1] for each in
                ((DEPTHS_MM, ALONG_DEPTH), (NODES, ALONG_AT))]  # fmt: skip
    least_known = fitted(of, at).deviation_mm.max()
    condition = stiffest * sum(roughest) * least_known**2
    rounding = np.finfo(float).eps * condition * np.abs(exact).max()
    assert fitted(of, at).table.value_mm == pytest.approx(exact, abs=rounding)


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_makes_a_table_hardly_rougher_than_a_polynomial(seed: int) -> None:
    rng = np.random.default_rng([2, seed])
    n = 6300  # 100 for each node: an unsmoothed table would be off by 0.1 or more
    found = fitted(rng.standard_normal(n), places(n, rng)).table.value_mm
    free = 3 * 2  # a parabola along depth times a line along the nodes
    assert np.sqrt(np.mean(found**2)) < 3.0 * np.sqrt(free / n)


def test_errors_are_as_large_as_their_deviations_say() -> None:
    rough = np.kron(roughness(DEPTHS_MM, ALONG_DEPTH), np.eye(len(NODES)))
    rough += 0.1 * np.kron(np.eye(len(DEPTHS_MM)), roughness(NODES, ALONG_AT))
    stiffness, turned = np.linalg.eigh(rough)
    squares = []
    for seed in range(20):
        rng = np.random.default_rng([3, seed])
        # As rough as is expected: a random amount of each shape that has any roughness.
        amounts = rng.standard_normal(len(stiffness)) / np.sqrt(np.maximum(stiffness, 1e-9))
        drawn = 0.1 * turned @ np.where(stiffness > 1e-9, amounts, 0.0)
        exact = drawn.reshape(len(DEPTHS_MM), len(NODES))
        at = places(20_000, rng)
        of = Table(DEPTHS_MM, NODES, exact).value(*at) + rng.standard_normal(20_000)
        found = fitted(of, at)
        squares.append(np.mean(((found.table.value_mm - exact) / found.deviation_mm) ** 2))
    # A table has ten freedoms or more that the data tell: the mean over 20 is known to 0.1.
    assert np.mean(squares) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("distances", [2, 3, 4])
def test_few_distances_are_enough(distances: int) -> None:
    depths_mm = np.linspace(300.0, 1100.0, distances)
    rng = np.random.default_rng(4)
    at = places(8000, rng)
    of = at[0] / 1000.0 + 0.1 * rng.standard_normal(8000)
    found = fitted(of, at, depths_mm=depths_mm).table.value_mm
    assert found == pytest.approx(np.tile(depths_mm[:, None] / 1000.0, len(NODES)), abs=0.03)


def test_what_moves_whole_groups_is_told_from_the_table() -> None:
    rng = np.random.default_rng(5)
    at = places(20_000, rng)
    group = rng.integers(0, 40, 20_000)
    offset = rng.normal(0.0, 0.5, 40)
    nuisance = Nuisance(group, np.ones((20_000, 1)), np.array([0.5]))
    of = at[1] + offset[group] + 0.1 * rng.standard_normal(20_000)
    found = fitted(of, at, nuisance)
    moved = np.array([found.nuisance[group == k].mean() for k in range(40)])
    assert moved - moved.mean() == pytest.approx(offset - offset.mean(), abs=0.02)
    assert np.ptp(found.table.value_mm, axis=0).max() < 0.1


@pytest.mark.parametrize(
    "depths_mm", [[300, 331, 362, 1100], [300, 331, 362, 393, 1100], [200, 231, 262, 700, 1500]]
)
def test_distances_may_stand_anyhow(depths_mm: list[float]) -> None:
    rng = np.random.default_rng(6)
    depth_mm = rng.uniform(depths_mm[0], depths_mm[-1], 8000)
    at = depth_mm, rng.uniform(0.0, 1.0, 8000)
    of = depth_mm / 1000.0 + at[1] + 0.1 * rng.standard_normal(8000)
    found = fitted(of, at, depths_mm=np.array(depths_mm, dtype=float)).table.value_mm
    exact = np.array(depths_mm)[:, None] / 1000.0 + NODES
    assert found == pytest.approx(exact, abs=0.05)


def test_groups_may_lack_numbers() -> None:
    rng = np.random.default_rng(7)
    at, group = places(5000, rng), rng.choice([0, 3, 7], 5000)
    nuisance = Nuisance(group, np.ones((5000, 1)), np.array([0.5]))
    found = fitted(at[1] + 0.2 * (group == 3), at, nuisance)
    assert np.ptp(found.table.value_mm, axis=0).max() < 0.02
