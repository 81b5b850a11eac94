"""Which path of a pixel is direct, and in which order the other paths follow it."""

import numpy as np
import pytest

from cadtof_cli.resolver.paths import Paths
from cadtof_cli.resolver.returns import direct_first
from cadtof_cli.resolver.settings import RETURNS, ResolverSettings, Return
from tests.support.mixtures import F


def paths_of(amplitude: F, phase_rad: F) -> Paths:
    return Paths(amplitude, phase_rad, 0.01 * amplitude)


@pytest.mark.parametrize("returns", RETURNS)
@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.6])
def test_two_paths_and_a_missing_third_are_ordered_as_two_paths_are(returns: Return, ratio: float) -> None:
    rng = np.random.default_rng(6)
    amplitude, phase = rng.uniform(0.01, 1.0, (2, 2000)), rng.uniform(0, 2 * np.pi, (2, 2000))
    amplitude[1, :100] = phase[1, :100] = np.nan
    settings = ResolverSettings(returns=returns, min_return_ratio=ratio)
    missing = np.full((1, 2000), np.nan)
    two = direct_first(paths_of(amplitude, phase), settings)
    many = direct_first(paths_of(np.concatenate((amplitude, missing)), np.concatenate((phase, missing))), settings)
    for name in ("amplitude", "phase_rad", "sigma_rad"):
        np.testing.assert_array_equal(getattr(many, name)[:2], getattr(two, name))


def test_the_direct_path_comes_first_and_the_others_by_falling_amplitude() -> None:
    paths = paths_of(np.array([[0.2], [1.0], [0.5]]), np.array([[2.0], [1.0], [1.5]]))
    phases_rad = {
        returns: direct_first(paths, ResolverSettings(returns=returns)).phase_rad[:, 0].tolist() for returns in RETURNS
    }
    assert phases_rad == {"first": [1.0, 1.5, 2.0], "strongest": [1.0, 1.5, 2.0], "last": [2.0, 1.0, 1.5]}


def test_a_wrapped_echo_comes_after_the_strongest_path_and_missing_paths_come_last() -> None:
    amplitude = np.array([[0.3], [np.nan], [1.0], [0.05]])
    phase = np.array([[0.5], [np.nan], [5.0], [4.9]])
    found = direct_first(paths_of(amplitude, phase), ResolverSettings())
    np.testing.assert_allclose(found.phase_rad[:, 0], [5.0, 0.5 + 2 * np.pi, 4.9, np.nan])


@pytest.mark.parametrize(("ratio", "lead", "is_echo"), [(0.45, 3.2, True), (0.55, 3.2, False), (0.45, 3.1, False)])
def test_a_wrapped_echo_is_below_half_the_amplitude_and_over_half_a_turn_ahead(
    ratio: float, lead: float, is_echo: bool
) -> None:
    amplitude, phase = np.array([[1.0], [ratio], [0.01]]), np.array([[5.0], [5.0 - lead], [5.5]])
    found = direct_first(paths_of(amplitude, phase), ResolverSettings(min_return_ratio=0.1))
    expected = [5.0, 5.0 - lead + 2 * np.pi, 5.5] if is_echo else [5.0 - lead, 5.0, 5.5]
    np.testing.assert_allclose(found.phase_rad[:, 0], expected)


@pytest.mark.parametrize("weaker", [0, 1])
@pytest.mark.parametrize(("ratio", "direct"), [(0.5, 0.5), (0.5000001, 1.0)])
def test_a_return_of_exactly_the_min_return_ratio_is_strong_enough(weaker: int, ratio: float, direct: float) -> None:
    """The weaker of the two paths arrives first, with half the amplitude of the stronger path."""
    amplitude, phase = np.full((3, 1), np.nan), np.full((3, 1), np.nan)
    amplitude[weaker], amplitude[1 - weaker], phase[weaker], phase[1 - weaker] = 0.5, 1.0, 1.0, 2.0
    settings = ResolverSettings(min_return_ratio=ratio)
    for paths in (2, 3):
        found = direct_first(paths_of(amplitude[:paths], phase[:paths]), settings)
        assert found.amplitude[0] == direct
