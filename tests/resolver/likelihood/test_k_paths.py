"""Maximum likelihood for K paths against the Cramér–Rao bound, the χ² distribution and an exhaustive search."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import optimize

from cadtof_cli.resolver.likelihood.k_paths import LikelyPaths, found_paths, most_likely
from cadtof_cli.resolver.likelihood.mixture import Measured
from cadtof_cli.resolver.likelihood.mixture import Mixture as Found
from cadtof_cli.resolver.paths import ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.forward import ns_from_rad
from tests.support.mixtures import C, F, Mixture, noise_of

DEFAULT = ResolverSettings()

RUNS = 3000
PHOTONS = 2e5
"""Integration lengths (n_av) of all harmonics added up: two harmonics at the paper's 1e5."""


def resolved(
    phasors: C, harmonics: tuple[int, ...], n_av: float, settings: ResolverSettings = DEFAULT
) -> ResolvedPaths:
    return resolve_paths(
        phasors,
        status=np.zeros(phasors.shape[1], np.uint32),
        settings=settings,
        noise=noise_of(harmonics, n_av=n_av),
    )


def spread_ns(
    problem: Mixture, harmonics: tuple[int, ...], n_av: float, settings: ResolverSettings = DEFAULT
) -> tuple[F, F]:
    """Return the standard deviation of every path's delay, and the median of its predicted sigmas, in ns."""
    drawn = problem.phasors(harmonics, n_av=n_av, size=RUNS, rng=np.random.default_rng(7))
    paths = resolved(drawn, harmonics, n_av, settings).paths
    delays = np.array([ns_from_rad(path.phase_rad) for path in paths])
    assert_allclose(delays.mean(axis=1), problem.delays_ns, atol=0.2 * delays.std(axis=1).max())
    return delays.std(axis=1), np.array([np.median(ns_from_rad(path.sigma_rad)) for path in paths])


@pytest.mark.parametrize("separation", [6.0, 11.0, 20.0])
@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 3, 4), (1, 2, 4), (1, 3, 4)])
def test_two_paths_reach_the_bound_and_their_sigma_is_known(harmonics: tuple[int, ...], separation: float) -> None:
    problem, n_av = Mixture((1.0, 0.3), (5.0, 5.0 + separation)), PHOTONS / len(harmonics)
    spread, predicted = spread_ns(problem, harmonics, n_av)
    assert_allclose(spread, problem.bound_ns(harmonics, n_av), rtol=0.08)
    assert_allclose(predicted, spread, rtol=0.08)


@pytest.mark.parametrize(("harmonics", "gain"), [((1, 2, 3), 2.5), ((1, 2, 3, 4), 5.0)])
def test_more_harmonics_at_the_same_number_of_photons_reduce_the_scatter(
    harmonics: tuple[int, ...], gain: float
) -> None:
    problem = Mixture((1.0, 0.3), (5.0, 11.0))
    two, _ = spread_ns(problem, (1, 2), PHOTONS / 2)
    more, _ = spread_ns(problem, harmonics, PHOTONS / len(harmonics))
    assert two[0] / more[0] >= gain


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 3, 4)])
def test_three_paths_reach_the_bound(harmonics: tuple[int, ...]) -> None:
    problem = Mixture((1.0, 0.6, 0.4), (5.0, 13.0, 21.0))
    spread, predicted = spread_ns(problem, harmonics, 1e6, ResolverSettings(paths=3))
    assert_allclose(spread, problem.bound_ns(harmonics, 1e6), rtol=0.08)
    assert_allclose(predicted, spread, rtol=0.08)


@pytest.mark.parametrize(("paths", "harmonics"), [(1, (1, 2, 3)), (2, (1, 2, 3)), (1, (1, 2, 4)), (2, (1, 2, 3, 4))])
def test_the_misfit_of_the_true_number_of_paths_is_chi_squared(paths: int, harmonics: tuple[int, ...]) -> None:
    problem, n_av = Mixture((1.0, 0.5)[:paths], (5.0, 14.0)[:paths], asr=1.0), 1e5
    measured = Measured.of_phasors(
        problem.phasors(harmonics, n_av=n_av, size=RUNS, rng=np.random.default_rng(8)), harmonics=harmonics
    )
    noise = noise_of(harmonics, n_av=n_av)
    with np.errstate(all="ignore"):
        fit = most_likely(measured, found_paths(measured, paths, noise=noise)[0], noise=noise)
    freedom = 2 * (len(harmonics) - paths)
    assert fit.chi_squared.mean() == pytest.approx(freedom, rel=0.08)
    assert fit.chi_squared.var() == pytest.approx(2 * freedom, rel=0.2)


