"""Small symmetric systems, one a pixel, solved for a whole block at once.

A matrix is float64 (M, M, n), of which only the lower triangle is read; vectors are (M, n). Everything is elementwise over the
last axis, so that a pixel's answer does not depend on its neighbours; LAPACK would cost a microsecond a matrix.
"""

import numpy as np

from cadtof_cli.arrays import Float

LEAST_PIVOT = 1e-14
"""Least pivot of a factorisation, as a share of the diagonal: a singular system gives a long step, not NaN."""


def cholesky(matrix: Float, /) -> Float:
    """Return the lower factors L, (M, M, n), of positive definite matrices L·Lᵀ; the diagonal holds 1/L_ii."""
    size = matrix.shape[0]
    lower = np.zeros_like(matrix)
    for j in range(size):
        pivot = matrix[j, j].copy()
        for k in range(j):
            pivot -= lower[j, k] * lower[j, k]
        np.maximum(pivot, LEAST_PIVOT * matrix[j, j] + np.finfo(np.float64).tiny, out=pivot)
        lower[j, j] = 1.0 / np.sqrt(pivot)
        for i in range(j + 1, size):
            rest = matrix[i, j].copy()
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            lower[i, j] = rest * lower[j, j]
    return lower


def solve(lower: Float, right: Float, /) -> Float:
    """Return the solutions x, (M, n), of L·Lᵀ·x = right for factors from `cholesky`."""
    size = lower.shape[0]
    x = right.copy()
    for i in range(size):
        for k in range(i):
            x[i] -= lower[i, k] * x[k]
        x[i] *= lower[i, i]
    for i in reversed(range(size)):
        for k in range(i + 1, size):
            x[i] -= lower[k, i] * x[k]
        x[i] *= lower[i, i]
    return x


def inverse_diagonal(lower: Float, /) -> Float:
    """Return the diagonal, (M, n), of the inverse of L·Lᵀ: the column sums of squares of 1/L."""
    size = lower.shape[0]
    diagonal: Float = np.zeros_like(lower[0])
    for j in range(size):
        column: list[Float] = [lower[j, j]]
        diagonal[j] = column[0] * column[0]
        for i in range(j + 1, size):
            entry = -lower[i, j] * column[0]
            for k in range(j + 1, i):
                entry -= lower[i, k] * column[k - j]
            entry *= lower[i, i]
            column.append(entry)
            diagonal[j] += entry * entry
    return diagonal
