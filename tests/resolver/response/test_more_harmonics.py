"""Triangle waves and other responses with more than two harmonics. The frames are samples of the waveform, not of a series."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.noise import NoiseModel, noise_model
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.pipeline.frame import ResolvedFrame, resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.kernels import available_kernels
from cadtof_cli.resolver.likelihood.mixture import Mixture
from cadtof_cli.resolver.paths import ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.response.more_harmonics import Recorded, found_paths, most_likely
from cadtof_cli.resolver.response.table import ResponseBlock, response_block
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.blocks import blocks_of
from tests.support.campaign import CARD_M, camera, card
from tests.support.defects import Defects
from tests.support.kernels import by_kernel

N_AV = 1e5


def triangle(harmonics: tuple[int, ...], longest_ns: float = 40.0) -> CaptureMetadata:
    periods = tuple(longest_ns / h for h in harmonics)
    return CaptureMetadata(modulation=Modulation(periods_ns=periods, waveform="triangle"))


def noise_of(harmonics: tuple[int, ...], n_av: float = N_AV) -> NoiseModel:
    return noise_model(triangle(harmonics), integration_length=n_av, quantised=False)


def light(
    responses: tuple[HarmonicResponse, ...], amplitude: Float, delay_rad: Float, own_rad: Float | float = 0.0
) -> Complex:
    """Return the phasors (N, n) of paths (K, n), recorded by pixels with phases of their own, (N, n), by the series alone."""
    own = np.broadcast_to(own_rad, (len(responses), delay_rad.shape[1]))
    rows = [
        np.exp(-1j * phase) * (amplitude * one.at(one.harmonic * delay_rad + phase) / one.main).sum(axis=0)
        for one, phase in zip(responses, own, strict=True)
    ]
    return np.array(rows)


def noisy(phasors: Complex, noise: NoiseModel, seed: int) -> Complex:
    """Return phasors with the noise of ambient light."""
    sigma = np.sqrt([[one.dark_variance] for one in noise.each])
    re, im = np.random.default_rng(seed).standard_normal((2, *phasors.shape))
    return np.asarray(phasors + sigma * (re + 1j * im))


def resolved(
    phasors: Complex,
    harmonics: tuple[int, ...],
    block: ResponseBlock | None = None,
    *,
    n_av: float = N_AV,
    **settings: Any,
) -> ResolvedPaths:
    return resolve_paths(
        phasors,
        status=np.zeros(phasors.shape[1], np.uint32),
        settings=ResolverSettings(**settings),
        noise=noise_of(harmonics, n_av),
        response=block or response_block(ideal_response(triangle(harmonics)), None),
    )


@cache
def of_card(harmonics: int, order: str = "auto") -> ResolvedFrame:
    """Return the maps of a card with two paths 4 to 20 ns apart, one of them alone in the first rows."""
    sensor = camera(Defects(), waveform="triangle", harmonics=harmonics)
    settings = MapSettings(resolver=ResolverSettings(mpi_model="discrete", order=order))
    frame = card(sensor, count=1, seed=4, separations_ns=(4.0, 20.0))[0]
    return resolve_frame(frame, plan=FramePlan(metadata=sensor.metadata, settings=settings))


def test_two_paths_have_no_bias_true_sigmas_and_less_error_than_with_two_harmonics() -> None:
    maps = of_card(3).maps
    error = maps.layer(DIRECT_DEPTH) - CARD_M
    sigma, two = maps.layer(DIRECT_SIGMA), (maps.status & StatusBit.TWO_PATHS) > 0
    assert two[10:].mean() > 0.99
    assert (~two)[:10].mean() > 0.98
    assert (maps.status & StatusBit.NOT_CONVERGED == 0).all()
    for columns in (slice(0, 20), slice(20, 50), slice(50, 80)):
        assert abs(np.median(error[:, columns])) < 0.0003
    assert np.mean(np.abs(error) < sigma) == pytest.approx(0.683, abs=0.03)
    assert np.mean(np.abs(error) < 2.0 * sigma) == pytest.approx(0.954, abs=0.015)
    fewer = of_card(2).maps.layer(DIRECT_DEPTH) - CARD_M
    assert np.median(np.abs(error[10:])) < 0.6 * np.median(np.abs(fewer[10:]))


def test_pairs_that_two_harmonics_of_a_triangle_confuse_are_told_apart_by_a_third() -> None:
    """With two harmonics, the wrong pair of close paths is found in one of twenty of these pixels, and is decimetres off."""
    wrong = [np.mean(np.abs(of_card(n, "2").maps.layer(DIRECT_DEPTH) - CARD_M)[10:, :16] > 0.1) for n in (2, 3)]
    assert wrong[0] > 0.03
    assert wrong[1] < 0.01


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 4), (1, 3, 4), (1, 2, 3, 4)])
def test_the_misfit_of_two_paths_is_chi_squared_whichever_harmonics_were_recorded(harmonics: tuple[int, ...]) -> None:
    rng, count = np.random.default_rng(5), 3000
    delay = rng.uniform(0.0, 2.0 * np.pi, count) + np.array([[0.0], [1.1]]) * rng.uniform(1.0, 2.0, count)
    exact = light(ideal_response(triangle(harmonics)), np.array([[0.05], [0.03]]), delay)
    found = resolved(noisy(exact, noise_of(harmonics), 6), harmonics, order="2")
    freedom = 2 * (len(harmonics) - 2)
    # seldom a pair far from the true one fits as well
    assert np.median(found.chi_squared) == pytest.approx({2: 1.386, 4: 3.357}[freedom], rel=0.08)
    assert np.mean(found.chi_squared > {2: 9.21, 4: 13.28}[freedom]) < 0.03


@pytest.mark.parametrize(
    ("harmonics", "n_av", "weaker", "apart_ns", "most"),
    [
        # 2 % if the first start is from phasors with the terms beyond a sine
        ((1, 2, 3), 1e5, 0.3, (3.0, 20.0), 0.006),
        # .4 % without the second start
        ((1, 2, 4), 1e4, 0.3, (3.0, 20.0), 0.001),
        # .7 % without the mirrored pair
        ((1, 2, 3), 1e7, 0.7, (2.0, 8.0), 0.001),
        # .13 % without the best pair of a grid
        ((1, 2, 3), 1e7, 0.3, (3.0, 20.0), 0.0005),
    ],
)
def test_the_search_seldom_ends_in_a_worse_minimum_than_from_the_truth(
    harmonics: tuple[int, ...], n_av: float, weaker: float, apart_ns: tuple[float, float], most: float
) -> None:
    rng, count, noise = np.random.default_rng(5), 6000, noise_of(harmonics, n_av)
    responses = ideal_response(triangle(harmonics))
    first = rng.uniform(0.0, 2.0 * np.pi, count)
    delay = np.stack([first, first + rng.uniform(*apart_ns, count) * 2.0 * np.pi / 40.0])
    amplitude = np.array([[1.0], [weaker]]) / 3.3 * np.ones(count)
    drawn = noisy(light(responses, amplitude, delay), noise, 4)
    recorded = Recorded(drawn, noise, response_block(responses, None))
    best = most_likely(recorded, Mixture(amplitude, np.cos(delay), np.sin(delay)))
    found = most_likely(recorded, found_paths(recorded, 2)[0])
    assert np.mean(found.chi_squared > best.chi_squared + 1.0) < most


@pytest.mark.parametrize(
    ("ratios", "apart_ns", "n_av", "most"),
    [
        # 66 % without the starts from split paths
        ((1.0, 0.6, 0.4), 4.0, 1e6, 0.06),
        ((1.0, 0.3, 0.2), 5.0, 1e7, 0.005),
    ],
)
def test_the_search_for_three_paths_seldom_ends_in_a_worse_minimum(
    ratios: tuple[float, ...], apart_ns: float, n_av: float, most: float
) -> None:
    harmonics, count = (1, 2, 3, 4), 2000
    responses, noise = ideal_response(triangle(harmonics)), noise_of(harmonics, n_av)
    first = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, count)
    delay = first + apart_ns * 2.0 * np.pi / 40.0 * np.arange(3)[:, np.newaxis]
    amplitude = np.array(ratios)[:, np.newaxis] / (sum(ratios) + 5.0) * np.ones(count)
    recorded = Recorded(noisy(light(responses, amplitude, delay), noise, 4), noise, response_block(responses, None))
    _, best = recorded.searched(Mixture(amplitude, np.cos(delay), np.sin(delay)))
    _, misfit = found_paths(recorded, 3)
    assert np.mean(misfit > best + 1.0) < most


@pytest.mark.parametrize(
    ("harmonics", "shares"),
    [
        # 12 %, 5 % and 62 % without the starts from split paths
        ((1, 2, 3), (0.15, 0.045)),
        ((1, 2, 10), (0.15, 0.045)),
        ((1, 2, 3, 4), (0.15, 0.09, 0.06)),
    ],
)
def test_paths_near_each_other_in_long_periods_seldom_end_in_a_worse_minimum(
    harmonics: tuple[int, ...], shares: tuple[float, ...]
) -> None:
    """The paths are 8 ns apart and the longest period is 80 ns: several pairs of such paths give much the same phasors."""
    rng, count, metadata = np.random.default_rng(5), 2000, triangle(harmonics, 80.0)
    responses, noise = ideal_response(metadata), noise_model(metadata, integration_length=1e6, quantised=False)
    delay = rng.uniform(0.0, 2.0 * np.pi, count) + 0.2 * np.pi * np.arange(len(shares))[:, np.newaxis]
    amplitude = np.array(shares)[:, np.newaxis] * np.ones(count)
    recorded = Recorded(noisy(light(responses, amplitude, delay), noise, 4), noise, response_block(responses, None))
    best = most_likely(recorded, Mixture(amplitude, np.cos(delay), np.sin(delay)))
    found = most_likely(recorded, found_paths(recorded, len(shares))[0])
    assert np.mean(found.chi_squared > best.chi_squared + 9.21) < 0.003


def test_the_fall_off_of_one_path_is_the_signed_square_of_a_normal_deviate() -> None:
    """At delay 0, the phasors of a triangle are longer than at most others: the weights must know it."""
    harmonics, count = (1, 2, 3), 6000
    responses, noise = ideal_response(triangle(harmonics)), noise_of(harmonics)
    alone = light(responses, np.array([[0.02]]), np.zeros((1, count)))
    recorded = Recorded(noisy(alone, noise, 17), noise, response_block(responses, None))
    fall_off = most_likely(recorded, found_paths(recorded, 1)[0]).fall_off
    assert fall_off is not None
    assert np.abs(fall_off).mean() == pytest.approx(1.0, abs=0.08)
    assert (fall_off > 0.0).mean() == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 3, 4)])
def test_three_paths_are_found_with_true_sigmas(harmonics: tuple[int, ...]) -> None:
    rng, count = np.random.default_rng(7), 2000
    first = rng.uniform(0.0, 2.0 * np.pi, count)
    exact = light(
        ideal_response(triangle(harmonics)),
        np.array([[0.02], [0.012], [0.01]]),
        first + np.array([[0.0], [1.5], [3.0]]),
    )
    drawn = noisy(exact, noise_of(harmonics, 1e7), 8)
    found = resolved(drawn, harmonics, n_av=1e7, paths=3, returns="strongest")
    three = (found.status & StatusBit.MORE_PATHS) > 0
    assert three.mean() > 0.98
    off = np.angle(np.exp(1j * (found.paths.phase_rad[0] - first)))[three] / found.paths.sigma_rad[0][three]
    assert np.median(np.abs(off)) == pytest.approx(0.6745, rel=0.1)


@pytest.mark.parametrize("harmonics", [(1,), (1, 3), (1, 2, 3)])
def test_one_path_alone_needs_no_second_period(harmonics: tuple[int, ...]) -> None:
    first = np.random.default_rng(9).uniform(0.0, 2.0 * np.pi, (1, 2000))
    exact = light(ideal_response(triangle(harmonics)), np.array([[0.02]]), first)
    found = resolved(noisy(exact, noise_of(harmonics), 10), harmonics, solver="one-path")
    assert (found.status & StatusBit.ONE_PATH > 0).all()
    off = np.angle(np.exp(1j * (found.paths.phase_rad[0] - first[0]))) / found.paths.sigma_rad[0]
    assert np.median(np.abs(off)) == pytest.approx(0.6745, rel=0.1)


def test_phases_of_the_pixels_and_an_imbalance_turn_the_other_terms_too() -> None:
    """The phasors are those that the linear part of the response leaves; the other terms keep the pixels' phases."""
    harmonics, count = (1, 2, 3), 500
    responses = ideal_response(triangle(harmonics))
    rng = np.random.default_rng(11)
    own = rng.uniform(-0.4, 0.4, (3, count))
    delay = rng.uniform(0.0, 2.0 * np.pi, count) + np.array([[0.0], [2.0]])
    exact = light(responses, np.array([[0.2], [0.1]]), delay, own)
    found = resolved(exact, harmonics, response_block(responses, own), order="2", returns="strongest")
    off = np.angle(np.exp(1j * (found.paths.phase_rad - delay)))
    # to a tenth of a standard deviation
    assert np.quantile(np.abs(off) / found.paths.sigma_rad, 0.99) < 0.1
    ignored = resolved(exact, harmonics, order="2", returns="strongest")
    off = np.angle(np.exp(1j * (ignored.paths.phase_rad - delay)))
    assert np.median(np.abs(off) / ignored.paths.sigma_rad) > 1.0


