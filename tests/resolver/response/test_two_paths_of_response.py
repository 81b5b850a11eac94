"""Two known paths under a triangle's response are found again from the phasors of the exact series."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.response.newton import Equations, SearchState, search
from cadtof_cli.resolver.response.one_path import one_path_of_response
from cadtof_cli.resolver.response.solver import FullResponse
from cadtof_cli.resolver.response.table import ResponseBlock, response_block
from cadtof_cli.resolver.response.two_paths import two_paths_of_response
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.closed_form import TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.two_path.one_path import one_path

METADATA = CaptureMetadata(modulation=Modulation(waveform="triangle"))

RESPONSES = tuple(ideal_response(METADATA))

NOISE = noise_model(METADATA, integration_length=1e6, quantised=False)

PIXELS = 300

PIXEL_PHASES = np.random.default_rng(5).normal(0.0, 0.2, (2, PIXELS))


def light(seed: int = 1) -> tuple[Float, Float]:
    """Return amplitudes and phases of two paths, (2, n), the stronger first; their phases differ by 1 rad or more."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(0.2, 0.4, PIXELS)
    amplitude = np.stack([first, first * rng.uniform(0.2, 0.7, PIXELS)])
    begin, apart = rng.uniform(0.0, 2.0 * np.pi, PIXELS), rng.uniform(1.0, 2.0 * np.pi - 1.0, PIXELS)
    return amplitude, np.mod(np.stack([begin, begin + apart]), 2.0 * np.pi)


def phasors_of(amplitude: Float, phase: Float, pixel_phases: Float | None = None) -> Complex:
    """Return the phasors of the exact series for these paths, (2, n)."""
    rows = []
    for row, response in enumerate(RESPONSES):
        turn = np.zeros(phase.shape[1]) if pixel_phases is None else pixel_phases[row]
        theta = response.harmonic * phase + turn
        rows.append((amplitude * response.without_mirror(response.at(theta))).sum(axis=0) * np.exp(-1j * turn))
    return np.stack(rows)


def block(pixel_phases: Float | None = None) -> ResponseBlock:
    model = response_block(RESPONSES, pixel_phases)
    return model.block(slice(0, PIXELS))


def resolved(p: Complex, response: ResponseBlock, chosen: Bool | None = None) -> tuple[TwoPaths, Bool]:
    start = one_path(fundamental_frame(*p), noise=NOISE, steps=2)
    alone = one_path_of_response(start, p, response=response, noise=NOISE, steps=2)
    every = np.ones(PIXELS, np.bool_) if chosen is None else chosen
    return two_paths_of_response(alone, p, every, response=response, noise=NOISE)


def errors(found: TwoPaths, amplitude: Float, phase: Float) -> tuple[Float, Float]:
    """Return the largest error of the two phases and of the two amplitudes per pixel, with the stronger path first."""
    x, y = found.phases()
    swapped = found.a < found.b
    phases = np.where(swapped, [y, x], [x, y])
    amplitudes = np.where(swapped, [found.b, found.a], [found.a, found.b])
    phase_error = np.abs(np.angle(np.exp(1j * (phases - phase)))).max(axis=0)
    return np.asarray(phase_error), np.abs(amplitudes - amplitude).max(axis=0)


@pytest.mark.parametrize("pixel_phases", [None, PIXEL_PHASES])
def test_two_paths_are_found_where_the_search_converges(pixel_phases: Float | None) -> None:
    """The residual of a pixel that has converged is at most .3 times the noise, and mostly much smaller."""
    amplitude, phase = light()
    p = phasors_of(amplitude, phase, pixel_phases)
    found, converged = resolved(p, block(pixel_phases))
    assert converged.mean() > 0.97
    phase_error, amplitude_error = errors(found, amplitude, phase)
    same = converged & (phase_error < 0.05)
    assert same.mean() > 0.85
    assert np.median(phase_error[same]) < 2e-4
    assert np.median(amplitude_error[same]) < 1e-4
    x, y = found.phases()
    again = phasors_of(np.stack([found.a, found.b]), np.stack([x, y]), pixel_phases)
    assert (np.abs(again - p)[:, converged] < 0.3 * np.sqrt(NOISE.each[0].dark_variance)).all()


def test_pixels_that_are_not_chosen_keep_the_paths_of_a_sine() -> None:
    """Their phasors have lost the higher terms of the best single path, and these pixels count as converged."""
    amplitude, phase = light(2)
    p, chosen = phasors_of(amplitude, phase), np.arange(PIXELS) % 3 == 0
    found, converged = resolved(p, block(), chosen)
    none, _ = resolved(p, block(), np.zeros(PIXELS, np.bool_))
    every, done = resolved(p, block())
    assert converged[~chosen].all()
    for name in ("a", "b", "cos_mean", "sin_mean", "cos_half", "sin_half"):
        values = getattr(found, name)
        np.testing.assert_array_equal(values[~chosen], getattr(none, name)[~chosen])
        np.testing.assert_allclose(values[chosen & done], getattr(every, name)[chosen & done], atol=1e-4)
    bare = two_paths(fundamental_frame(*p))
    phase_errors = [np.median(errors(one, amplitude, phase)[0][~found.single]) for one in (every, none, bare)]
    assert phase_errors[0] < 0.01 * phase_errors[1]
    assert phase_errors[1] < 0.9 * phase_errors[2]


