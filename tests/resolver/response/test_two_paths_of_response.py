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

OWN = np.random.default_rng(5).normal(0.0, 0.2, (2, PIXELS))


def light(seed: int = 1) -> tuple[Float, Float]:
    """Return amplitudes and phases of two paths, (2, n), the stronger first; their phases differ by 1 rad or more."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(0.2, 0.4, PIXELS)
    amplitude = np.stack([first, first * rng.uniform(0.2, 0.7, PIXELS)])
    begin, apart = rng.uniform(0.0, 2.0 * np.pi, PIXELS), rng.uniform(1.0, 2.0 * np.pi - 1.0, PIXELS)
    return amplitude, np.mod(np.stack([begin, begin + apart]), 2.0 * np.pi)


def seen(amplitude: Float, phase: Float, own: Float | None = None) -> Complex:
    """Return the phasors of the exact series for these paths, (2, n)."""
    rows = []
    for row, response in enumerate(RESPONSES):
        turned = np.zeros(phase.shape[1]) if own is None else own[row]
        theta = response.harmonic * phase + turned
        rows.append((amplitude * response.without_mirror(response.at(theta))).sum(axis=0) * np.exp(-1j * turned))
    return np.stack(rows)


def block(own: Float | None = None) -> ResponseBlock:
    model = response_block(RESPONSES, own)
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
    phases, sizes = np.where(swapped, [y, x], [x, y]), np.where(swapped, [found.b, found.a], [found.a, found.b])
    turned = np.abs(np.angle(np.exp(1j * (phases - phase)))).max(axis=0)
    return np.asarray(turned), np.abs(sizes - amplitude).max(axis=0)


@pytest.mark.parametrize("own", [None, OWN])
def test_two_paths_come_back_where_the_search_ends(own: Float | None) -> None:
    """The residual of a pixel that has converged is at most .3 times the noise, and mostly much smaller."""
    amplitude, phase = light()
    p = seen(amplitude, phase, own)
    found, converged = resolved(p, block(own))
    assert converged.mean() > 0.97
    turned, sizes = errors(found, amplitude, phase)
    same = converged & (turned < 0.05)
    assert same.mean() > 0.85
    assert np.median(turned[same]) < 2e-4
    assert np.median(sizes[same]) < 1e-4
    x, y = found.phases()
    again = seen(np.stack([found.a, found.b]), np.stack([x, y]), own)
    assert (np.abs(again - p)[:, converged] < 0.3 * np.sqrt(NOISE.each[0].dark_variance)).all()


def test_of_pixels_that_are_not_chosen_the_sine_s_paths_stay() -> None:
    """Their phasors have lost the higher terms of the best single path, and these pixels count as converged."""
    amplitude, phase = light(2)
    p, chosen = seen(amplitude, phase), np.arange(PIXELS) % 3 == 0
    found, converged = resolved(p, block(), chosen)
    none, _ = resolved(p, block(), np.zeros(PIXELS, np.bool_))
    every, done = resolved(p, block())
    assert converged[~chosen].all()
    for name in ("a", "b", "cos_mean", "sin_mean", "cos_half", "sin_half"):
        ours = getattr(found, name)
        np.testing.assert_array_equal(ours[~chosen], getattr(none, name)[~chosen])
        np.testing.assert_allclose(ours[chosen & done], getattr(every, name)[chosen & done], atol=1e-4)
    bare = two_paths(fundamental_frame(*p))
    truly = [np.median(errors(one, amplitude, phase)[0][~found.single]) for one in (every, none, bare)]
    assert truly[0] < 0.01 * truly[1]
    assert truly[1] < 0.9 * truly[2]


def test_rotors_are_those_of_mean_and_half_of_the_phases() -> None:
    amplitude, phase = light(3)
    found, _ = resolved(seen(amplitude, phase), block())
    x, y = found.phases()
    mean, half = found.cos_mean + 1j * found.sin_mean, found.cos_half + 1j * found.sin_half
    assert_allclose(np.abs(np.angle(mean * half * np.exp(-1j * x))), 0.0, atol=1e-5)
    assert_allclose(np.abs(np.angle(mean * np.conj(half) * np.exp(-1j * y))), 0.0, atol=1e-5)
    assert (found.sin_half >= 0.0).all()


def equations(p: Complex, pixels: int = PIXELS) -> Equations:
    return Equations.of(block(), p, np.arange(pixels), NOISE)


def test_what_is_left_of_the_equations_is_what_the_paths_miss() -> None:
    amplitude, phase = light(4)
    p = seen(amplitude, phase)
    off = np.stack([amplitude[0] + 0.01, phase[0] - 0.02, amplitude[1], phase[1] + 0.03]).astype(np.float32)
    there = seen(np.stack([off[0], off[2]]), np.stack([off[1], off[3]]))
    for row in range(2):
        fields = equations(p).fields(off, row, -1)
        missed = p[row] - there[row]
        assert_allclose(fields.left_re + 1j * fields.left_im, missed, atol=2e-6)
        assert_allclose(fields.left2, np.abs(missed) ** 2, atol=1e-6)
        single = seen(np.ones((1, PIXELS)), off[1][np.newaxis].astype(np.float64))[row]
        assert_allclose(fields.x.re + 1j * fields.x.im, single, atol=1e-5)
        other = seen(np.ones((1, PIXELS)), off[3][np.newaxis].astype(np.float64))[row]
        assert_allclose(fields.y.re + 1j * fields.y.im, other, atol=1e-5)


def test_a_search_ends_at_once_where_it_starts_and_keeps_its_best_where_it_has_no_steps() -> None:
    amplitude, phase = light(6)
    p = seen(amplitude, phase)
    exact = np.stack([amplitude[0], phase[0], amplitude[1], phase[1]]).astype(np.float32)
    there = search(equations(p), exact, steps=0)
    assert there.done.all()
    assert_allclose(there.values, exact, atol=1e-4)
    off = exact + np.float32(0.05)
    begun = search(equations(p), off, steps=0)
    assert not begun.done.any()
    np.testing.assert_array_equal(begun.values, off)
    weight = 1.0 / NOISE.each[0].dark_variance, 1.0 / NOISE.each[1].dark_variance
    missed = sum(w * equations(p).fields(off, row, -1).left2 for row, w in enumerate(weight))
    assert_allclose(begun.misfit, missed, rtol=1e-4)
    one, more = (search(equations(p), off, steps=steps) for steps in (1, 6))
    assert (one.misfit <= begun.misfit).all()
    assert np.median(one.misfit) < 0.1 * np.median(begun.misfit)
    assert more.done.mean() > 0.95


def test_a_search_of_some_pixels_is_that_of_each_alone() -> None:
    amplitude, phase = light(7)
    p = seen(amplitude, phase)
    off = np.stack([amplitude[0], phase[0], amplitude[1], phase[1]]).astype(np.float32)
    off += np.random.default_rng(1).uniform(-0.3, 0.3, off.shape).astype(np.float32) * np.float32(0.5)
    off[::2] = np.maximum(off[::2], np.float32(0.02))
    whole = search(equations(p), off, steps=5)
    some = np.arange(0, PIXELS, 7)
    alone = search(equations(p)[some], off[:, some], steps=5)
    np.testing.assert_array_equal(whole.values[:, some], alone.values)
    np.testing.assert_array_equal(whole.done[some], alone.done)
    state = SearchState.of(off)
    assert not state.done.any()
    assert np.isinf(state.misfit).all()
    state.put(some, alone)
    np.testing.assert_array_equal(state.values[:, some], alone.values)
    assert (state.values[:, 1] == off[:, 1]).all()


def test_one_path_alone_gets_six_steps_and_two_where_others_follow() -> None:
    amplitude, phase = light(8)
    p = seen(amplitude[:1], phase[:1])
    start = one_path(fundamental_frame(*p), noise=NOISE, steps=1)
    for order, steps in (("1", 6), ("auto", 2), ("2", 2)):
        settings = ResolverSettings(order=order)
        pixels, fit = FullResponse(p, NOISE, block(), settings).fit(1, np.ones(PIXELS, np.bool_), limit=None)
        expected = one_path_of_response(start, p, response=block(), noise=NOISE, steps=steps)
        np.testing.assert_array_equal(fit.paths.amplitude[0], expected.amplitude)
        assert np.asarray(pixels).tolist() == list(range(PIXELS))
