"""The least-squares problems of K paths: cost and derivatives against sums and finite differences computed here."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from cadtof_cli.resolver.likelihood.normal_equations import Linearised
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath
from tests.support.mixtures import C, F, noise_of

PIXELS = 5
HARMONICS = (1, 2, 4)


def random_paths(count: int, seed: int) -> Mixture:
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, (count, PIXELS))
    return Mixture(rng.uniform(0.05, 0.4, (count, PIXELS)), np.cos(phase), np.sin(phase))


def phasors_of(points: F) -> C:
    paths = Mixture.of_points(points)
    rotor = paths.cos + 1j * paths.sin
    return np.stack([(paths.amplitude * rotor**h).sum(axis=0) for h in HARMONICS])


def measured(seed: int) -> tuple[Measured, C]:
    rng = np.random.default_rng(seed)
    given = np.asarray(0.3 * (rng.normal(size=(3, PIXELS)) + 1j * rng.normal(size=(3, PIXELS))), np.complex128)
    return Measured.of_phasors(given, harmonics=HARMONICS), given


def symmetric(triangle: F, size: int) -> F:
    """Return the symmetric matrices, (n, M, M), that have these lower triangles, (M(M + 1)/2, n)."""
    matrix = np.empty((triangle.shape[1], size, size))
    rows, columns = np.tril_indices(size)
    matrix[:, rows, columns] = matrix[:, columns, rows] = triangle.T
    return matrix


def assert_normal_equations(
    at: Linearised, fit: WhiteFit | WeightedFit, points: F, weight: NDArray[np.float64], given: C
) -> None:
    """Check the normal equations against those from finite differences of the model; `weight` is (N, 2, 2, n)."""
    size, step = 2 * len(points) // 3, 1e-6
    slopes = []
    for index in range(size):
        steps = np.zeros((size, PIXELS))
        steps[index] = step
        change = (phasors_of(fit.moved(points, steps)) - phasors_of(fit.moved(points, -steps))) / (2 * step)
        slopes.append(np.stack([change.real, change.imag], axis=1))
    jacobian = np.stack(slopes)
    difference = given - phasors_of(points)
    residual = np.stack([difference.real, difference.imag], axis=1)
    np.testing.assert_allclose(at.cost, np.einsum("hcn,hcdn,hdn->n", residual, weight, residual), rtol=1e-9)
    gradient = np.einsum("khcn,hcdn,hdn->kn", jacobian, weight, residual)
    np.testing.assert_allclose(at.gradient, gradient, rtol=1e-6, atol=1e-6 * np.abs(gradient).max())
    matrix = np.einsum("khcn,hcdn,lhdn->nkl", jacobian, weight, jacobian)
    np.testing.assert_allclose(symmetric(at.matrix, size), matrix, rtol=1e-6, atol=1e-6 * np.abs(matrix).max())


@pytest.mark.parametrize("paths", [1, 2, 3])
def test_white_noise_weighs_each_harmonic_by_one_number(paths: int) -> None:
    data, given = measured(1)
    fit = WhiteFit(data, (3.0, 1.5, 0.7))
    points = random_paths(paths, 2).points
    weight = np.zeros((3, 2, 2, PIXELS))
    weight[:, 0, 0] = weight[:, 1, 1] = np.array([3.0, 1.5, 0.7])[:, np.newaxis]
    assert_normal_equations(fit.linearised(points), fit, points, weight, given)
    some = np.array([3, 1])
    np.testing.assert_array_equal(fit[some].linearised(points[:, some]).matrix, fit.linearised(points).matrix[:, some])


@pytest.mark.parametrize("paths", [1, 2, 3])
def test_noise_of_the_light_weighs_by_its_inverse_covariance(paths: int) -> None:
    data, given = measured(3)
    light = random_paths(2, 4)
    noise = noise_of(HARMONICS, n_av=300.0)
    fit = WeightedFit.around(data, light, noise=noise)
    weight = np.empty((3, 2, 2, PIXELS))
    rotor = light.cos + 1j * light.sin
    for row, harmonic in enumerate(noise.each):
        h = HARMONICS[row]
        single, doubled = ((light.amplitude * rotor**k).sum(axis=0) for k in (h, 2 * h))
        re_re, re_im, im_im = harmonic.covariance((single.real, single.imag), (doubled.real, doubled.imag))
        covariance = np.moveaxis(np.array([[re_re, re_im], [re_im, im_im]]), 2, 0)
        weight[row] = np.moveaxis(np.linalg.inv(covariance), 0, 2)
    points = random_paths(paths, 5).points
    assert_normal_equations(fit.linearised(points), fit, points, weight, given)


def test_paths_brighter_than_all_photons_have_the_noise_of_all_photons() -> None:
    data, _ = measured(3)
    light = random_paths(2, 4)
    strong = Mixture(4.0 * light.amplitude / light.amplitude.sum(axis=0), light.cos, light.sin)
    limited = Mixture(light.amplitude / light.amplitude.sum(axis=0), light.cos, light.sin)
    noise = noise_of(HARMONICS, n_av=300.0)
    found, expected = (WeightedFit.around(data, paths, noise=noise) for paths in (strong, limited))
    np.testing.assert_allclose(found.weights, expected.weights, rtol=1e-9, atol=1e-9)


def test_equation_9_and_its_derivatives() -> None:
    """The residual is q_j − z^j/|z|^(j−1) − (1−z)^j/|1−z|^(j−1); its derivatives are by Re z and Im z."""
    rng = np.random.default_rng(6)
    z = rng.normal(0.5, 1.0, PIXELS) + 1j * rng.normal(0.0, 1.0, PIXELS)
    q = rng.normal(size=(2, PIXELS)) + 1j * rng.normal(size=(2, PIXELS))
    harmonics = (2, 3)

    def residual_of(at: C) -> C:
        return np.stack(
            [
                q[row] - at**j / np.abs(at) ** (j - 1) - (1 - at) ** j / np.abs(1 - at) ** (j - 1)
                for row, j in enumerate(harmonics)
            ]
        )

    problem = EliminatedPath(harmonics, tuple((one.real.copy(), one.imag.copy()) for one in q))
    found = problem.linearised(np.stack([z.real, z.imag]))
    step = 1e-6
    slopes = [-(residual_of(z + unit * step) - residual_of(z - unit * step)) / (2 * step) for unit in (1.0, 1j)]
    residual = residual_of(z)
    np.testing.assert_allclose(found.cost, (np.abs(residual) ** 2).sum(axis=0), rtol=1e-10)
    for index, slope in enumerate(slopes):
        gradient = (slope.conj() * residual).real.sum(axis=0)
        np.testing.assert_allclose(found.gradient[index], gradient, rtol=1e-6, atol=1e-7)
    products = [(slopes[i].conj() * slopes[j]).real.sum(axis=0) for i, j in ((0, 0), (1, 0), (1, 1))]
    np.testing.assert_allclose(found.matrix, products, rtol=1e-6, atol=1e-7)
