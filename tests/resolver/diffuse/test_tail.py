"""The model of a tail: its values, its Jacobian, and data that do not depend on the direct light."""

import numpy as np
import pytest

from cadtof_cli.arrays import Complex
from cadtof_cli.resolver.diffuse.radiosity import Interreflections
from cadtof_cli.resolver.diffuse.tail import (
    ONSET_NS,
    REFERENCE_DECAY_NS,
    TailModel,
    free_of_direct,
    residuals,
    wrapped,
)
from tests.support.diffuse_frames import OMEGA, F, Tail

HARMONICS = (1, 2, 3)


def model(n: int = 40, seed: int = 1, strength: float = 0.3) -> TailModel:
    rng = np.random.default_rng(seed)

    def some() -> Complex:
        size = (len(HARMONICS), n)
        return np.asarray(strength * np.exp(0.5j * np.pi * rng.random(size)) * rng.random(size))

    return TailModel(Interreflections(some(), some(), some(), np.ones(n), np.ones(n)), HARMONICS, OMEGA)


def states(n: int = 40, seed: int = 2) -> F:
    rng = np.random.default_rng(seed)
    return np.stack([rng.normal(m, s, n) for m, s in ((-0.3, 0.3), (0, 0.4), (0, 0.5), (-2.5, 1), (2.3, 0.5), (4, 2))])


def test_the_jacobian_is_that_of_finite_differences() -> None:
    tail, state = model(), states()
    _, jacobian = tail.values(state)
    for component in range(6):
        step = np.zeros_like(state)
        step[component] = 1e-5
        slope = (tail.values(state + step)[0] - tail.values(state - step)[0]) / 2e-5
        np.testing.assert_allclose(jacobian[component], slope, atol=2e-8)


def test_unseen_light_alone_is_an_exponential_with_a_smooth_onset() -> None:
    nothing = np.zeros((3, 1), complex)
    tail = TailModel(Interreflections(nothing, nothing, nothing, np.ones(1), np.ones(1)), HARMONICS, OMEGA)
    state = np.array([[0.0], [0.0], [0.0], [np.log(0.2)], [np.log(9.0)], [4.5]])
    start = Tail(0.2 * 9.0 / REFERENCE_DECAY_NS, 4.5, 9.0)
    light = [1 + start.phasor(h) * np.exp(-0.5 * (h * OMEGA * ONSET_NS) ** 2) for h in HARMONICS]
    expected = [np.log(abs(light[1] / light[0])), np.log(abs(light[2] / light[0]))]
    expected += [np.angle(light[1] / light[0] ** 2), np.angle(light[2] / light[0] ** 3)]
    expected += [np.log(abs(light[0])), np.angle(light[0])]
    np.testing.assert_allclose(tail.values(state)[0][:, 0], expected, rtol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.9])
def test_the_data_do_not_depend_on_the_direct_light(turn: float) -> None:
    rng = np.random.default_rng(5)
    harmonic = np.array([[1.0], [2.0], [3.0]])
    light = rng.normal(size=(3, 9)) * 0.2 + 1 + 0.2j * rng.normal(size=(3, 9))
    seen = np.log(light) + np.log(0.37) + 1j * harmonic * turn
    with_direct, without_direct = (free_of_direct(one.real, one.imag, harmonic) for one in (seen, np.log(light)))
    np.testing.assert_allclose(wrapped(with_direct[:-2] - without_direct[:-2]), 0.0, atol=1e-12)


def test_residuals_of_phases_wrap_and_those_of_moduli_do_not() -> None:
    observed, predicted = np.array([[4.0], [3.1]]), np.array([[-1.0], [-3.1]])
    np.testing.assert_allclose(residuals(observed, predicted), [[5.0], [6.2 - 2.0 * np.pi]])


def test_the_parts_of_the_lag_are_its_derivatives_by_their_strengths() -> None:
    """With H = 1 + seen + beside + later + w, arg H grows by Im(beside/H) per unit of ln b, by Im(later/H) per unit of ln u,
    and by Im(w/H) per unit of ln v. Per unit of ln s it grows by Im((seen + beside + 2·later)/H).
    """
    tail, state = model(), states()
    shown, beside, unseen, guessed = tail.lag_parts(state, 3.0 * tail.light.beyond[0])
    by_s, by_b, by_u, by_v = (tail.values(state)[1][component, -1] for component in range(4))
    assert np.abs(by_u).min() > 1e-4
    np.testing.assert_allclose(shown + beside, by_s - 2.0 * by_u, atol=1e-9)
    np.testing.assert_allclose(beside, by_b, atol=1e-9)
    np.testing.assert_allclose(unseen, by_v, atol=1e-9)
    np.testing.assert_allclose(guessed, 3.0 * beside, rtol=1e-12)


def test_light_in_the_view_beside_it_and_of_later_bounces_is_added() -> None:
    """H = 1 + s·g_h + s·b·b_h + s²·u·m_h, with a negligible amount of unseen light."""
    tail = model(seed=7)
    s, b, u = 0.6, 1.7, 0.8
    state = np.tile(np.array([[np.log(s)], [np.log(b)], [np.log(u)], [-80.0], [2.0], [4.0]]), 40)
    light = 1.0 + s * tail.light.seen + s * b * tail.light.beyond + s * s * u * tail.light.later
    values, _ = tail.values(state)
    np.testing.assert_allclose(values[0], np.log(np.abs(light[1] / light[0])))
    np.testing.assert_allclose(values[1], np.log(np.abs(light[2] / light[0])))
    np.testing.assert_allclose(values[2], np.angle(light[1] / light[0] ** 2))
    np.testing.assert_allclose(values[3], np.angle(light[2] / light[0] ** 3))
    np.testing.assert_allclose(values[4], np.log(np.abs(light[0])))
    np.testing.assert_allclose(values[5], np.angle(light[0]))


def test_phases_are_brought_within_half_a_turn() -> None:
    turned = np.array([-7.0, -3.2, -3.1, 0.0, 3.1, 3.2, 7.0, 13.0])
    np.testing.assert_allclose(wrapped(turned), np.angle(np.exp(1j * turned)), atol=1e-12)
