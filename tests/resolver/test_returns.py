"""Which path is direct, and which order the others stand in."""

from dataclasses import astuple

import numpy as np
import pytest

from cadtof_cli.resolver.paths import Path, PathSet
from cadtof_cli.resolver.returns import arranged, direct_and_mpi
from cadtof_cli.resolver.settings import RETURNS, ResolverSettings, Return
from tests.support.mixtures import F


def path_set(amplitude: F, phase_rad: F) -> PathSet:
    count = amplitude.shape[1]
    return PathSet(amplitude, phase_rad, 0.01 * amplitude, np.zeros(count), np.ones(count, bool), np.zeros(count, bool))


@pytest.mark.parametrize("returns", RETURNS)
@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.6])
def test_many_paths_are_arranged_as_two_are(returns: Return, ratio: float) -> None:
    rng = np.random.default_rng(6)
    amplitude, phase = rng.uniform(0.01, 1.0, (2, 2000)), rng.uniform(0, 2 * np.pi, (2, 2000))
    settings = ResolverSettings(returns=returns, min_return_ratio=ratio)
    x, y = (Path(amplitude[row], phase[row], 0.01 * amplitude[row]) for row in (0, 1))
    for one, other in zip(arranged(path_set(amplitude, phase), settings), direct_and_mpi(x, y, settings), strict=True):
        np.testing.assert_array_equal(astuple(one), astuple(other))


def test_three_paths_stand_by_time_then_by_strength() -> None:
    amplitude = np.array([[0.2], [1.0], [0.5]])
    phase = np.array([[2.0], [1.0], [1.5]])
    times = {
        returns: [path.phase_rad[0] for path in arranged(path_set(amplitude, phase), ResolverSettings(returns=returns))]
        for returns in RETURNS
    }
    assert times == {"first": [1.0, 1.5, 2.0], "strongest": [1.0, 1.5, 2.0], "last": [2.0, 1.0, 1.5]}


def test_echoes_of_the_strongest_go_behind_it_and_missing_paths_last() -> None:
    amplitude = np.array([[0.3], [np.nan], [1.0], [0.05]])
    phase = np.array([[0.5], [np.nan], [5.0], [4.9]])
    found = [path.phase_rad[0] for path in arranged(path_set(amplitude, phase), ResolverSettings())]
    np.testing.assert_allclose(found, [5.0, 0.5 + 2 * np.pi, 4.9, np.nan])


@pytest.mark.parametrize(("ratio", "lead", "echo"), [(0.45, 3.2, True), (0.55, 3.2, False), (0.45, 3.1, False)])
def test_an_echo_of_the_strongest_is_weak_and_half_a_turn_ahead(ratio: float, lead: float, echo: bool) -> None:
    amplitude, phase = np.array([[1.0], [ratio], [0.01]]), np.array([[5.0], [5.0 - lead], [5.5]])
    found = [path.phase_rad[0] for path in arranged(path_set(amplitude, phase), ResolverSettings(min_return_ratio=0.1))]
    expected = [5.0, 5.0 - lead + 2 * np.pi, 5.5] if echo else [5.0 - lead, 5.0, 5.5]
    np.testing.assert_allclose(found, expected)
