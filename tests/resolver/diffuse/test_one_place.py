"""The place that sends the light of all second paths is found from the delays at the surfaces of the view."""

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.diffuse.one_place import residual_after_one_place

X, Y = (side.ravel() for side in np.meshgrid(np.linspace(-0.57, 0.57, 20), np.linspace(-0.43, 0.43, 15)))

RAYS: Float = np.stack([X, Y, np.ones_like(X)]) / np.sqrt(1.0 + X**2 + Y**2)

BESIDE = [(1.5, 0.2, 0.4), (-2.0, 0.0, 1.0), (0.3, -1.2, 0.2), (-0.2, 1.4, 0.8)]


def surfaces(*, depth: float = 1.0, slope: float = 0.0, step: float = 0.0) -> Float:
    """Return positions on a wall, (3, n); the middle part stands before the rest by `step`."""
    across = X / (1.0 + slope * X)
    shape = np.sqrt(1.0 + X**2 + Y**2)
    range_rad = depth * shape / (1.0 + slope * X) - step * (np.abs(across) < 0.2)
    return RAYS * range_rad


def delays(place: tuple[float, float, float], positions: Float, before: float | None = None) -> Float:
    """Return the delays of light by way of a place, (n,).

    `before` is how far the light goes before it comes from the place; by default, it is the distance from the camera.
    """
    straight = np.sqrt((positions**2).sum(axis=0))
    by_place = np.sqrt(((np.array(place)[:, None] - positions) ** 2).sum(axis=0))
    return np.asarray((np.sqrt(np.square(place).sum()) if before is None else before) + by_place - straight)


@pytest.mark.parametrize("place", BESIDE)
@pytest.mark.parametrize("shape", [{}, {"slope": 0.5}, {"step": 0.3}, {"depth": 2.5}], ids=str)
def test_light_by_way_of_one_place_is_explained(place: tuple[float, float, float], shape: dict[str, float]) -> None:
    positions = surfaces(**shape)
    later = delays(place, positions)
    residual = residual_after_one_place(later, np.full(later.size, 1e-6), positions)
    assert np.median(np.abs(residual)) < 0.01 * later.std()


def test_light_by_way_of_a_mirror_comes_from_the_image_of_the_lamp() -> None:
    positions = surfaces(step=0.2)
    later = delays((2.4, 0.0, 0.3), positions, before=0.0)
    residual = residual_after_one_place(later, np.full(later.size, 1e-6), positions)
    assert np.abs(residual).max() < 0.01 * later.std()


def test_only_noise_is_left_and_a_few_other_delays_do_no_harm() -> None:
    positions, rng = surfaces(step=0.3), np.random.default_rng(1)
    sigma = np.where(X < 0.0, 0.1, 0.002)
    later = delays(BESIDE[0], positions) + sigma * rng.normal(size=X.size)
    other = rng.random(X.size) < 0.1
    later[other] += rng.uniform(0.5, 1.5, int(other.sum()))
    residual = residual_after_one_place(later, sigma**2, positions) / sigma
    for half in (X < 0.0, X >= 0.0):
        assert np.mean(residual[half & ~other] ** 2) == pytest.approx(1.0, abs=0.3)


def test_light_by_way_of_two_places_is_not_explained() -> None:
    positions = surfaces()
    first, second = (delays(place, positions) for place in BESIDE[:2])
    later = np.where(np.abs(X) < 0.3, first, second)
    residual = residual_after_one_place(later, np.full(later.size, 1e-6), positions)
    assert np.abs(residual).mean() > 0.2 * later.std()


@pytest.mark.parametrize("variance", [0.0, 1e-6, 1e300])
@pytest.mark.parametrize("scale", [0.0, 1e-300, 1.0])
def test_surfaces_at_distance_0_and_delays_without_noise_raise_no_error(scale: float, variance: float) -> None:
    positions = scale * surfaces()
    for later in (np.zeros(X.size), delays(BESIDE[0], positions)):
        with np.errstate(all="ignore"):
            residual = residual_after_one_place(later, np.full(later.size, variance), positions)
        assert residual.shape == later.shape