def test_a_mean_is_resolved_as_a_recording_of_all_its_photons() -> None:
    harmonics, count, frames, n_av = (1, 2, 3), 1000, 400.0, 3e3
    as_long = 0.5 * (frames * (2.0 * n_av - 1.0) + 1.0)
    delay = np.random.default_rng(12).uniform(0.0, 2.0 * np.pi, count) + np.array([[0.0], [1.6]])
    exact = light(ideal_response(triangle(harmonics)), np.array([[0.2], [0.1]]), delay)
    drawn = noisy(exact, noise_of(harmonics, as_long), 13)
    of_frames = replace(noise_of(harmonics, n_av), samples=np.full(count, frames))
    one, mean = (
        resolve_paths(
            drawn,
            status=np.zeros(count, np.uint32),
            settings=ResolverSettings(),
            noise=noise,
            response=response_block(ideal_response(triangle(harmonics)), None),
        )
        for noise in (noise_of(harmonics, as_long), of_frames)
    )
    difference = np.abs(mean.paths.phase_rad - one.paths.phase_rad) / one.paths.sigma_rad
    assert np.nanmax(difference) < 1e-6
    np.testing.assert_allclose(mean.paths.sigma_rad, one.paths.sigma_rad, rtol=1e-6)


def test_one_path_is_ill_conditioned_in_a_tenth_of_pixels_and_near_a_second_path() -> None:
    harmonics, count = (1, 2, 3), 4000
    responses, noise = ideal_response(triangle(harmonics)), noise_of(harmonics)
    delay = np.random.default_rng(14).uniform(0.0, 2.0 * np.pi, (1, count))
    alone = resolved(noisy(light(responses, np.array([[0.05]]), delay), noise, 15), harmonics)
    pair = light(responses, np.array([[0.05], [0.02]]), delay + np.array([[0.0], [0.4]]))
    close = resolved(noisy(pair, noise, 16), harmonics)
    doubtful = (alone.status & StatusBit.ILL_CONDITIONED) > 0
    assert doubtful[(alone.status & StatusBit.ONE_PATH) > 0].mean() == pytest.approx(0.1, abs=0.02)
    assert ((close.status & (StatusBit.ILL_CONDITIONED | StatusBit.TWO_PATHS)) > 0).mean() > 0.5