def test_rotors_are_those_of_mean_and_half_of_the_phases() -> None:
    amplitude, phase = light(3)
    found, _ = resolved(phasors_of(amplitude, phase), block())
    x, y = found.phases()
    mean, half = found.cos_mean + 1j * found.sin_mean, found.cos_half + 1j * found.sin_half
    assert_allclose(np.abs(np.angle(mean * half * np.exp(-1j * x))), 0.0, atol=1e-5)
    assert_allclose(np.abs(np.angle(mean * np.conj(half) * np.exp(-1j * y))), 0.0, atol=1e-5)
    assert (found.sin_half >= 0.0).all()


def equations(p: Complex) -> Equations:
    return Equations.of(block(), p, NOISE)


def test_the_residual_of_the_equations_is_what_the_paths_do_not_explain() -> None:
    amplitude, phase = light(4)
    p = phasors_of(amplitude, phase)
    values = np.stack([amplitude[0] + 0.01, phase[0] - 0.02, amplitude[1], phase[1] + 0.03]).astype(np.float32)
    predicted = phasors_of(np.stack([values[0], values[2]]), np.stack([values[1], values[3]]))
    for row in range(2):
        fields = equations(p).fields(values, row, -1)
        residual = p[row] - predicted[row]
        assert_allclose(fields.left_re + 1j * fields.left_im, residual, atol=2e-6)
        assert_allclose(fields.left2, np.abs(residual) ** 2, atol=1e-6)
        for answer, x in ((fields.x, values[1]), (fields.y, values[3])):
            expected = phasors_of(np.ones((1, PIXELS)), x[np.newaxis].astype(np.float64))[row]
            assert_allclose(answer.re + 1j * answer.im, expected, atol=1e-5)


def test_a_search_of_no_steps_returns_its_start() -> None:
    amplitude, phase = light(6)
    p = phasors_of(amplitude, phase)
    exact = np.stack([amplitude[0], phase[0], amplitude[1], phase[1]]).astype(np.float32)
    at_truth = search(equations(p), exact, steps=0)
    assert at_truth.done.all()
    assert_allclose(at_truth.values, exact, atol=1e-4)
    start = exact + np.float32(0.05)
    at_start = search(equations(p), start, steps=0)
    assert not at_start.done.any()
    np.testing.assert_array_equal(at_start.values, start)
    weight = 1.0 / NOISE.each[0].dark_variance, 1.0 / NOISE.each[1].dark_variance
    misfit = sum(w * equations(p).fields(start, row, -1).left2 for row, w in enumerate(weight))
    assert_allclose(at_start.misfit, misfit, rtol=1e-4)
    one, more = (search(equations(p), start, steps=steps) for steps in (1, 6))
    assert (one.misfit <= at_start.misfit).all()
    assert np.median(one.misfit) < 0.1 * np.median(at_start.misfit)
    assert more.done.mean() > 0.95


def test_pixels_searched_apart_end_at_the_same_bits() -> None:
    amplitude, phase = light(7)
    p = phasors_of(amplitude, phase)
    start = np.stack([amplitude[0], phase[0], amplitude[1], phase[1]]).astype(np.float32)
    start += np.random.default_rng(1).uniform(-0.3, 0.3, start.shape).astype(np.float32) * np.float32(0.5)
    start[::2] = np.maximum(start[::2], np.float32(0.02))
    whole = search(equations(p), start, steps=5)
    some = np.arange(0, PIXELS, 7)
    alone = search(equations(p)[some], start[:, some], steps=5)
    np.testing.assert_array_equal(whole.values[:, some], alone.values)
    np.testing.assert_array_equal(whole.done[some], alone.done)
    state = SearchState(start.copy(), np.full(PIXELS, np.inf, np.float32), np.zeros(PIXELS, np.bool_))
    state.put(some, alone)
    np.testing.assert_array_equal(state.values[:, some], alone.values)
    assert (state.values[:, 1] == start[:, 1]).all()


def test_one_path_gets_six_steps_alone_and_two_before_a_second_path() -> None:
    amplitude, phase = light(8)
    p = phasors_of(amplitude[:1], phase[:1])
    start = one_path(fundamental_frame(*p), noise=NOISE, steps=1)
    for order, steps in (("1", 6), ("auto", 2), ("2", 2)):
        settings = ResolverSettings(order=order)
        pixels, fit = FullResponse(p, noise=NOISE, response=block(), settings=settings).fit(
            1, np.ones(PIXELS, np.bool_), limit=None
        )
        expected = one_path_of_response(start, p, response=block(), noise=NOISE, steps=steps)
        np.testing.assert_array_equal(fit.paths.amplitude[0], expected.amplitude)
        assert np.asarray(pixels).tolist() == list(range(PIXELS))
