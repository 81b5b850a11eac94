"""Frames of two true paths are recognised as such by their physics, and tails of rooms are not taken for two paths."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.resolver.diffuse.noise import median_of_noise
from cadtof_cli.resolver.diffuse.second_paths import (
    PatchData,
    Scatter,
    SecondPaths,
    delay_spread,
    further_chi_squared,
    further_harmonics_tell,
    has_one_share,
    predict_further_harmonics,
    two_path_lag,
)
from cadtof_cli.resolver.kernels import NUMPY, available_kernels
from tests.support.diffuse_frames import OMEGA, F, Tail
from tests.support.diffuse_patches import PATCHES, patch_data
from tests.support.kernels import by_kernel

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


def found_in(patches: PatchData) -> SecondPaths:
    with np.errstate(all="ignore"):
        return SecondPaths.of(patches)


def have_one_share(patches: PatchData) -> bool:
    return has_one_share(found_in(patches), rad_per_ns=OMEGA)


def are_two_paths(patches: PatchData) -> bool:
    paths = found_in(patches)
    return has_one_share(paths, rad_per_ns=OMEGA) or third_is_predicted(patches)


def third_is_predicted(patches: PatchData) -> bool:
    return further_harmonics_tell(found_in(patches), patches) and predict_further_harmonics(found_in(patches), patches)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.5])
def test_known_second_paths_are_found(share: float) -> None:
    paths = found_in(data(*second(share, LATER), noisy=False))
    assert_allclose(paths.log_share, np.log(share), rtol=1e-6)
    assert_allclose(paths.later_rad, OMEGA * LATER, rtol=1e-6)


def test_the_second_path_is_the_weaker_one_even_if_it_comes_first() -> None:
    paths = found_in(data(*second(2.5, 9.0), noisy=False))
    assert_allclose(paths.log_share, -np.log(2.5), rtol=1e-6)
    assert_allclose(paths.later_rad, -OMEGA * 9.0, rtol=1e-6)


@pytest.mark.parametrize("share", [0.01, 0.02, 0.1, 0.5])
def test_one_share_at_many_delays_is_taken_for_two_paths(share: float) -> None:
    patches = data(*second(share, LATER))
    assert have_one_share(patches)
    assert are_two_paths(patches)


@pytest.mark.parametrize("scatter", [0.1, 0.3, 1.0])
def test_tails_do_not_have_one_share_or_the_third_harmonic_of_two_paths(scatter: float) -> None:
    assert not are_two_paths(data(*tails(2, scatter)))
    assert not are_two_paths(data(*tails(3, scatter)))


def test_shares_that_fall_with_the_delay_are_not_one_share() -> None:
    """In rooms, the logarithm of the share falls by at least .1 per ns. A third of that may still be one share."""
    for per_ns, same in ((0.1, False), (0.03, True)):
        patches = data(*second(0.2 * np.exp(-per_ns * LATER), LATER))
        assert have_one_share(patches) is same


def test_one_share_at_one_delay_is_no_evidence_for_two_paths() -> None:
    for share in (0.02, 0.2):
        patches = data(*second(share, 9.0))
        assert not have_one_share(patches)


def test_noise_that_hides_the_scatter_of_shares_is_not_taken_for_one_share() -> None:
    """The shares scatter as little as in any room, with noise from below to above this scatter."""
    rng = np.random.default_rng(2)
    scatter = rng.normal(size=COUNT)
    mpi = second(0.1 * np.exp(0.1 * scatter), 9.0 + 0.8 * scatter)
    for sigma in (1e-4, 1e-3, 3e-3, 1e-2, 3e-2):
        for seed in range(10):
            patches = data(*mpi, sigma=sigma, seed=seed)
            assert not have_one_share(patches)


def test_the_scatter_of_noisy_values_is_that_of_the_values_without_their_noise() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(scale=0.3, size=40_000) + rng.normal(scale=0.1, size=40_000)
    found = Scatter.of(values, np.full(values.size, 0.1**2))
    assert_allclose([found.least, found.most], 0.3**2, rtol=0.05)


def test_fewer_than_64_patches_do_not_show_one_share() -> None:
    few = np.where(np.arange(COUNT) < 63, 1.0, 0.0)
    for more, same in ((0, False), (2, True)):
        share = 0.1 * few + 0.1 * (np.arange(COUNT) >= COUNT - more)
        patches = data(*second(share, np.roll(LATER, 40)))
        assert have_one_share(patches) is same


@pytest.mark.parametrize("harmonics", [3, 4])
def test_two_paths_of_any_shares_and_delays_predict_further_harmonics(harmonics: int) -> None:
    rng = np.random.default_rng(3)
    patches = data(*second(0.1 * np.exp(rng.normal(size=COUNT)), 9.0 + rng.normal(size=COUNT), harmonics))
    assert not have_one_share(patches)
    assert third_is_predicted(patches)
    assert are_two_paths(patches)


def test_two_harmonics_alone_predict_nothing() -> None:
    patches = data(*second(0.1, 9.0))
    assert not third_is_predicted(patches)


def test_two_paths_do_not_predict_the_third_harmonic_of_three() -> None:
    mpi = [a + b for a, b in zip(second(0.1, 9.0, 3), second(0.03, 14.0, 3), strict=True)]
    patches = data(*mpi)
    assert not third_is_predicted(patches)


def test_weak_mpi_does_not_tell_two_paths_from_a_tail() -> None:
    """For a share of .01 at 9 ns, |q_2 − 1| is .02, with a noise of √(2.5 + 1)·σ/(.2·8)."""
    mpi = second(0.01, 9.0, 3)
    for sigma, seen in ((1.5e-3, True), (4e-3, False)):
        patches = data(*mpi, sigma=sigma)
        assert third_is_predicted(patches) is seen


@pytest.mark.parametrize(("sigma", "tells"), [(2.5e-3, True), (6e-3, False)])
def test_mpi_below_five_times_its_noise_tells_nothing_however_late_it_is(sigma: float, tells: bool) -> None:
    """For a share of .01, |q_2 − 1| is .02: 8 times its noise, and 3 times."""
    patches = data(*second(0.01, 16.0, 3), sigma=sigma)
    assert further_harmonics_tell(found_in(patches), patches) is tells


@pytest.mark.parametrize(("later_ns", "sigma", "tells"), [(3.5, 1e-3, True), (3.5, 3e-3, False), (9.0, 3e-3, True)])
def test_the_shorter_the_delay_the_less_noise_is_allowed_to_tell_two_paths_from_a_tail(
    later_ns: float, sigma: float, tells: bool
) -> None:
    """For a share of .3 at 3.5 ns, |q_2 − 1| is .08. That is 28 times its noise even in the case that does not tell."""
    patches = data(*second(0.3, later_ns, 3), sigma=sigma)
    paths = found_in(patches)
    assert predict_further_harmonics(paths, patches)
    assert further_harmonics_tell(paths, patches) is tells


def test_residuals_of_the_predicted_harmonic_have_the_size_of_noise() -> None:
    """If only noise is left, the median χ² is that of noise for any share, because the covariance is right."""
    shares: Float = np.array([0.02, 0.1, 0.4])
    for share in shares:
        patches = data(*second(share, 9.0, 3), sigma=5e-4)
        assert third_is_predicted(patches)
        worse = PatchData(patches.ratios, patches.relative / 1.6, patches.harmonics)
        assert not third_is_predicted(worse)


def test_tolerated_errors_are_added_to_the_noise() -> None:
    """An error of .1 rad at the third harmonic is much more than noise. With a tolerance of .1 rad, χ² is 1."""
    patches = data(*second(0.1, 9.0, 3), noisy=False)
    with_error = replace(patches, ratios=patches.ratios * np.array([[1.0], [np.exp(0.1j)]]))
    tolerated = np.zeros((2, *patches.ratios.shape))
    tolerated[1, 1] = 0.1**2
    assert further_chi_squared(found_in(patches), patches).max() < 1e-6
    assert further_chi_squared(found_in(with_error), with_error).min() > 100.0
    assert_allclose(further_chi_squared(found_in(with_error), replace(with_error, tolerated=tolerated)), 1.0, atol=0.05)


def of_delays(share: float, later_ns: F, kappa: float, harmonics: int) -> list[Complex]:
    """Return MPI of two delays with half of the light each; their variance is κ times the square of their mean."""
    deviation_ns = np.sqrt(kappa) * later_ns
    return [
        0.5
        * share
        * (np.exp(1j * h * OMEGA * (later_ns - deviation_ns)) + np.exp(1j * h * OMEGA * (later_ns + deviation_ns)))
        for h in range(1, harmonics + 1)
    ]


@pytest.mark.parametrize("harmonics", [3, 4])
def test_the_spread_of_delays_is_found_from_further_harmonics(harmonics: int) -> None:
    later = np.linspace(3.0, 9.0, COUNT)
    for kappa in (1e-4, 1e-3):
        patches = patch_data(*of_delays(0.2, later, kappa, harmonics), sigma=1e-6, noisy=False)
        assert delay_spread(found_in(patches), patches)[0] == pytest.approx(kappa, rel=20.0 * kappa)


@pytest.mark.parametrize("harmonics", [3, 4])
def test_the_sigma_of_the_spread_of_delays_is_its_scatter(harmonics: int) -> None:
    later, spreads = np.linspace(3.0, 9.0, COUNT), []
    for seed in range(60):
        patches = data(*second(0.2, later, harmonics), seed=seed)
        spreads.append(delay_spread(found_in(patches), patches))
    values, sigmas = np.array(spreads).T
    assert abs(values.mean()) < 0.5 * sigmas.mean()
    assert 0.75 < values.std() / sigmas.mean() < 1.3


def test_a_tail_too_short_for_its_noise_is_recognised_by_the_spread_of_its_delays() -> None:
    """Patch by patch, χ² hardly differs from that of noise, but all patches together show the tail."""
    short = np.linspace(4.0, 7.0, COUNT)
    for seed in range(5):
        patches = patch_data(*of_delays(0.1, short, 0.03, 3), sigma=4e-3, seed=seed)
        paths = found_in(patches)
        assert np.median(further_chi_squared(paths, patches)) < 1.35 * median_of_noise(2)
        assert not predict_further_harmonics(paths, patches)
        alone = patch_data(*second(0.1, short, 3), sigma=4e-3, seed=seed)
        assert predict_further_harmonics(found_in(alone), alone)


def test_patches_that_show_two_surfaces_hardly_change_the_spread_of_delays() -> None:
    """One patch in twenty shows two surfaces. Without a limit on each patch, the mean would be .008, as in a corner."""
    mpi, edges = second(0.2, LATER, 3), np.arange(COUNT) % 20 == 0
    mpi[1] = np.where(edges, -mpi[1], mpi[1])
    patches = data(*mpi)
    assert 0.0 < delay_spread(found_in(patches), patches)[0] < 0.006


def test_without_second_paths_the_spread_of_delays_is_unknown() -> None:
    nothing = [np.zeros(COUNT, np.complex128)] * 3
    patches = patch_data(*nothing, sigma=0.0)
    with np.errstate(all="ignore"):
        assert delay_spread(found_in(patches), patches) == (0.0, np.inf)


@pytest.mark.parametrize("numbers", [2, 4, 8])
def test_the_median_chi_squared_of_noise_is_that_of_draws(numbers: int) -> None:
    drawn = np.random.default_rng(5).chisquare(numbers, 400_000)
    assert_allclose(median_of_noise(numbers), np.median(drawn), rtol=0.02)


@pytest.mark.parametrize("kernel", available_kernels())
def test_every_kernel_gives_the_same_second_paths(kernel: str) -> None:
    patches = data(*second(0.1, LATER))
    one, other = (by_kernel(name, SecondPaths.of, patches) for name in (NUMPY, kernel))
    np.testing.assert_array_equal(one.log_share, other.log_share)
    np.testing.assert_array_equal(one.later_rad, other.later_rad)


def test_light_without_mpi_has_no_second_paths() -> None:
    assert not are_two_paths(data(*second(0.0, 9.0)))
    assert not are_two_paths(data(*second(0.0, 9.0), noisy=False))


def lag_of_two_paths(ratio: float, delay_rad: float) -> tuple[complex, float]:
    """Return q_2 of two paths, and the phase of their sum minus that of the stronger path."""
    light = [1.0 + ratio * np.exp(1j * h * delay_rad) for h in (1, 2)]
    stronger = 0.0 if ratio <= 1.0 else delay_rad
    return light[1] * abs(light[0]) / light[0] ** 2, float(np.angle(light[0] * np.exp(-1j * stronger)))


@pytest.mark.parametrize("ratio", [0.05, 0.4, 0.8, 1.5, 4.0])
@pytest.mark.parametrize("delay_rad", [0.6, 1.4, 2.2])
def test_the_two_path_lag_is_that_of_the_stronger_path(ratio: float, delay_rad: float) -> None:
    q, lag = lag_of_two_paths(ratio, delay_rad)
    assert_allclose(two_path_lag(np.array([q])), [lag], atol=1e-9)


def test_light_of_one_path_does_not_lag() -> None:
    assert two_path_lag(np.array([1.0 + 0.0j])).tolist() == [0.0]