@pytest.mark.parametrize(("harmonics", "settings"), [((1, 2, 3), DEFAULT), ((1, 3, 4), ResolverSettings(order="2"))])
def test_a_mean_is_resolved_as_a_recording_of_all_its_photons(
    harmonics: tuple[int, ...], settings: ResolverSettings
) -> None:
    frames, n_av = 400.0, 3e3
    as_long = 0.5 * (frames * (2.0 * n_av - 1.0) + 1.0)
    problem = Mixture((1.0, 0.4), (5.0, 13.0), asr=3.0)
    drawn = problem.phasors(harmonics, n_av=as_long, size=RUNS, rng=np.random.default_rng(12))
    one = resolved(drawn, harmonics, as_long, settings)
    noise = replace(noise_of(harmonics, n_av=n_av), samples=np.full(RUNS, frames))
    mean = resolve_paths(drawn, status=np.zeros(RUNS, np.uint32), settings=settings, noise=noise)
    difference = np.abs(mean.paths.phase_rad - one.paths.phase_rad) / one.paths.sigma_rad
    assert np.nanmax(difference) < 1e-6
    assert_allclose(mean.paths.sigma_rad, one.paths.sigma_rad, rtol=1e-6)


@pytest.mark.parametrize("false_alarm", [0.05, 0.01])
@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 4)])
def test_one_path_is_taken_for_two_in_a_third_of_the_false_alarm_rate_and_at_no_cost(
    harmonics: tuple[int, ...], false_alarm: float
) -> None:
    """The misfit exceeds its threshold in the whole share of pixels that was asked for.

    In about a third of these pixels (.3 to .6) the second path moves the direct path enough to be kept.
    """
    drawn = Mixture((1.0,), (5.0,)).phasors(harmonics, n_av=1e5, size=4 * RUNS, rng=np.random.default_rng(9))
    tested = resolved(drawn, harmonics, 1e5, ResolverSettings(false_alarm=false_alarm))
    assert 0.25 * false_alarm < np.mean((tested.status & StatusBit.TWO_PATHS) > 0) < 0.6 * false_alarm
    known = resolved(drawn, harmonics, 1e5, ResolverSettings(order="1"))
    assert tested.paths[0].phase_rad.std() / known.paths[0].phase_rad.std() < 1.05


def test_two_paths_are_taken_for_three_in_a_third_of_the_false_alarm_rate_and_at_little_cost() -> None:
    drawn = Mixture((1.0, 0.5), (5.0, 15.0)).phasors((1, 2, 3), n_av=1e5, size=RUNS, rng=np.random.default_rng(10))
    tested = resolved(drawn, (1, 2, 3), 1e5, ResolverSettings(paths=3, false_alarm=0.05))
    assert 0.22 * 0.05 < np.mean((tested.status & StatusBit.MORE_PATHS) > 0) < 0.6 * 0.05
    assert np.mean((tested.status & StatusBit.TWO_PATHS) > 0) > 0.94
    known = resolved(drawn, (1, 2, 3), 1e5)
    assert tested.paths[0].phase_rad.std() / known.paths[0].phase_rad.std() < 1.1


