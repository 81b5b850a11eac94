"""Small symmetric systems, one per pixel, solved for a whole block at once.

All operations are elementwise over the last axis, so that the answer of a pixel does not depend on its neighbours.
LAPACK would take a microsecond per matrix.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float

Triangle = Float
"""Lower triangles of symmetric matrices, (M·(M + 1)/2, n), row by row: entry (i, j ≤ i) is at i·(i + 1)/2 + j."""

LEAST_PIVOT = 1e-14
"""Floor for the pivots of a factorisation, as a share of the diagonal: a singular system gives a long step, not NaN."""


@dataclass(frozen=True)
class Linearised:
    """A problem at its points: `matrix` JᵀWJ as a triangle, `gradient` JᵀW·residual, (M, n), `cost` rᵀWr, (n,)."""

    matrix: Triangle
    gradient: Float
    cost: Float


def entry(i: int, j: int, /) -> int:
    """Return the place of entry (i, j), j ≤ i, of a matrix in its triangle."""
    return i * (i + 1) // 2 + j


def cholesky(matrix: Triangle, size: int, /, *, damping: Float | float = 0.0) -> Triangle:
    """Return the factors L of positive definite matrices L·Lᵀ of `size` rows; the diagonal holds 1/L_ii.

    First, every diagonal entry is multiplied by 1 + `damping`, (n,).
    """
    lower = np.empty_like(matrix)
    raised = 1.0 + damping
    for j in range(size):
        diagonal = matrix[entry(j, j)] * raised
        pivot = diagonal.copy()
        for k in range(j):
            pivot -= lower[entry(j, k)] * lower[entry(j, k)]
        np.maximum(pivot, LEAST_PIVOT * diagonal + np.finfo(np.float64).tiny, out=pivot)
        np.divide(1.0, np.sqrt(pivot, out=pivot), out=lower[entry(j, j)])
        for i in range(j + 1, size):
            rest = matrix[entry(i, j)]
            for k in range(j):
                rest = rest - lower[entry(i, k)] * lower[entry(j, k)]
            np.multiply(rest, lower[entry(j, j)], out=lower[entry(i, j)])
    return lower


def solve(lower: Triangle, right: Float, /) -> Float:
    """Return the solutions x, (M, n), of L·Lᵀ·x = right for factors from `cholesky`."""
    x = right.copy()
    size = len(x)
    for i in range(size):
        for k in range(i):
            x[i] -= lower[entry(i, k)] * x[k]
        x[i] *= lower[entry(i, i)]
    for i in reversed(range(size)):
        for k in range(i + 1, size):
            x[i] -= lower[entry(k, i)] * x[k]
        x[i] *= lower[entry(i, i)]
    return x


def inverse_diagonal(lower: Triangle, size: int, /) -> Float:
    """Return the diagonal, (M, n), of the inverse of L·Lᵀ: the sums of squares of the columns of L⁻¹."""
    diagonal: Float = np.empty((size, lower.shape[1]))
    for j in range(size):
        column: list[Float] = [lower[entry(j, j)]]
        total = column[0] * column[0]
        for i in range(j + 1, size):
            rest = -lower[entry(i, j)] * column[0]
            for k in range(j + 1, i):
                rest -= lower[entry(i, k)] * column[k - j]
            rest *= lower[entry(i, i)]
            column.append(rest)
            total += rest * rest
        diagonal[j] = total
    return diagonal
