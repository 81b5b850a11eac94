"""One step of the search under a response solves four linear equations and stays within its limits."""

import numpy as np
import pytest

from cadtof_cli.arrays import Float32
from cadtof_cli.resolver.response.newton import Fields, newton_step, stepped
from cadtof_cli.resolver.response.table import Answer

PIXELS = 40


def fields(rng: np.random.Generator, size: float) -> Fields:
    def answer() -> Answer:
        return Answer(*rng.normal(size=(4, PIXELS)).astype(np.float32))

    left = (size * rng.normal(size=(2, PIXELS))).astype(np.float32)
    return Fields(answer(), answer(), *left)


def exact_step(sides: tuple[Fields, Fields], values: Float32) -> np.ndarray:
    """Return the changes of a, x, b, y by LAPACK; the columns are f(x), a·f'(x), f(y), b·f'(y) of both harmonics."""
    a, _, b, _ = values
    rows, right = [], []
    for side in sides:
        for fx, sx, fy, sy in (
            (side.x.re, side.x.slope_re, side.y.re, side.y.slope_re),
            (side.x.im, side.x.slope_im, side.y.im, side.y.slope_im),
        ):
            rows.append(np.stack([fx, a * sx, fy, b * sy]))
        right += [side.left_re, side.left_im]
    matrix = np.moveaxis(np.stack(rows).astype(np.float64), 2, 0)
    solution: np.ndarray = np.linalg.solve(matrix, np.stack(right).T.astype(np.float64)[..., np.newaxis])[..., 0].T
    return solution


@pytest.mark.parametrize("size", [1e-4, 10.0])
def test_a_step_solves_the_four_equations_and_turns_no_path_by_more_than_its_limit(size: float) -> None:
    rng = np.random.default_rng(1)
    sides = fields(rng, size), fields(rng, size)
    values = rng.uniform(0.2, 1.0, (4, PIXELS)).astype(np.float32)
    expected = exact_step(sides, values)
    turn = np.maximum(np.abs(expected[1]), np.abs(expected[3]))
    expected *= np.minimum(1.0, 0.4 / turn)
    found = newton_step(*sides, values)
    scale = np.abs(expected).max(axis=0)
    assert np.median(np.abs(found - expected).max(axis=0) / scale) < 1e-5
    assert (np.abs(found - expected).max(axis=0) / scale).max() < 1e-2
    assert (turn < 0.4).any() if size < 1.0 else (turn > 0.4).any()


def test_no_amplitude_falls_below_a_tenth_in_one_step() -> None:
    values = np.array([[0.5, 0.5], [1.0, 1.0], [0.3, 0.3], [6.0, 6.0]], np.float32)
    step = np.array([[-0.2, -0.6], [-2.0, 0.5], [0.1, -0.28], [0.4, 0.0]], np.float32)
    np.testing.assert_allclose(stepped(values, step), [[0.3, 0.05], [-1.0, 1.5], [0.4, 0.03], [6.4, 6.0]], rtol=1e-6)
    np.testing.assert_array_equal(values[0], np.float32(0.5))