def test_a_pixel_has_the_same_bits_in_blocks_of_any_size_and_by_all_kernels() -> None:
    sensor = camera(Defects(), waveform="triangle", harmonics=3)
    plan = FramePlan(metadata=sensor.metadata)
    frame = card(sensor, count=1, seed=5, separations_ns=(2.0, 20.0))[0]
    whole = resolve_frame(frame, plan=plan).maps
    with blocks_of(97):
        parts = resolve_frame(frame, plan=plan).maps
    others = [by_kernel(kernel, resolve_frame, frame, plan=plan).maps for kernel in available_kernels()]
    for other in (parts, *others):
        np.testing.assert_array_equal(other.values, whole.values)
        np.testing.assert_array_equal(other.status, whole.status)


@pytest.mark.parametrize("order", ["1", "2", "auto"])
@pytest.mark.parametrize("size", [1e-30, 1e-10, 1.0])
def test_status_and_paths_agree_on_the_number_of_paths_however_faint_the_light(size: float, order: str) -> None:
    rng = np.random.default_rng(6)
    amplitude = size * np.stack([np.ones(200), rng.choice([0.0, 0.3], 200)])
    exact = light(ideal_response(triangle((1, 2, 3))), amplitude, rng.uniform(0.0, 2.0 * np.pi, (2, 200)))
    exact[1, :3] = np.nan
    found = resolved(exact, (1, 2, 3), order=order, min_confidence=0.0)
    counts = np.array([(found.status & np.uint32(bit)) != 0 for bit in (StatusBit.ONE_PATH, StatusBit.TWO_PATHS)])
    assert (found.status[:3] == StatusBit.NOT_FINITE).all()
    assert (counts.sum(axis=0)[3:] == 1).all()
    np.testing.assert_array_equal(np.isfinite(found.paths.amplitude)[0, 3:], np.ones(197, np.bool_))
    np.testing.assert_array_equal(np.isfinite(found.paths.amplitude)[1], counts[1])
