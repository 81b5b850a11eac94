"""A patch has separate paths if no decaying tail gives its q_2; phasors that are 0, NaN or too large are no light."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.choice import separate_patches
from cadtof_cli.resolver.diffuse.light import PatchMeans, is_light
from tests.support.diffuse_frames import OMEGA, Tail

SIGMA = 1e-3


def is_separate(h1: complex, h2: complex, *, sigma: float = SIGMA) -> bool:
    ratio = h2 * abs(h1) / h1**2
    means = PatchMeans(
        np.full((1, 1, 1), ratio), np.full((1, 1), 0.2), np.full((1, 1), 64.0), np.zeros((1, 1)), np.ones((1, 1))
    )
    return bool(separate_patches(means, np.ones((1, 1), bool), sigma)[0, 0])


@pytest.mark.parametrize("strength", [0.1, 0.3, 0.8])
@pytest.mark.parametrize("start_ns", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("decay_ns", [3.0, 8.0, 15.0])
def test_no_decaying_tail_has_separate_paths(strength: float, start_ns: float, decay_ns: float) -> None:
    tail = Tail(strength, start_ns, decay_ns)
    assert not is_separate(1 + tail.phasor(1), 1 + tail.phasor(2))


@pytest.mark.parametrize("delay_ns", [8.0, 12.0, 16.0])
@pytest.mark.parametrize("strength", [2.0, 4.0])
def test_a_weak_first_surface_before_a_strong_one_has_separate_paths(delay_ns: float, strength: float) -> None:
    assert is_separate(*(1 + strength * np.exp(1j * h * OMEGA * delay_ns) for h in (1, 2)))


@pytest.mark.parametrize("delay_ns", [16.0, 19.0, 22.0])
def test_a_strong_late_second_path_is_separate(delay_ns: float) -> None:
    assert is_separate(*(1 + 0.4 * np.exp(1j * h * OMEGA * delay_ns) for h in (1, 2)))


def test_noise_alone_does_not_make_separate_paths() -> None:
    assert is_separate(1.0, 1.25)
    assert not is_separate(1.0, 1.25, sigma=0.02)


@pytest.mark.parametrize("value", [1e200, -1e200, 1e200j, -1e200j, np.nan, 0.0])
def test_phasors_that_are_too_large_nan_or_0_are_no_light(value: complex) -> None:
    phasors = np.array([[0.1 + 0.1j, value], [0.1j, 0.1]])
    assert is_light(phasors).tolist() == [True, False]