@pytest.mark.parametrize(
    ("harmonics", "n_av"), [((1, 2, 3), 300.0), ((1, 2, 3), 2e3), ((1, 2, 4), 1e3), ((1, 2, 3, 4), 1e3)]
)
def test_no_exhaustive_search_finds_a_better_pair(harmonics: tuple[int, ...], n_av: float) -> None:
    """With white noise the best amplitudes for two given delays are a linear problem.

    NNLS solves this problem here for every pair of delays on a fine grid.
    """
    drawn = Mixture((1.0, 0.4), (5.0, 13.0), asr=3.0).phasors(
        harmonics, n_av=n_av, size=25, rng=np.random.default_rng(11)
    )
    noise = noise_of(harmonics, n_av=n_av)
    scale = np.sqrt([1.0 / harmonic.dark_variance for harmonic in noise.each])
    with np.errstate(all="ignore"):
        _, found = found_paths(Measured.of_phasors(drawn, harmonics=harmonics), 2, noise=noise)
    grid = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    columns = np.exp(1j * np.outer(harmonics, grid)) * scale[:, np.newaxis]
    real = np.concatenate((columns.real, columns.imag))
    for pixel, chi_squared in zip((drawn * scale[:, np.newaxis]).T, found, strict=True):
        right = np.concatenate((pixel.real, pixel.imag))
        best = min(optimize.nnls(real[:, [i, j]], right)[1] for i, j in itertools.combinations(range(grid.size), 2))
        assert chi_squared <= best**2 + 0.1


@pytest.mark.parametrize("harmonics", [(1, 3, 4), (1, 4, 5), (1, 4, 5, 6)])
def test_without_the_second_harmonic_minima_near_the_best_one_are_not_taken_for_it(harmonics: tuple[int, ...]) -> None:
    """The best pair has at most the misfit of the true one. The minima lie nearer to each other than coarse delays."""
    rng, noise = np.random.default_rng(5), noise_of(harmonics, n_av=1e5)
    delays = np.array([[0.0], [1.0]]) * rng.uniform(0.5, 3.1, RUNS) + rng.uniform(0.0, 2.5, RUNS)
    amplitudes = np.stack((np.ones(RUNS), rng.uniform(0.15, 1.2, RUNS)))
    amplitudes /= amplitudes.sum(axis=0) + 3.0
    true = sum(a * np.exp(1j * np.outer(harmonics, x)) for a, x in zip(amplitudes, delays, strict=True))
    variances = np.array([[harmonic.dark_variance] for harmonic in noise.each])
    drawn = true + np.sqrt(variances) * (rng.normal(size=true.shape) + 1j * rng.normal(size=true.shape))
    with np.errstate(all="ignore"):
        _, misfit = found_paths(Measured.of_phasors(drawn, harmonics=harmonics), 2, noise=noise)
    assert np.mean(misfit > (np.abs(drawn - true) ** 2 / variances).sum(axis=0) + 0.5) < 0.004


@pytest.mark.parametrize(
    ("harmonics", "most"), [((1, 2, 4), 0.003), ((1, 2, 4, 6), 0.015), ((1, 2, 4, 8), 0.03), ((1, 3, 4, 5), 0.04)]
)
def test_three_paths_of_harmonics_with_gaps_seldom_end_in_a_wrong_minimum(
    harmonics: tuple[int, ...], most: float
) -> None:
    """From one path fewer alone, twice to ten times as many pixels did."""
    rng, noise, count = np.random.default_rng(21), noise_of(harmonics, n_av=1e6), 4000
    amplitudes = np.stack([np.ones(count), rng.uniform(0.2, 1.0, count), rng.uniform(0.1, 0.6, count)])
    amplitudes /= amplitudes.sum(axis=0) + 5.0
    first = rng.uniform(2.0, 15.0, count)
    delays_ns = np.stack([first, first + rng.uniform(4.0, 12.0, count), first + rng.uniform(16.0, 24.0, count)])
    true = np.stack([(amplitudes * np.exp(2j * np.pi * h * delays_ns / 40.0)).sum(axis=0) for h in harmonics])
    variances = np.array([[harmonic.dark_variance] for harmonic in noise.each])
    drawn = true + np.sqrt(variances) * (rng.normal(size=true.shape) + 1j * rng.normal(size=true.shape))
    with np.errstate(all="ignore"):
        _, misfit = found_paths(Measured.of_phasors(drawn, harmonics=harmonics), 3, noise=noise)
    assert np.mean(misfit > (np.abs(drawn - true) ** 2 / variances).sum(axis=0) + 0.5) < most


