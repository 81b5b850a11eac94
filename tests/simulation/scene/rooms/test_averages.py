"""Averages over traced pixels, with each weight written out: it follows from place, face and likeness of normals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.simulation.scene.rooms.averages import Faces, Lattice, means_of_cells, neighbour_weights

WIDTH, STEP, REACH = 11, 2, 1


def bent(count: int, rng: np.random.Generator, surfaces: int = 2) -> Faces:
    """Return the faces of pixels on random surfaces; their normals scatter about −z."""
    normals = rng.normal(size=(3, count)) * 0.4 + np.array([[0.0], [0.0], [-1.0]])
    return Faces(rng.integers(surfaces, size=count).astype(np.int32), unit(normals))


def unit(normals: Float) -> Float32:
    return np.asarray(normals / np.linalg.norm(normals, axis=0), np.float32)


def nearness(pixel: int, place: int, step: int, reach: int) -> float:
    """Return a weight: 1 at the middle of the place's square, falling linearly to 0 at reach + 1/2 places."""
    return max(0.0, 1.0 - abs(pixel - (step * place + (step - 1) / 2)) / (step * (reach + 0.5)))


@pytest.mark.parametrize(("step", "reach", "rows"), [(2, 1, range(4, 8)), (2, 2, range(8)), (3, 1, range(6, 7))])
def test_a_pixel_averages_neighbours_on_its_face_by_nearness_and_normal(step: int, reach: int, rows: range) -> None:
    rng, lattice = np.random.default_rng(1), Lattice(WIDTH, step, reach)
    across, lines = lattice.across, lattice.rows(rows)
    assert across == len(range(0, WIDTH, step))
    assert list(lines) == list(range(max(rows.start // step - reach, 0), (rows.stop - 1) // step + reach + 1))
    count = len(lines) * across
    samples, seen = bent(count, rng), bent(len(rows) * WIDTH, rng)
    found = neighbour_weights(lattice, rows, seen, np.arange(count), samples).toarray()
    for pixel in range(len(rows) * WIDTH):
        y, x = rows.start + pixel // WIDTH, pixel % WIDTH
        weights = np.zeros(count)
        for sample in range(count):
            row, column = lines.start + sample // across, sample % across
            close = abs(row - y // step) <= reach and abs(column - x // step) <= reach
            if close and samples.surface[sample] == seen.surface[pixel]:
                alike = max(float(samples.normals[:, sample] @ seen.normals[:, pixel]), 0.0) ** 8
                weights[sample] = nearness(y, row, step, reach) * nearness(x, column, step, reach) * alike
        expected = weights / weights.sum() if weights.any() else weights
        assert_allclose(found[pixel], expected, atol=1e-6)


@pytest.mark.usefixtures("no_memory_for_scipy")
def test_too_little_memory_to_average_is_told_and_not_waited_for() -> None:
    one = bent(1, np.random.default_rng(1))
    with pytest.raises(MemoryError):
        neighbour_weights(Lattice(1, 1, 0), range(1), one, np.arange(1), one)
    with pytest.raises(MemoryError):
        means_of_cells(one, 1, 1)


def test_a_pixel_with_no_neighbour_on_its_face_gets_nothing() -> None:
    lattice, rng = Lattice(WIDTH, STEP, REACH), np.random.default_rng(2)
    count = len(lattice.rows(range(4))) * lattice.across
    samples, seen = bent(count, rng, surfaces=1), bent(4 * WIDTH, rng, surfaces=1)
    seen.surface[5] = 7
    sums = neighbour_weights(lattice, range(4), seen, np.arange(count), samples).sum(axis=1)
    assert sums[5] == 0.0
    assert_allclose(np.delete(sums, 5), 1.0)


@pytest.mark.parametrize(("across", "cell"), [(6, 2), (7, 3), (5, 4)])
def test_cells_are_squares_whose_pixels_of_one_face_count_alike(across: int, cell: int) -> None:
    faces = bent(5 * across, np.random.default_rng(3), surfaces=3)
    means, places, mean_faces = means_of_cells(faces, across, cell)
    weights = means.toarray()
    cells = -(-across // cell)
    row, column = np.divmod(np.arange(5 * across), across)
    cell_of_pixel = row // cell * cells + column // cell
    assert weights.shape == (len(places), 5 * across)
    assert {(int(p), int(s)) for p, s in zip(places, mean_faces.surface, strict=True)} == set(
        zip(cell_of_pixel.tolist(), faces.surface.tolist(), strict=True)
    )
    for mean, place, surface, normal in zip(weights, places, mean_faces.surface, mean_faces.normals.T, strict=True):
        inside = (cell_of_pixel == place) & (faces.surface == surface)
        assert_allclose(mean, inside / inside.sum())
        assert_allclose(normal, unit(faces.normals[:, inside].mean(axis=1)), atol=1e-6)
    order = list(zip(places.tolist(), mean_faces.surface.tolist(), strict=True))
    assert order == sorted(order)
