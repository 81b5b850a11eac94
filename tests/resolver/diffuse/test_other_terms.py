"""The other terms of a response, for direct light and its tail, compared with sums over the terms from the physics."""

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.resolver.diffuse.other_terms import freed_of_other_terms, harmonics_seen
from cadtof_cli.resolver.diffuse.records import PixelTails
from cadtof_cli.resolver.response.as_sine import first_phase
from cadtof_cli.resolver.response.table import ResponseBlock, response_block
from tests.support.diffuse_frames import F, Tail, Z

TRIANGLE = ideal_response(CaptureMetadata(modulation=Modulation(waveform="triangle")))

CALIBRATED = (
    HarmonicResponse(1, ((1, 0.97 + 0.05j), (-1, 0.03j), (2, 0.05 - 0.03j), (-3, 0.06 + 0j))),
    HarmonicResponse(2, ((1, 0.9 + 0j), (2, 0.04j), (3, 0.05 + 0j))),
)

RESPONSES = pytest.mark.parametrize("responses", [TRIANGLE, CALIBRATED], ids=["triangle", "calibrated"])

PIXELS = 400

Responses = tuple[HarmonicResponse, ...]


def light() -> tuple[F, F]:
    """Return amplitudes and phases of direct light, (n,) each."""
    return np.linspace(0.05, 0.3, PIXELS), np.linspace(0, 4 * np.pi, PIXELS)


def random_phases() -> F:
    return np.random.default_rng(3).normal(0, 0.1, (2, PIXELS))


def recorded(responses: Responses, pixel_phases: F, tail: Tail) -> tuple[Z, Z]:
    """Return the phasors that the responses record of direct light and its tail, and those that sines would record."""
    amplitude, phase = light()
    seen, of_sine = np.zeros((2, PIXELS), complex), np.zeros((2, PIXELS), complex)
    for row, response in enumerate(responses):
        h = response.harmonic
        volts = np.zeros(PIXELS, complex)
        for k, share in response.terms:
            m = abs(k) * h
            path_factor = 1 + (tail.phasor(m) if k > 0 else np.conj(tail.phasor(m)))
            volts += share * amplitude * path_factor * np.exp(1j * k * (h * phase + pixel_phases[row]))
        seen[row] = response.without_mirror(volts) * np.exp(-1j * pixel_phases[row])
        of_sine[row] = amplitude * (1 + tail.phasor(h)) * np.exp(1j * h * phase)
    return seen, of_sine


def predicted(block: ResponseBlock, tail: Tail) -> PixelTails:
    """Return the prediction of the same tail for every pixel."""

    def everywhere(x: float) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
        return np.full(PIXELS, x, np.float32)

    first = 1 + tail.phasor(1)
    further = {m: 1 + tail.phasor(m) for m, _ in harmonics_seen(block)}
    parts = {m: (everywhere(z.real), everywhere(z.imag)) for m, z in further.items()}
    return PixelTails(everywhere(np.log(abs(first))), everywhere(np.angle(first)), parts)


def freed_of(seen: Z, tails: PixelTails, block: ResponseBlock) -> tuple[Z, F]:
    """Return the phasors that a sine would have recorded, and the factor by which the variance of the phase grows."""
    sine, variance_factor = freed_of_other_terms(
        seen, tails, response=block, alone_rad=first_phase(seen[0], response=block)
    )
    return sine, variance_factor.astype(np.float64)


@RESPONSES
@pytest.mark.parametrize("tail", [Tail(), Tail(strength=0.6, start_ns=1.0, decay_ns=4.0), Tail(strength=0.0)])
def test_direct_light_and_a_known_tail_become_those_of_a_sine(responses: Responses, tail: Tail) -> None:
    pixel_phases = random_phases()
    seen, of_sine = recorded(responses, pixel_phases, tail)
    block = response_block(responses, pixel_phases)
    found, _ = freed_of(seen, predicted(block, tail), block)
    relative = np.abs(found - of_sine) / np.abs(of_sine)
    assert np.abs(seen - of_sine).max() > 0.02
    # for weak and high terms, the tail is neglected
    assert relative.max() < (1e-5 if tail.strength == 0.0 else 0.03)
    phase = np.angle(found[0] / of_sine[0])
    assert np.abs(phase).max() < 0.01


@RESPONSES
def test_the_noise_of_the_phase_is_as_predicted(responses: Responses) -> None:
    pixel_phases, tail = random_phases(), Tail()
    seen, _ = recorded(responses, pixel_phases, tail)
    block = response_block(responses, pixel_phases)
    tails = predicted(block, tail)
    noiseless, variance_factor = freed_of(seen, tails, block)
    rng, sigma = np.random.default_rng(1), 1e-4
    trials = []
    for _ in range(300):
        noise = sigma * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
        found, _ = freed_of(seen + noise, tails, block)
        trials.append(np.angle(found[0] / noiseless[0]))
    predicted_variance = variance_factor * sigma**2 / np.abs(noiseless[0]) ** 2
    ratio = np.var(trials, axis=0) / predicted_variance
    assert 0.9 < ratio.mean() < 1.1
    assert ratio.max() < 1.5
    assert variance_factor.max() / variance_factor.min() > 1.5


@RESPONSES
def test_the_noise_of_each_phase_follows_from_finite_differences(responses: Responses) -> None:
    pixel_phases, tail, turn = random_phases(), Tail(), 0.005
    seen, _ = recorded(responses, pixel_phases, tail)
    block = response_block(responses, pixel_phases)
    tails = predicted(block, tail)
    noiseless, variance_factor = freed_of(seen, tails, block)
    more, less = (freed_of(seen * np.exp(1j * angle), tails, block)[0] for angle in (turn, -turn))
    moved = np.angle(more[0] / less[0]) / (2.0 * turn)
    np.testing.assert_allclose(np.abs(noiseless[0] / seen[0] * moved) ** 2, variance_factor, rtol=0.03)


@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_pixel_of_nan_stays_nan_and_does_not_change_the_others() -> None:
    pixel_phases, tail = random_phases(), Tail()
    seen, _ = recorded(TRIANGLE, pixel_phases, tail)
    block = response_block(TRIANGLE, pixel_phases)
    whole, _ = freed_of(seen, predicted(block, tail), block)
    with_nan = seen.copy()
    with_nan[0, 5] = np.nan
    found, variance_factor = freed_of(with_nan, predicted(block, tail), block)
    assert np.isnan(found[:, 5]).all()
    assert np.isnan(variance_factor[5])
    np.testing.assert_array_equal(np.delete(found, 5, axis=1), np.delete(whole, 5, axis=1))


def test_terms_see_the_tail_at_multiples_of_their_harmonic() -> None:
    seen = dict(harmonics_seen(response_block(TRIANGLE, None)))
    assert list(seen) == [3, 5, 6]
    assert seen[3] == pytest.approx(1 / 9, rel=0.1)
    assert seen[5] == pytest.approx(1 / 25, rel=0.2)
