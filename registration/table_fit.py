"""The bilinear table nearest to scattered values, with what is unknown about their groups."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import solve_triangular

from registration.calibration import Table, cell
from registration.scan import FloatArray, IntArray

# What a table is expected to have little of: along depth third differences, as a constant error on
# a sensor's image grows with the square of the depth, along the other coordinate second ones. Of
# few nodes one order less than there are.
ALONG_DEPTH, ALONG_AT = 3, 2
STIFFNESSES = 10.0 ** np.arange(-5, 6)  # that are tried, in units of the data's weight in a node


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
    nuisance: Nuisance | None = None,
) -> FittedTable:
    """The table nearest to values (n,) with standard deviations scale, and the nuisance in each.

    Table and nuisance are found together, by one least squares in which the deviations of the
    nuisance count as measurements of 0, and differences of the table, too: they keep noise out of
    it and fill nodes where nothing was measured. How stiff that makes the table, along depth and
    along `at`, is what makes the values most likely, whatever the table is (the evidence of
    D. J. C. MacKay, Bayesian Interpolation, 1992).
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
    known = np.zeros(size)
    weight = float(matrix.power(2).sum()) / size
    if nuisance is not None:
        unknowns, groups = len(nuisance.deviation), int(nuisance.group.max()) + 1
        column = unknowns * nuisance.group[:, None] + np.arange(unknowns)
        effect = _sparse(nuisance.effect / scale[:, None], column, unknowns * groups)
        matrix = sparse.hstack([matrix, effect], format="csr")
        known = np.concatenate([known, np.tile(nuisance.deviation**-2.0, groups)])
    # Some hundred unknowns: their matrices are cheap, and the inverse says how well each is known.
    of_data = (matrix.T @ matrix).toarray() + np.diag(known)
    pull = matrix.T @ (value / scale)
    information = _likeliest(of_data, pull, weight, depths_mm, nodes)
    covariance = np.linalg.inv(information)
    found = covariance @ pull
    deviation_mm = np.sqrt(np.diag(covariance)[:size]).reshape(rows, columns)
    table = Table(depths_mm, nodes, found[:size].reshape(rows, columns))
    moved = scale * (matrix[:, size:] @ found[size:])
    return FittedTable(table, deviation_mm, moved)


def _likeliest(
    of_data: FloatArray, pull: FloatArray, weight: float, depths_mm: FloatArray, nodes: FloatArray
) -> FloatArray:
    """The information of the data with that of the stiffness that makes the data most likely.

    Raises ValueError where the values leave the table open.
    """
    rows, columns = len(depths_mm), len(nodes)
    along_depth, along_at = roughness(depths_mm, ALONG_DEPTH), roughness(nodes, ALONG_AT)
    of_depth, of_at = np.kron(along_depth, np.eye(columns)), np.kron(np.eye(rows), along_at)
    eigenvalues = np.linalg.eigvalsh(along_depth), np.linalg.eigvalsh(along_at)
    # Polynomials of low degree have no roughness, and stay free whatever the stiffness: exactly 0,
    # as what rounding leaves of it may be more than the other coordinate's.
    free = _order(rows, ALONG_DEPTH), _order(columns, ALONG_AT)
    for values, n in zip(eigenvalues, free, strict=True):
        values[:n] = 0.0
    best, most = None, -np.inf
    for stiffness in product(weight * STIFFNESSES, repeat=2):
        information = of_data.copy()
        information[: len(of_at), : len(of_at)] += stiffness[0] * of_depth + stiffness[1] * of_at
        try:
            root = np.linalg.cholesky(information)
        except np.linalg.LinAlgError:  # too stiff along one, too soft along the other, to rounding
            continue
        explained = solve_triangular(root, pull, lower=True)
        of_both = np.add.outer(stiffness[0] * eigenvalues[0], stiffness[1] * eigenvalues[1])
        evidence = 0.5 * float(explained @ explained) - np.log(np.diag(root)).sum()
        evidence += 0.5 * np.log(of_both[of_both > 0.0]).sum()
        if evidence > most:
            best, most = information, evidence
    if best is None:
        raise ValueError("the values leave the table open, whatever its stiffness")
    return best


def _sparse(entries: FloatArray, columns: IntArray, width: int) -> sparse.csr_matrix:
    """The matrix of these (n, k) entries in its n rows."""
    rows = np.repeat(np.arange(len(entries)), entries.shape[1])
    shape = (len(entries), width)
    return sparse.csr_matrix((entries.ravel(), (rows, columns.ravel())), shape=shape)


def _order(n: int, order: int) -> int:
    """The order of differences that n nodes have, up to the given one."""
    return min(order, n - 1)


def roughness(nodes: FloatArray, order: int) -> FloatArray:
    """(n, n) the sum of squared divided differences of values at n nodes, a unit apart on average.

    It is 0 for polynomials of a lower degree, however unevenly the nodes lie.
    """
    place = nodes / np.diff(nodes).mean()
    differences = np.eye(len(nodes))
    for k in range(1, _order(len(nodes), order) + 1):
        apart = (place[k:] - place[:-k]) / k
        differences = np.diff(differences, axis=0) / apart[:, None]
    squared: FloatArray = differences.T @ differences
    return squared