@pytest.mark.parametrize("count", [3, 4])
def test_as_many_paths_as_harmonics_explain_any_light_exactly(count: int) -> None:
    """There always is such an answer (Carathéodory); the other starts miss it in one of ten pixels with four harmonics."""
    rng, harmonics = np.random.default_rng(1), tuple(range(1, count + 1))
    amplitudes, phases = rng.uniform(0.1, 1.0, (count, 500)) / count, rng.uniform(0.0, 2.0 * np.pi, (count, 500))
    phasors = np.array([(amplitudes * np.exp(1j * h * phases)).sum(axis=0) for h in harmonics])
    measured = Measured.of_phasors(phasors, harmonics=harmonics)
    _, misfit = found_paths(measured, count, noise=noise_of(harmonics, n_av=1e6))
    assert misfit.max() < 0.01
    assert np.median(misfit) < 1e-15


def test_chi_squared_is_large_where_two_paths_are_too_few() -> None:
    three = Mixture((1.0, 0.6, 0.4), (5.0, 13.0, 21.0)).exact((1, 2, 3, 4))
    two = Mixture((1.0, 0.6), (5.0, 13.0)).exact((1, 2, 3, 4))
    left = resolved(np.concatenate((three, two), axis=1), (1, 2, 3, 4), 1e6).chi_squared
    assert left[0] > 100.0
    assert left[1] < 1e-6


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 4)])
def test_the_fall_off_of_one_path_is_the_signed_square_of_a_normal_deviate(harmonics: tuple[int, ...]) -> None:
    """`fall_off` is the square of a standard normal deviate, with the sign of the deviate.

    So its sign is + in half of the pixels; its magnitude has the mean 1 and the median .455. Light of two close paths
    falls off, so that its sign is +.
    """
    noise, rng = noise_of(harmonics, n_av=1e5), np.random.default_rng(11)

    def fall_off(problem: Mixture) -> F:
        drawn = problem.phasors(harmonics, n_av=1e5, size=2 * RUNS, rng=rng)
        measured = Measured.of_phasors(drawn, harmonics=harmonics)
        found = most_likely(measured, found_paths(measured, 1, noise=noise)[0], noise=noise).fall_off
        assert found is not None
        return found

    alone = fall_off(Mixture((1.0,), (5.0,), asr=3.0))
    assert np.abs(alone).mean() == pytest.approx(1.0, abs=0.06)
    assert np.median(np.abs(alone)) == pytest.approx(0.455, abs=0.05)
    assert (alone > 0.0).mean() == pytest.approx(0.5, abs=0.03)
    assert (fall_off(Mixture((1.0, 1.0), (5.0, 8.0), asr=3.0)) > 0.0).mean() > 0.95


def test_paths_of_the_same_phase_cannot_be_told_apart_at_all() -> None:
    """This must hold although rounding makes the length of some rotors larger than 1."""
    phase = np.linspace(0.0, 2.0 * np.pi, 1000)
    cos, sin = np.cos(phase), np.sin(phase)
    assert (cos * cos + sin * sin > 1.0).any()
    same, none = Found(np.full((2, 1000), 0.3), np.stack((cos, cos)), np.stack((sin, sin))), np.zeros(1000)
    with np.errstate(divide="ignore"):
        fit = LikelyPaths(same, np.full((2, 1000), 1e-3), none, np.ones(1000, np.bool_)).fit()
    assert (fit.doubt > 1e4).all()


def test_a_path_with_an_amplitude_of_0_is_missing_and_comes_last() -> None:
    """In the first pixel, the first path has the amplitude 0. In the other pixels both paths exist and keep their order."""
    amplitude, phase = np.array([[0.0, 0.2, 0.4], [1.0, 0.9, 0.3]]), np.array([[2.0, 2.0, 1.5], [1.0, 3.0, 2.5]])
    found = LikelyPaths(
        Found(amplitude, np.cos(phase), np.sin(phase)), np.full((2, 3), 0.01), np.zeros(3), np.ones(3, np.bool_)
    )
    paths = found.fit().paths
    assert_allclose(paths.amplitude, [[1.0, 0.2, 0.4], [np.nan, 0.9, 0.3]])
    assert_allclose(paths.phase_rad, [[1.0, 2.0, 1.5], [np.nan, 3.0, 2.5]], atol=1e-6)
    assert_allclose(paths.sigma_rad, [[0.01, 0.01, 0.01], [np.nan, 0.01, 0.01]])
