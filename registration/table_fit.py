"""The bilinear table nearest to scattered values, with what is unknown about their groups."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from registration.calibration import Table, cell
from registration.scan import FloatArray, IntArray

# Weight of a table's second differences beside the data: it fills nodes where nothing was measured.
STIFFNESS = 1e-4
ALONG_DEPTH = 300.0  # how much more it weighs along depth, where the bias changes more evenly


class Nuisance(NamedTuple):
    """What else moves the values, group by group: unknown, but known to be small.

    group: (n,) number of each value's group, from 0. effect: (n, k) how much a unit of each of the
    k unknowns of its group adds to it. deviation: (k,) standard deviations of the unknowns.
    """

    group: IntArray
    effect: FloatArray
    deviation: FloatArray


class FittedTable(NamedTuple):
    """A table; deviation_mm (d, t), how well it is known; nuisance (n,), its part of each value."""

    table: Table
    deviation_mm: FloatArray
    nuisance: FloatArray


def fitted_table(
    depth_mm: FloatArray,
    at: FloatArray,
    value: FloatArray,
    scale: FloatArray,
    depths_mm: FloatArray,
    nodes: FloatArray,
    stiffness: float = STIFFNESS,
    nuisance: Nuisance | None = None,
) -> FittedTable:
    """The table nearest to values (n,), each weighted by 1 / scale^2, and the nuisance in each.

    Table and nuisance are found together, by one least squares in which the deviations of the
    nuisance count as measurements of 0.
    """
    rows, columns = len(depths_mm), len(nodes)
    row, row_share = cell(depths_mm, depth_mm)
    column, column_share = cell(nodes, at)
    corners = [(i, j) for i in (0, 1) for j in (0, 1)]
    index = np.stack([(row + i) * columns + column + j for i, j in corners], axis=1)
    share = np.stack(
        [
            (row_share if i else 1.0 - row_share) * (column_share if j else 1.0 - column_share)
            for i, j in corners
        ],
        axis=1,
    )
    size = rows * columns
    matrix = _sparse(share / scale[:, None], index, size)
    weight = stiffness * float(matrix.power(2).sum()) / size
    along_depth = sparse.kron(_second_differences(depths_mm), sparse.identity(columns))
    along_at = sparse.kron(sparse.identity(rows), _second_differences(nodes))
    prior = [weight * (ALONG_DEPTH * along_depth.T @ along_depth + along_at.T @ along_at)]
    if nuisance is not None:
        unknowns, groups = len(nuisance.deviation), int(nuisance.group.max()) + 1
        column = unknowns * nuisance.group[:, None] + np.arange(unknowns)
        effect = _sparse(nuisance.effect / scale[:, None], column, unknowns * groups)
        matrix = sparse.hstack([matrix, effect], format="csr")
        prior.append(sparse.diags(np.tile(nuisance.deviation**-2.0, groups)))
    information = (matrix.T @ matrix + sparse.block_diag(prior)).toarray()
    # Some hundred unknowns: the inverse is cheap, and its diagonal says how well each is known.
    covariance = np.linalg.inv(information)
    found = covariance @ (matrix.T @ (value / scale))
    deviation_mm = np.sqrt(np.diag(covariance)[:size]).reshape(rows, columns)
    table = Table(depths_mm, nodes, found[:size].reshape(rows, columns))
    moved = scale * (matrix[:, size:] @ found[size:])
    return FittedTable(table, deviation_mm, moved)


def _sparse(entries: FloatArray, columns: IntArray, width: int) -> sparse.csr_matrix:
    """The matrix of these (n, k) entries in its n rows."""
    rows = np.repeat(np.arange(len(entries)), entries.shape[1])
    shape = (len(entries), width)
    return sparse.csr_matrix((entries.ravel(), (rows, columns.ravel())), shape=shape)


def _second_differences(nodes: FloatArray) -> sparse.csr_matrix:
    """Change of the slope from node to node, as if nodes were a unit apart on average."""
    if len(nodes) < 3:
        return sparse.csr_matrix((1, len(nodes)))
    inverse = np.diff(nodes).mean() / np.diff(nodes)
    before, after = inverse[:-1], inverse[1:]
    shape = (len(nodes) - 2, len(nodes))
    return sparse.diags([before, -before - after, after], [0, 1, 2], shape=shape).tocsr()
