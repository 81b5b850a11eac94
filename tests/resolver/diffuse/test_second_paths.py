"""Frames of two true paths are recognised as such by their physics, and tails of rooms are not taken for two paths."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.resolver.diffuse.second_paths import (
    PatchData,
    SecondPaths,
    delay_spread,
    further_chi_squared,
    further_harmonics_tell,
    has_one_share,
    median_of_noise,
    predict_further_harmonics,
    two_path_lag,
)
from cadtof_cli.resolver.kernels import available_kernels
from tests.support.diffuse_frames import OMEGA, F, Tail
from tests.support.diffuse_patches import PATCHES, patch_data

SIGMA = 1e-3

data = partial(patch_data, sigma=SIGMA)

COUNT = math.prod(PATCHES)

LATER = np.linspace(3.0, 18.0, COUNT)


def second(share: float | F, later_ns: float | F, harmonics: int = 2) -> list[Complex]:
    turn: Complex = np.exp(1j * OMEGA * np.broadcast_to(later_ns, COUNT))
    return [share * turn**h for h in range(1, harmonics + 1)]


def tails(harmonics: int, scatter: float, seed: int = 1) -> list[Complex]:
    """Return the MPI of a tail for every patch, with random strength and delay, by harmonic."""
    rng = np.random.default_rng(seed)
    strengths, starts = 0.2 * np.exp(rng.normal(size=COUNT) * scatter), 4.0 + rng.normal(size=COUNT) * 6.0 * scatter
    each = [Tail(strength, start) for strength, start in zip(strengths, starts, strict=True)]
    return [np.array([tail.phasor(h) for tail in each]) for h in range(1, harmonics + 1)]


def found(patches: PatchData) -> SecondPaths:
    with np.errstate(all="ignore"):
        return SecondPaths.of(patches)


def one_share(patches: PatchData) -> bool:
    return has_one_share(found(patches), rad_per_ns=OMEGA)


def two_paths(patches: PatchData) -> bool:
    paths = found(patches)
    return has_one_share(paths, rad_per_ns=OMEGA) or third_is_foretold(patches)


def third_is_foretold(patches: PatchData) -> bool:
    return further_harmonics_tell(found(patches), patches) and predict_further_harmonics(found(patches), patches)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.5])
def test_second_paths_are_those_that_were_put_in(share: float) -> None:
    paths = found(data(*second(share, LATER), noisy=False))
    assert_allclose(paths.log_share, np.log(share), rtol=1e-6)
    assert_allclose(paths.later_rad, OMEGA * LATER, rtol=1e-6)


def test_the_stronger_of_two_paths_is_not_the_second() -> None:
    paths = found(data(*second(2.5, 9.0), noisy=False))
    assert_allclose(paths.log_share, -np.log(2.5), rtol=1e-6)
    assert_allclose(paths.later_rad, -OMEGA * 9.0, rtol=1e-6)


@pytest.mark.parametrize("share", [0.01, 0.02, 0.1, 0.5])
def test_one_share_at_many_delays_is_two_paths(share: float) -> None:
    patches = data(*second(share, LATER))
    assert one_share(patches)
    assert two_paths(patches)


@pytest.mark.parametrize("scatter", [0.1, 0.3, 1.0])
def test_tails_are_not_of_one_share_and_foretell_no_third_harmonic(scatter: float) -> None:
    assert not two_paths(data(*tails(2, scatter)))
    assert not two_paths(data(*tails(3, scatter)))


def test_shares_that_follow_the_delay_are_not_one() -> None:
    """In rooms, the logarithm of the share falls by at least .1 per ns. A third of that may still be one share."""
    for per_ns, same in ((0.1, False), (0.03, True)):
        patches = data(*second(0.2 * np.exp(-per_ns * LATER), LATER))
        assert one_share(patches) is same


def test_the_same_share_at_the_same_delay_may_be_a_tail() -> None:
    for share in (0.02, 0.2):
        patches = data(*second(share, 9.0))
        assert not one_share(patches)


def test_noise_that_hides_how_shares_scatter_makes_no_two_paths() -> None:
    """The shares scatter as little as in any room, with noise from below to above this scatter."""
    rng = np.random.default_rng(2)
    scatter = rng.normal(size=COUNT)
    mpi = second(0.1 * np.exp(0.1 * scatter), 9.0 + 0.8 * scatter)
    for sigma in (1e-4, 1e-3, 3e-3, 1e-2, 3e-2):
        for seed in range(10):
            patches = data(*mpi, sigma=sigma, seed=seed)
            assert not one_share(patches)


def test_few_patches_do_not_tell() -> None:
    few = np.where(np.arange(COUNT) < 63, 1.0, 0.0)
    for more, same in ((0, False), (2, True)):
        share = 0.1 * np.roll(few, 0) + 0.1 * (np.arange(COUNT) >= COUNT - more)
        patches = data(*second(share, np.roll(LATER, 40)))
        assert one_share(patches) is same


@pytest.mark.parametrize("harmonics", [3, 4])
def test_two_paths_foretell_further_harmonics_whatever_their_shares_and_delays(harmonics: int) -> None:
    rng = np.random.default_rng(3)
    patches = data(*second(0.1 * np.exp(rng.normal(size=COUNT)), 9.0 + rng.normal(size=COUNT), harmonics))
    assert not one_share(patches)
    assert third_is_foretold(patches)
    assert two_paths(patches)


def test_two_harmonics_foretell_nothing() -> None:
    patches = data(*second(0.1, 9.0))
    assert not third_is_foretold(patches)


def test_a_third_path_is_not_foretold() -> None:
    mpi = [a + b for a, b in zip(second(0.1, 9.0, 3), second(0.03, 14.0, 3), strict=True)]
    patches = data(*mpi)
    assert not third_is_foretold(patches)


def test_mpi_that_is_hardly_seen_is_not_foretold() -> None:
    """For a share of .01 at 9 ns, |q_2 − 1| is .02, with a noise of √(2.5 + 1)·σ/(.2·8)."""
    mpi = second(0.01, 9.0, 3)
    for sigma, seen in ((1.5e-3, True), (4e-3, False)):
        patches = data(*mpi, sigma=sigma)
        assert third_is_foretold(patches) is seen


@pytest.mark.parametrize(("later_ns", "sigma", "tells"), [(3.5, 1e-3, True), (3.5, 3e-3, False), (9.0, 3e-3, True)])
def test_the_shorter_a_delay_the_less_noise_tells_two_paths_from_a_tail(
    later_ns: float, sigma: float, tells: bool
) -> None:
    """For a share of .3 at 3.5 ns, |q_2 − 1| is .08. That is 28 times its noise even in the case that does not tell."""
    patches = data(*second(0.3, later_ns, 3), sigma=sigma)
    paths = found(patches)
    assert predict_further_harmonics(paths, patches)
    assert further_harmonics_tell(paths, patches) is tells


def test_misses_of_what_is_foretold_are_those_of_noise() -> None:
    """If only noise is left, the median χ² is that of noise for any share, because the covariance is right."""
    shares: Float = np.array([0.02, 0.1, 0.4])
    for share in shares:
        patches = data(*second(share, 9.0, 3), sigma=5e-4)
        assert third_is_foretold(patches)
        worse = PatchData(patches.ratios, patches.relative / 1.6, patches.harmonics)
        assert not third_is_foretold(worse)


def test_errors_of_a_model_are_tolerated_besides_noise() -> None:
    """An error of .1 rad at the third harmonic is much more than noise. With a tolerance of .1 rad, χ² is 1."""
    patches = data(*second(0.1, 9.0, 3), noisy=False)
    off = replace(patches, ratios=patches.ratios * np.array([[1.0], [np.exp(0.1j)]]))
    tolerated = np.zeros((2, *patches.ratios.shape))
    tolerated[1, 1] = 0.1**2
    assert further_chi_squared(found(patches), patches).max() < 1e-6
    assert further_chi_squared(found(off), off).min() > 100.0
    assert_allclose(further_chi_squared(found(off), replace(off, tolerated=tolerated)), 1.0, atol=0.05)


def of_delays(share: float, later_ns: F, kappa: float, harmonics: int) -> list[Complex]:
    """Return MPI of two delays with half of the light each; their variance is κ times the square of their mean."""
    off = np.sqrt(kappa) * later_ns
    return [
        0.5 * share * (np.exp(1j * h * OMEGA * (later_ns - off)) + np.exp(1j * h * OMEGA * (later_ns + off)))
        for h in range(1, harmonics + 1)
    ]


@pytest.mark.parametrize("harmonics", [3, 4])
def test_the_spread_of_delays_is_what_further_harmonics_miss(harmonics: int) -> None:
    later = np.linspace(3.0, 9.0, COUNT)
    for kappa in (1e-4, 1e-3):
        patches = patch_data(*of_delays(0.2, later, kappa, harmonics), sigma=1e-6, noisy=False)
        assert delay_spread(found(patches), patches)[0] == pytest.approx(kappa, rel=20.0 * kappa)


@pytest.mark.parametrize("harmonics", [3, 4])
def test_the_spread_of_delays_is_as_sure_as_it_says(harmonics: int) -> None:
    later, told = np.linspace(3.0, 9.0, COUNT), []
    for seed in range(60):
        patches = data(*second(0.2, later, harmonics), seed=seed)
        told.append(delay_spread(found(patches), patches))
    values, sigmas = np.array(told).T
    assert abs(values.mean()) < 0.5 * sigmas.mean()
    assert 0.75 < values.std() / sigmas.mean() < 1.3


def test_a_tail_that_is_short_for_its_noise_is_no_two_paths_though_they_foretell_it() -> None:
    """Patch by patch, χ² hardly differs from that of noise, but all patches together show the tail."""
    short = np.linspace(4.0, 7.0, COUNT)
    for seed in range(5):
        patches = patch_data(*of_delays(0.1, short, 0.03, 3), sigma=4e-3, seed=seed)
        paths = found(patches)
        assert np.median(further_chi_squared(paths, patches)) < 1.35 * median_of_noise(2)
        assert not predict_further_harmonics(paths, patches)
        alone = patch_data(*second(0.1, short, 3), sigma=4e-3, seed=seed)
        assert predict_further_harmonics(found(alone), alone)


def test_patches_that_show_two_surfaces_say_little_of_the_spread_of_delays() -> None:
    """One patch in twenty shows two surfaces. Without a limit on each patch, the mean would be .008, as in a corner."""
    mpi, edges = second(0.2, LATER, 3), np.arange(COUNT) % 20 == 0
    mpi[1] = np.where(edges, -mpi[1], mpi[1])
    patches = data(*mpi)
    assert 0.0 < delay_spread(found(patches), patches)[0] < 0.006


def test_of_no_second_path_the_delays_have_no_spread() -> None:
    nothing = [np.zeros(COUNT, np.complex128)] * 3
    patches = patch_data(*nothing, sigma=0.0)
    with np.errstate(all="ignore"):
        assert delay_spread(found(patches), patches) == (0.0, np.inf)


@pytest.mark.parametrize("numbers", [2, 4, 8])
def test_the_median_of_noise(numbers: int) -> None:
    drawn = np.random.default_rng(5).chisquare(numbers, 400_000)
    assert_allclose(median_of_noise(numbers), np.median(drawn), rtol=0.02)


@pytest.mark.parametrize("kernel", available_kernels())
def test_every_kernel_says_the_same(kernel: str) -> None:
    patches = data(*second(0.1, LATER))
    one, other = SecondPaths.of(patches), SecondPaths.of(patches, kernel=kernel)
    np.testing.assert_array_equal(one.log_share, other.log_share)
    np.testing.assert_array_equal(one.later_rad, other.later_rad)


def test_light_without_mpi_has_no_second_paths() -> None:
    assert not two_paths(data(*second(0.0, 9.0)))
    assert not two_paths(data(*second(0.0, 9.0), noisy=False))


def two_paths_lag(ratio: float, delay_rad: float) -> tuple[complex, float]:
    """Return q_2 of two paths, and the phase of their sum minus that of the stronger path."""
    light = [1.0 + ratio * np.exp(1j * h * delay_rad) for h in (1, 2)]
    stronger = 0.0 if ratio <= 1.0 else delay_rad
    return light[1] * abs(light[0]) / light[0] ** 2, float(np.angle(light[0] * np.exp(-1j * stronger)))


@pytest.mark.parametrize("ratio", [0.05, 0.4, 0.8, 1.5, 4.0])
@pytest.mark.parametrize("delay_rad", [0.6, 1.4, 2.2])
def test_the_first_depth_is_that_of_the_stronger_of_two_paths(ratio: float, delay_rad: float) -> None:
    q, lag = two_paths_lag(ratio, delay_rad)
    assert_allclose(two_path_lag(np.array([q])), [lag], atol=1e-9)


def test_light_of_one_path_does_not_lag() -> None:
    assert two_path_lag(np.array([1.0 + 0.0j])).tolist() == [0.0]
