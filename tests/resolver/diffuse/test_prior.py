"""The prior of rooms has the documented numbers, and is a valid distribution."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse import prior
from cadtof_cli.resolver.diffuse.prior import MEAN, between_rooms, pattern, within_room


def test_the_typical_room_is_the_documented_one() -> None:
    """Albedo .95; beside the view as within; later bounces unscaled; unseen light .1, decay 12 ns, start 4.4 ns."""
    s, b, u, v, decay_ns = np.exp(MEAN[:5])
    assert_allclose((s, b, u, v, decay_ns, MEAN[5]), (0.95, 1.0, 1.0, 0.1, 12.0, 4.4))


@pytest.mark.parametrize("known", [True, False])
def test_rooms_differ_by_the_documented_spreads_and_more_if_the_optics_are_assumed(known: bool) -> None:
    """An error of 15 % of the focal length is 30 % of every area, and so of the albedo and of later bounces."""
    spreads = np.array([0.38, 0.3, 0.42, 1.8, 0.65, 1.5])
    within_spreads = np.array([0.15, 0.42, 0.35, 1.2, 0.42, 1.75])
    assumed = 0.0 if known else np.array([0.3, 0.0, 0.3, 0.0, 0.0, 0.0])
    between, within = between_rooms(known_optics=known), within_room(known_optics=known)
    assert_allclose(np.diag(between), spreads**2 + assumed**2)
    assert_allclose(np.diag(within), within_spreads**2 + assumed**2)
    assert_allclose(prior.WITHIN_PATCH, (1.1 * within_spreads, 0.8 * within_spreads))


def test_the_prior_has_the_documented_correlations() -> None:
    between = between_rooms(known_optics=True)
    assert (np.linalg.eigvalsh(between) > 0.0).all()
    assert_allclose(between, between.T)
    spreads = np.sqrt(np.diag(between))
    correlation = between / np.outer(spreads, spreads)
    expected = np.eye(6)
    for (i, j), value in {(0, 3): 0.45, (3, 5): -0.6, (4, 5): 0.5}.items():
        expected[i, j] = expected[j, i] = value
    assert_allclose(correlation, expected)
    within = within_room(known_optics=True)
    assert_allclose(within, np.diag(np.diag(within)))


def test_weakly_lit_surfaces_get_more_unseen_light_by_the_documented_power() -> None:
    """v is in proportion to E^−.7, with the factor 1 for the direct light E of a surface 3 m away."""
    distance_m = np.array([1.0, 3.0, 6.0])
    found = pattern(1.0 / distance_m**2)
    assert_allclose(np.exp(found[3]), (distance_m / 3.0) ** 1.4)
    assert_allclose(np.delete(found, 3, axis=0), 0.0)
