"""Gaussian conditioning, one datum after the other, and the noise of a patch's data."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.condition import conditioned
from cadtof_cli.resolver.diffuse.noise import noise_covariance


@pytest.mark.parametrize("data", [1, 2, 4, 6])
def test_conditioning_is_that_of_gaussians_in_whole_matrices(data: int) -> None:
    rng = np.random.default_rng(data)
    root = rng.normal(size=(data + 2, data + 2))
    covariance = root @ root.T
    residuals = rng.normal(size=data)
    lower = {(i, j): covariance[i, j] for i in range(data + 2) for j in range(i + 1)}
    found = conditioned(list(residuals), lower)
    inverse = np.linalg.inv(covariance[:data, :data])
    cross = covariance[data:, :data]
    remaining = covariance[data:, data:] - cross @ inverse @ cross.T
    np.testing.assert_allclose(found.shifts, cross @ inverse @ residuals, rtol=1e-9)
    np.testing.assert_allclose(
        [found.covariance[k] for k in ((0, 0), (1, 0), (1, 1))], remaining[[0, 1, 1], [0, 0, 1]], rtol=1e-8
    )
    np.testing.assert_allclose(found.chi_squared, residuals @ inverse @ residuals, rtol=1e-9)


def test_covariances_of_targets_that_are_not_needed_may_be_missing() -> None:
    covariance = {(0, 0): 2.0, (1, 0): 0.5, (2, 0): 0.7, (2, 2): 1.0}
    found = conditioned([0.4], covariance)
    assert found.shifts == pytest.approx((0.1, 0.14))
    assert found.covariance == pytest.approx({(1, 1): 1.0 - 0.7**2 / 2})


@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 3), (1, 2, 4)])
def test_noise_of_the_data_is_that_of_random_draws(harmonics: tuple[int, ...]) -> None:
    rng = np.random.default_rng(4)
    sigma, draws = 1e-3, 200_000
    clean = np.array([0.3 * np.exp(0.7j), 0.2 * np.exp(-0.4j), 0.1 * np.exp(2j)])[: len(harmonics)]
    p = clean[:, None] + sigma * (rng.normal(size=(len(clean), draws)) + 1j * rng.normal(size=(len(clean), draws)))
    logarithms = np.log(p) - np.log(clean)[:, None]
    first, further = logarithms[0], logarithms[1:]
    h = np.array(harmonics[1:])[:, None]
    values = np.concatenate([further.real - first.real, further.imag - h * first.imag, [first.real], [first.imag]])
    expected = np.zeros((len(values),) * 2)
    for (i, j), entry in noise_covariance(
        [(sigma / abs(c)) ** 2 * np.ones(1) for c in clean], harmonics=harmonics
    ).items():
        expected[i, j] = expected[j, i] = entry[0]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.cov(values) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.02)
