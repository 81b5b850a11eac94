"""Predicted standard deviations of two paths: for a sine those of the closed form, for a triangle the scatter."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Pulse
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.response.table import response_block
from cadtof_cli.resolver.response.uncertainty import response_sigmas
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths
from cadtof_cli.resolver.two_path.uncertainty import two_path_sigmas

T1_NS = 40.0
AMPLITUDE_V = 0.2746
TRIANGLE = Modulation(waveform="triangle")
SINE = (HarmonicResponse(1, ((1, 0.994 + 0j),)), HarmonicResponse(2, ((1, 0.975 + 0j),)))


def triangle(theta: Float) -> Float:
    return np.asarray(2.0 / np.pi * np.arcsin(np.cos(theta)))


def drawn(light: dict[float, float], asr: float, n_av: float, *, size: tuple[int, int], seed: int = 0) -> Float:
    """Return voltages (2, 2, Y, X) of `light`, numbers of photons by delay in ns.

    Mean and covariance of the samples are sums over the times at which photons arrive, not over a Fourier series.
    """
    times = (np.arange(20_000) + 0.5) * T1_NS / 20_000
    chance = np.full(times.size, asr / times.size)
    for delay, photons in light.items():
        away = np.mod(times - delay + 0.5 * T1_NS, T1_NS) - 0.5 * T1_NS
        pulse = np.exp(-0.5 * (away / (1.7 / 2.354820045)) ** 2)
        chance += photons * pulse / pulse.sum()
    chance /= chance.sum()
    rng, rows = np.random.default_rng(seed), []
    for h in (1, 2):
        theta = 2.0 * np.pi * h * times / T1_NS
        samples = np.stack([triangle(theta), triangle(theta - 0.5 * np.pi)])
        mean = samples @ chance
        covariance = ((samples * chance) @ samples.T - np.outer(mean, mean)) / (2.0 * n_av - 1.0)
        rows.append(rng.multivariate_normal(mean, covariance, size=size))
    return AMPLITUDE_V * np.moveaxis(np.array(rows), -1, 1)


@pytest.mark.parametrize(
    ("delays_ns", "ratio", "asr", "n_av"),
    [
        ((8.7, 15.1), 0.24, 0.34, 2.1e5),
        ((10.4, 22.5), 0.76, 0.43, 2e5),
        ((7.5, 18.8), 0.5, 0.83, 1.3e4),
        ((12.9, 26.4), 0.84, 9.85, 6.2e4),
    ],
)
def test_two_paths_of_a_triangle_scatter_as_their_sigmas_predict(
    delays_ns: tuple[float, float], ratio: float, asr: float, n_av: float
) -> None:
    """A share of .683 of the paths lies within one sigma, and .954 within two.

    With the slopes of a sine, .46 to .94 of the direct and .49 to .92 of the second paths would lie within one sigma.
    """
    metadata = CaptureMetadata(modulation=TRIANGLE, pixel=Pixel(integration_length=n_av))
    settings = ResolverSettings(order="2", returns="strongest", mpi_model="discrete")
    frame = drawn(dict(zip(delays_ns, (1.0, ratio), strict=True)), asr, n_av, size=(64, 64))
    maps = resolve_frame(frame, plan=FramePlan(metadata=metadata, settings=MapSettings(resolver=settings))).maps
    for path, delay in zip(("direct", "mpi"), delays_ns, strict=True):
        scatter = (maps.layer(f"{path}.depth") - 0.299792458 * delay / 2.0) / maps.layer(f"{path}.sigma")
        assert np.mean(np.abs(scatter) < 1.0) == pytest.approx(0.683, abs=0.04)
        assert np.mean(np.abs(scatter) < 2.0) == pytest.approx(0.954, abs=0.02)


@pytest.mark.parametrize("delay_ns", [2.5, 9.0, 19.6])
def test_the_length_is_estimated_from_a_triangle_at_one_distance_with_little_ambient_light(delay_ns: float) -> None:
    """Light at a peak of both waves has 1.5 times the mean square of a triangle, light halfway between peaks .75 times."""
    metadata, n_av = CaptureMetadata(modulation=TRIANGLE), 1e5
    settings = ResolverSettings(order="1", mpi_model="discrete")
    frame = drawn({delay_ns: 1.0}, 0.2, n_av, size=(96, 96))
    resolved = resolve_frame(frame, plan=FramePlan(metadata=metadata, settings=MapSettings(resolver=settings)))
    assert resolved.noise.integration_length == pytest.approx(n_av, rel=0.3)


@pytest.mark.parametrize(
    ("fwhm_ns", "separation_ns", "far_off", "beyond_sigma"),
    [
        (1.7, 8.0, 0.0, 0.0),
        (1.7, 6.0, 0.07, 0.003),
        (1.7, 4.0, 0.41, 0.006),
        (0.3, 10.0, 0.0, 0.0),
        (0.3, 8.0, 0.05, 0.003),
        (0.3, 6.0, 0.34, 0.005),
        (0.3, 4.0, 0.66, 0.13),
    ],
)
def test_two_close_paths_of_a_triangle_may_be_resolved_as_another_pair_and_sigma_tells(
    fwhm_ns: float, separation_ns: float, far_off: float, beyond_sigma: float
) -> None:
    """The search is not at fault: the other pair of paths fits equally well (docs/calibration.md).

    A triangle is straight between its peaks: two short pulses on the same straight part change a voltage as one does.
    """
    rng, size, n_av, shares = np.random.default_rng(0), (60, 70), 1e6, np.array([1.0, 0.3]) / 3.3
    delays = rng.uniform(0.0, T1_NS - separation_ns, size)
    pulse = np.linspace(-5.0, 5.0, 201)
    times = np.stack([delays, delays + separation_ns])[..., np.newaxis] + fwhm_ns / 2.354820045 * pulse
    weights = np.exp(-0.5 * pulse**2) / np.exp(-0.5 * pulse**2).sum()
    frame = np.empty((2, 2, *size))
    for row, h in enumerate((1, 2)):
        for channel, turn in enumerate((0.0, 0.5 * np.pi)):
            samples = triangle(2.0 * np.pi * h / T1_NS * times - turn)
            frame[row, channel] = np.tensordot(shares, samples @ weights, axes=1)
    frame = AMPLITUDE_V * (frame + rng.normal(0.0, 0.5 / np.sqrt(n_av), frame.shape))
    metadata = CaptureMetadata(modulation=TRIANGLE, pixel=Pixel(integration_length=n_av), pulse=Pulse(fwhm_ns=fwhm_ns))
    settings = ResolverSettings(order="2", mpi_model="discrete")
    maps = resolve_frame(frame, plan=FramePlan(metadata=metadata, settings=MapSettings(resolver=settings))).maps
    error = np.abs(maps.layer("direct.depth") - 0.299792458 * delays / 2.0)
    assert np.mean(error > 0.1) == pytest.approx(far_off, rel=0.15, abs=0.002)
    beyond = np.mean(error > np.maximum(0.02, 5.0 * maps.layer("direct.sigma")))
    assert beyond == pytest.approx(beyond_sigma, rel=0.5, abs=0.003)


def test_the_order_test_rarely_splits_one_path_of_a_triangle_into_two() -> None:
    """The order test weighs the scatter that a second path adds under a triangle, not under a sine."""
    metadata = CaptureMetadata(modulation=TRIANGLE, pixel=Pixel(integration_length=1e5))
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model="discrete")))
    maps = resolve_frame(drawn({20.0: 1.0}, 2.0, 1e5, size=(128, 128), seed=3), plan=plan).maps
    assert np.mean((maps.status & StatusBit.TWO_PATHS) > 0) < 0.0075


def test_a_clear_second_path_of_a_triangle_is_found_though_it_hardly_moves_the_direct_path() -> None:
    """11.5 ns apart, one path leaves far more than noise, but its phase is nearly that of the direct path."""
    plan = FramePlan(
        metadata=CaptureMetadata(modulation=TRIANGLE, pixel=Pixel(integration_length=1e5)),
        settings=MapSettings(resolver=ResolverSettings(mpi_model="discrete")),
    )
    maps = resolve_frame(drawn({7.0: 1.0, 18.5: 0.1}, 1.0, 1e5, size=(48, 64), seed=4), plan=plan).maps
    error = np.abs(maps.layer("direct.depth") - 0.299792458 * 7.0 / 2.0)
    assert np.mean((maps.status & StatusBit.TWO_PATHS) > 0) > 0.99
    assert 0.65 < np.mean(error < maps.layer("direct.sigma")) < 0.72


@pytest.mark.parametrize("pixel_phases", [None, np.random.default_rng(2).uniform(-3.0, 3.0, (2, 200))])
def test_sigmas_of_a_sine_are_those_of_the_closed_form(pixel_phases: Float | None) -> None:
    """The phases that pixels add change nothing, because the noise is that of the light and not of the waveform."""
    rng = np.random.default_rng(1)
    amplitude = np.stack([rng.uniform(0.3, 0.69, 200), rng.uniform(0.05, 0.3, 200)])
    first = rng.uniform(0.0, 2.0 * np.pi, 200)
    phase = np.stack([first, first + rng.uniform(0.3, 2.0 * np.pi - 0.3, 200)])
    phasors = (amplitude * np.exp(1j * np.array([1, 2])[:, None, None] * phase)).sum(axis=1)
    noise = noise_model(CaptureMetadata(), integration_length=1e5, quantised=False)
    two = two_paths(fundamental_frame(*phasors))
    found = response_sigmas(two.amplitude, two.phases(), response=response_block(SINE, pixel_phases), noise=noise)
    assert_allclose(found, two_path_sigmas(two, noise=noise), rtol=5e-3)


def test_sigmas_are_infinite_without_a_second_path_or_for_two_equal_paths() -> None:
    noise = noise_model(CaptureMetadata(modulation=TRIANGLE), integration_length=1e5, quantised=False)
    with np.errstate(all="ignore"):
        found = response_sigmas(
            np.array([[0.5, 0.5], [0.0, 0.2]]), np.full((2, 2), 1.0), response=response_block(SINE, None), noise=noise
        )
    assert np.isposinf(found).all()


def test_amplitudes_that_exceed_all_light_have_the_noise_of_all_light() -> None:
    """Noise can make the sum of both amplitudes larger than 1. Such amplitudes had a sigma of 0."""
    metadata = CaptureMetadata(modulation=TRIANGLE)
    noise = noise_model(metadata, integration_length=300.0, quantised=False)
    amplitude, phase = np.repeat([[0.96], [0.04]], 50, axis=1), np.stack([np.zeros(50), np.linspace(0.3, np.pi, 50)])
    response = response_block(ideal_response(metadata), None)
    possible, beyond = (
        response_sigmas(factor * amplitude, phase, response=response, noise=noise) for factor in (1.0, 1.2)
    )
    assert (possible > 0.0).all()
    assert_allclose(beyond, possible / 1.2, rtol=1e-3)
