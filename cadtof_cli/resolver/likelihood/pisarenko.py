"""N paths from harmonics 1 … N: Carathéodory's decomposition, by eigenvalues and roots.

For phasors p_1 … p_N of any light there are N paths with amplitudes ≥ 0 that have these phasors (Carathéodory;
Pisarenko 1973, doi:10.1111/j.1365-246X.1973.tb03424.x). Take the Hermitian Toeplitz matrix of p_0 … p_N with p_0 = 0.
Its smallest eigenvalue is minus the sum of the amplitudes. The eigenvector of this eigenvalue holds the coefficients of
a polynomial whose roots, on the unit circle, are exp(i x_k).
"""

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.phasors.rotors import Rotor, powers, unit_rotor
from cadtof_cli.resolver.likelihood.mixture import Mixture
from cadtof_cli.resolver.likelihood.normal_equations import cholesky, entry, solve

LEAST_LEADING = 1e-12
"""Floor for the leading coefficient of a polynomial of norm 1: fewer paths than harmonics leave it free, even at 0."""


def pisarenko(phasors: Complex, /) -> Mixture:
    """Return the N paths of phasors, complex128 (N, n), at harmonics 1 … N.

    The result is exact if there are N different paths. If there are fewer, the remaining paths have amplitude 0 except
    for rounding. NaN in gives paths of amplitude 0. LAPACK is called once per pixel, so blocks of any size give the
    same bits.
    """
    count = phasors.shape[0]
    finite = np.isfinite(phasors).all(axis=0)
    given = np.where(finite, phasors, 0.0)
    values, vectors = np.linalg.eigh(_toeplitz(given))
    polynomial = vectors[..., 0]
    leading = polynomial[:, -1:]
    leading = np.where(np.abs(leading) < LEAST_LEADING, LEAST_LEADING, leading)
    companion = np.zeros((phasors.shape[1], count, count), np.complex128)
    companion[:, np.arange(1, count), np.arange(count - 1)] = 1.0
    companion[:, :, -1] = -polynomial[:, :-1] / leading
    roots = np.linalg.eigvals(companion).T
    rotors = unit_rotor(np.ascontiguousarray(roots.real), np.ascontiguousarray(roots.imag))[1]
    return Mixture(_amplitudes(given, -values[:, 0], rotors), *rotors)


def strongest_of(paths: Mixture, count: int, /) -> Mixture:
    """Return the `count` strongest paths, in order of falling amplitude."""
    order = np.argsort(-paths.amplitude, axis=0, kind="stable")[:count]
    return Mixture(*(np.take_along_axis(part, order, 0) for part in (paths.amplitude, paths.cos, paths.sin)))


def _toeplitz(phasors: Complex) -> Complex:
    """Return Hermitian matrices, (n, N + 1, N + 1), with p_{j−i} above the diagonal and 0 on it.

    Only their lower triangles are filled.
    """
    size = phasors.shape[0] + 1
    matrix = np.zeros((phasors.shape[1], size, size), np.complex128)
    for i in range(size):
        for j in range(i + 1, size):
            matrix[:, j, i] = phasors[j - i - 1].conj()
    return matrix


def _amplitudes(phasors: Complex, total: Float, rotor: Rotor) -> Float:
    """Return the amplitudes ≥ 0 that fit the phasors and, as harmonic 0, their own sum `total`, by least squares."""
    count = len(rotor[0])
    matrix, right = np.ones((entry(count, 0), total.size)), np.repeat(total[np.newaxis], count, axis=0)
    for phasor, (cos_h, sin_h) in zip(phasors, powers(rotor, range(1, count + 1)), strict=True):
        right += 2.0 * (phasor.real * cos_h + phasor.imag * sin_h)
        for i in range(count):
            row = slice(entry(i, 0), entry(i, i) + 1)
            matrix[row] += 2.0 * (cos_h[i] * cos_h[: i + 1] + sin_h[i] * sin_h[: i + 1])
    return np.maximum(solve(cholesky(matrix, count), right), 0.0)
