"""The closed form finds two paths exactly for any pair of phasors, degenerate pairs included."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cadtof_cli.resolver.two_path import closed_form
from cadtof_cli.resolver.two_path.closed_form import TwoPaths, fundamental_frame, is_single, two_paths

C = NDArray[np.complex128]


def solve(p1: C, p2: C) -> TwoPaths:
    with np.errstate(all="ignore"):
        return two_paths(fundamental_frame(p1, p2))


def rotors(paths: TwoPaths) -> tuple[C, C]:
    return paths.cos_x + 1j * paths.sin_x, paths.cos_y + 1j * paths.sin_y


def residual(paths: TwoPaths, p1: C, p2: C) -> NDArray[np.float64]:
    x, y = rotors(paths)
    first = np.abs(paths.a * x + paths.b * y - p1)
    second = np.abs(paths.a * x**2 + paths.b * y**2 - p2)
    return np.asarray(np.maximum(first, second))


def phasors_of(a: object, x: object, b: object, y: object) -> tuple[C, C]:
    a, x, b, y = (np.atleast_1d(np.asarray(v, np.float64)) for v in (a, x, b, y))
    return a * np.exp(1j * x) + b * np.exp(1j * y), a * np.exp(2j * x) + b * np.exp(2j * y)


def stronger_first(paths: TwoPaths) -> tuple[NDArray[np.float64], NDArray[np.float64], C, C]:
    x, y = rotors(paths)
    swap = paths.b > paths.a
    return (
        np.where(swap, paths.b, paths.a),
        np.where(swap, paths.a, paths.b),
        np.where(swap, y, x),
        np.where(swap, x, y),
    )


def test_every_pair_of_phasors_is_decomposed_to_the_last_digits() -> None:
    rng = np.random.default_rng(2015)
    n = 120_000
    possible = phasors_of(rng.random(n), rng.uniform(0, 2 * np.pi, n), rng.random(n), rng.uniform(0, 2 * np.pi, n))
    arbitrary = tuple(rng.normal(size=n) + 1j * rng.normal(size=n) for _ in range(2))
    p1, p2 = (np.concatenate(pair) for pair in zip(possible, arbitrary, strict=True))
    paths = solve(p1, p2)
    assert residual(paths, p1, p2).max() <= 1e-13
    assert paths.a.min() >= 0
    assert paths.b.min() >= 0
    assert max(np.abs(np.abs(r) - 1).max() for r in rotors(paths)) < 1e-14


def test_the_sum_of_amplitudes_is_minus_the_least_eigenvalue_of_the_toeplitz_matrix() -> None:
    rng = np.random.default_rng(0)
    p1, p2 = (rng.normal(size=500) + 1j * rng.normal(size=500) for _ in range(2))
    zero = np.zeros_like(p1)
    rows = [[zero, p1, p2], [p1.conj(), zero, p1], [p2.conj(), p1.conj(), zero]]
    toeplitz: C = np.moveaxis(np.array(rows), 2, 0)
    paths = solve(p1, p2)
    np.testing.assert_allclose(paths.a + paths.b, -np.linalg.eigvalsh(toeplitz)[:, 0], rtol=1e-12)


@pytest.mark.parametrize(("steps", "error"), [(0, 0.0851), (1, 8e-5), (2, 2e-15)])
def test_each_step_for_the_cubic_leaves_the_documented_error(
    steps: int, error: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """H is the root of H³ + 3uH² + (2u·Re d − |d|²)·H − u|d|². Bisection finds it for every u and Re d, with |d| = 1."""
    cosines = np.linspace(-1.0, 1.0, 101)[:, np.newaxis].repeat(201, axis=1).ravel()
    u = np.tile(np.geomspace(1e-6, 1e6, 201), 101)
    monkeypatch.setattr(closed_form, "EXCESS_STEPS", steps)
    p2 = u - cosines + 1j * np.sqrt(1.0 - cosines * cosines)
    with np.errstate(all="ignore"):
        paths = two_paths(fundamental_frame(u.astype(np.complex128), p2))
    low, high = np.zeros(u.size), np.ones(u.size)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = ((middle + 3 * u) * middle + 2 * u * cosines - 1) * middle < u
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    sum_of_amplitudes = paths.a + paths.b
    assert (np.abs(sum_of_amplitudes - (u + low)) <= error * low + 1e-15 * u).all()
    if steps < 2:
        assert (np.abs(sum_of_amplitudes - (u + low)) > 0.8 * error * low).any()


@settings(max_examples=300)
@given(
    st.floats(0.01, 1.0),
    st.floats(0.0, 2 * np.pi, exclude_max=True),
    st.floats(0.01, 1.0),
    st.floats(0.05, 2 * np.pi - 0.05),
)
def test_two_separate_paths_are_found_exactly(a: float, x: float, b: float, gap: float) -> None:
    paths = solve(*phasors_of(a, x, b, x + gap))
    pairs = [(paths.a[0], rotors(paths)[0][0]), (paths.b[0], rotors(paths)[1][0])]
    expected = [(a, np.exp(1j * x)), (b, np.exp(1j * (x + gap)))]
    if abs(pairs[0][1] - expected[0][1]) > abs(pairs[1][1] - expected[0][1]):
        pairs.reverse()
    tolerance = 1e-13 / (min(a, b) * (1 - np.cos(gap)) ** 2)
    for (amplitude, rotor), (amplitude0, rotor0) in zip(pairs, expected, strict=True):
        assert abs(rotor - rotor0) < tolerance
        assert abs(amplitude - amplitude0) < tolerance


def test_turning_the_phasors_turns_the_paths_and_scaling_scales_them() -> None:
    rng = np.random.default_rng(3)
    p1, p2 = (rng.normal(size=2000) + 1j * rng.normal(size=2000) for _ in range(2))
    a, b, x, y = stronger_first(solve(p1, p2))
    turn = np.exp(0.7j)
    a2, b2, x2, y2 = stronger_first(solve(1e-6 * p1 * turn, 1e-6 * p2 * turn**2))
    np.testing.assert_allclose(a2, 1e-6 * a, rtol=1e-11)
    np.testing.assert_allclose(b2, 1e-6 * b, rtol=1e-9)
    np.testing.assert_allclose(x2, x * turn, atol=1e-11)
    np.testing.assert_allclose(y2, y * turn, atol=1e-9)


def test_a_fading_second_path_leaves_the_first_exact() -> None:
    b = 10.0 ** -np.arange(2.0, 17.0)
    paths = solve(*phasors_of(np.ones(15), np.full(15, 0.8), b, np.full(15, 2.5)))
    strong, weak, x, _ = stronger_first(paths)
    np.testing.assert_allclose(strong, 1.0, atol=1e-14)
    np.testing.assert_allclose(np.angle(x), 0.8, atol=1e-14)
    np.testing.assert_allclose(weak, b, atol=1e-15)


def test_phases_are_those_of_the_rotors_between_0_and_a_full_turn() -> None:
    rng = np.random.default_rng(6)
    n = 20_000
    paths = solve(*phasors_of(rng.random(n), rng.uniform(0, 2 * np.pi, n), rng.random(n), rng.uniform(0, 2 * np.pi, n)))
    for phase, rotor in zip(paths.phases(), rotors(paths), strict=True):
        assert phase.min() >= 0.0
        assert phase.max() < 2 * np.pi
        np.testing.assert_allclose(np.exp(1j * phase), rotor, atol=1e-14)


@pytest.mark.parametrize("gap", [1e-1, 1e-2, 1e-3, 1e-5, 1e-8, 1e-12])
def test_approaching_paths_keep_residual_amplitude_and_mean(gap: float) -> None:
    p1, p2 = phasors_of(0.7, 1.0, 0.3, 1.0 + gap)
    paths = solve(p1, p2)
    x, y = rotors(paths)
    assert residual(paths, p1, p2)[0] < 1e-14
    assert paths.a[0] + paths.b[0] == pytest.approx(1.0, abs=1e-14)
    assert np.angle((paths.a * x + paths.b * y)[0]) == pytest.approx(1.0 + 0.3 * gap, abs=gap**2 + 1e-14)


@pytest.mark.parametrize("modulus", [1e-1, 1e-4, 1e-8, 1e-16, 1e-100, 0.0])
def test_a_vanishing_first_phasor_is_two_opposite_paths(modulus: float) -> None:
    p1, p2 = np.array([modulus * np.exp(0.4j)]), np.array([0.5 * np.exp(1.2j)])
    paths = solve(p1, p2)
    x, y = rotors(paths)
    assert residual(paths, p1, p2)[0] < 1e-15
    if modulus < 1e-8:
        np.testing.assert_allclose([paths.a[0], paths.b[0]], 0.25, atol=1e-8)
        assert abs(x[0] + y[0]) < 1e-7


def test_antipodal_paths_of_any_ratio_are_exact() -> None:
    b = np.linspace(0.01, 1.0, 50)
    p1, p2 = phasors_of(np.ones(50), np.full(50, 2.0), b, np.full(50, 2.0 + np.pi))
    strong, weak, x, y = stronger_first(solve(p1, p2))
    np.testing.assert_allclose(strong, 1.0, atol=2e-15)
    np.testing.assert_allclose(weak, b, atol=2e-15)
    np.testing.assert_allclose(x[:-1], np.exp(2.0j), atol=1e-13)
    np.testing.assert_allclose(y[:-1], -np.exp(2.0j), atol=1e-13)


def test_light_of_one_path_gives_one_path_and_no_second() -> None:
    phase = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    p1, p2 = phasors_of(np.full(64, 0.6), phase, np.zeros(64), phase)
    paths = solve(p1, p2)
    strong, weak, x, _ = stronger_first(paths)
    np.testing.assert_allclose(strong, 0.6, atol=1e-15)
    np.testing.assert_allclose(weak, 0.0, atol=1e-15)
    np.testing.assert_allclose(x, np.exp(1j * phase), atol=1e-14)
    exact = solve(np.array([1.0 + 0j]), np.array([1.0 + 0j]))
    assert exact.single[0]
    assert (exact.a[0], exact.b[0]) == (1.0, 0.0)


def test_phasors_of_0_have_amplitudes_of_0_and_nan_stays_nan() -> None:
    no_signal = solve(np.zeros(1, complex), np.zeros(1, complex))
    assert (no_signal.a[0], no_signal.b[0]) == (0.0, 0.0)
    for bad in ([np.nan, 0.5], [0.5, np.nan]):
        paths = solve(np.array(bad[:1], complex), np.array(bad[1:], complex))
        assert np.isnan(paths.a[0])
        assert np.isnan(paths.b[0])


def test_inputs_are_not_changed() -> None:
    rng = np.random.default_rng(4)
    p1, p2 = (rng.normal(size=10) + 1j * rng.normal(size=10) for _ in range(2))
    before = p1.copy(), p2.copy()
    solve(p1, p2)
    np.testing.assert_array_equal(p1, before[0])
    np.testing.assert_array_equal(p2, before[1])


def test_phasors_that_differ_from_one_path_only_by_rounding_are_single() -> None:
    """The limit is 2⁻⁵⁰ of the first phasor, 4 units in its last place."""
    p1 = np.full(6, 0.3 * np.exp(0.7j))
    p2 = 0.3 * np.exp(1.4j) * (1.0 + np.array([0.0, 2.0**-52, -(2.0**-51), 2.0**-48, 0.1, -2.0]))
    frame = fundamental_frame(p1, p2)
    assert is_single(frame).tolist() == [True, True, True, False, False, False]
    assert solve(p1, p2).single.tolist() == is_single(frame).tolist()
