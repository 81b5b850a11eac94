"""Solutions of small symmetric systems against numpy's, and the result for a system that has no solution."""

import numpy as np
import pytest

from cadtof_cli.resolver.likelihood.normal_equations import cholesky, entry, inverse_diagonal, solve

SEED = 11


@pytest.mark.parametrize("size", [1, 2, 3, 6])
@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_every_system_of_a_block_has_its_own_solution(size: int, damping: float) -> None:
    rng = np.random.default_rng(SEED)
    roots, right = rng.normal(size=(50, size, size)), rng.normal(size=(size, 50))
    whole = roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(size)
    triangle = np.empty((entry(size, 0), 50))
    for i in range(size):
        for j in range(i + 1):
            triangle[entry(i, j)] = whole[:, i, j]
    raised = whole + damping * np.eye(size) * whole
    lower = cholesky(triangle, size, damping=damping)
    np.testing.assert_allclose(solve(lower, right).T, np.linalg.solve(raised, right.T[..., None])[..., 0], rtol=1e-9)
    np.testing.assert_allclose(
        inverse_diagonal(lower, size).T, np.linalg.inv(raised).diagonal(axis1=1, axis2=2), rtol=1e-9
    )


def test_a_system_without_a_solution_gives_a_long_step() -> None:
    """For x + y = 1 and x + y = 2, in any unit, the steps are between 10¹² and 10¹⁶: large, but finite."""
    size = np.array([1e-20, 1.0, 1e20])
    x = solve(cholesky(np.ones((3, 1)) * size, 2), np.array([[1.0], [2.0]]) * size)
    assert ((np.abs(x) > 1e12) & (np.abs(x) < 1e16)).all()
