"""The driver: phasors of known light → paths, their order, which path is direct, and the status of every pixel."""

from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.resolver.paths import ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.forward import Light, ns_from_rad, phasors_of

C = NDArray[np.complex128]
NOISE = noise_model(CaptureMetadata(), integration_length=1e5, quantised=False)


def resolve(phasors: C, *, saturated: Any = False, **options: Any) -> ResolvedPaths:
    bits = np.uint32(StatusBit.SATURATED) * np.asarray(saturated, np.bool_)
    status = np.broadcast_to(bits, phasors.shape[1:])
    return resolve_paths(phasors, status=status, settings=ResolverSettings(**options), noise=NOISE)


def mixed(*paths: tuple[float, float]) -> C:
    """Noiseless phasors of one pixel from (amplitude, delay in ns) pairs."""
    rotors = [(a, np.exp(2j * np.pi * t / 40.0)) for a, t in paths]
    return np.array([[sum(a * z**h for a, z in rotors)] for h in (1, 2)])


def delay_ns(path: Any) -> float:
    return float(ns_from_rad(path.phase_rad)[0])


def test_two_paths_are_found_and_the_first_return_is_direct() -> None:
    found = resolve(mixed((0.1, 5.0), (0.3, 12.0)))
    assert (delay_ns(found.paths[0]), delay_ns(found.paths[1])) == pytest.approx((5.0, 12.0))
    assert (found.paths[0].amplitude[0], found.paths[1].amplitude[0]) == pytest.approx((0.1, 0.3))
    assert found.status[0] == StatusBit.TWO_PATHS
    assert found.confidence[0] == pytest.approx(abs(mixed((0.1, 5.0), (0.3, 12.0))[0, 0]))


@pytest.mark.parametrize(("returns", "expected"), [("first", 5.0), ("strongest", 12.0), ("last", 12.0)])
def test_which_return_is_direct_can_be_chosen(returns: str, expected: float) -> None:
    found = resolve(mixed((0.1, 5.0), (0.3, 12.0)), returns=returns)
    assert delay_ns(found.paths[0]) == pytest.approx(expected)
    assert delay_ns(found.paths[1]) == pytest.approx(17.0 - expected)


@pytest.mark.parametrize(("ratio", "expected"), [(0.3, 5.0), (0.4, 12.0)])
def test_a_return_that_is_too_weak_is_not_direct(ratio: float, expected: float) -> None:
    assert delay_ns(resolve(mixed((0.1, 5.0), (0.3, 12.0)), min_return_ratio=ratio).paths[0]) == pytest.approx(expected)
    late = resolve(mixed((0.3, 5.0), (0.1, 12.0)), min_return_ratio=ratio, returns="last").paths[0]
    assert delay_ns(late) == pytest.approx(17.0 - expected)


@pytest.mark.parametrize(("direct_ns", "second_ns"), [(5.0, 25.0), (5.0, 39.0), (1.0, 30.0)])
def test_a_weaker_second_path_of_any_delay_within_the_range_is_not_direct(direct_ns: float, second_ns: float) -> None:
    found = resolve(mixed((0.3, direct_ns), (0.1, second_ns)))
    assert (delay_ns(found.paths[0]), delay_ns(found.paths[1])) == pytest.approx((direct_ns, second_ns))


def test_a_weak_echo_that_wraps_round_the_range_is_not_taken_for_a_first_return() -> None:
    found = resolve(mixed((0.3, 34.0), (0.05, 43.0)))
    assert (delay_ns(found.paths[0]), delay_ns(found.paths[1])) == pytest.approx((34.0, 43.0))
    near = resolve(mixed((0.05, 24.0), (0.3, 34.0)))
    assert (delay_ns(near.paths[0]), delay_ns(near.paths[1])) == pytest.approx((24.0, 34.0))


@pytest.mark.parametrize(
    ("ratio", "later_ns", "is_echo"),
    [(0.45, 12.0, True), (0.55, 12.0, False), (0.1, 19.5, True), (0.1, 20.5, False), (0.49, 19.9, True)],
)
def test_a_path_counts_as_a_wrapped_echo_below_half_the_amplitude_and_over_half_a_turn_ahead(
    ratio: float, later_ns: float, is_echo: bool
) -> None:
    """The second path arrives at 34 + `later_ns`. Delays wrap at 40 ns, so that it appears at 34 + `later_ns` − 40 ns."""
    found = resolve(mixed((0.3, 34.0), (0.3 * ratio, 34.0 + later_ns)))
    wrapped_ns = 34.0 + later_ns - 40.0
    expected = (34.0, 34.0 + later_ns) if is_echo else (wrapped_ns, 34.0)
    assert (delay_ns(found.paths[0]), delay_ns(found.paths[1])) == pytest.approx(expected, abs=1e-4)


def test_order_1_gives_the_most_likely_path_even_if_the_light_has_two() -> None:
    """The path has the phase x that maximises w1·Re(p1·exp(−ix)) + w2·Re(p2·exp(−2ix)), even if one path fits badly.

    w_h is one over the variance of the noise of harmonic h. Steps of 10⁻⁴ rad around the answer find nothing better.
    """
    lights = [(0.3, 5.0, 0.25, second) for second in np.linspace(7.0, 18.0, 12)]
    p = np.concatenate([mixed((a, x), (b, y)) for a, x, b, y in lights], axis=1)
    phase = resolve(p, order="1").paths[0].phase_rad
    weights = [1.0 / harmonic.dark_variance for harmonic in NOISE.each]
    fine = phase + np.linspace(-0.3, 0.3, 6001)[:, np.newaxis]
    gain = sum(w * (p[row] * np.exp(-1j * (row + 1) * fine)).real for row, w in enumerate(weights))
    best = fine[gain.argmax(axis=0), np.arange(12)]
    np.testing.assert_allclose(phase, best, atol=1.01e-4)


@pytest.mark.parametrize("order", ["auto", "2", "1"])
@pytest.mark.parametrize("returns", ["first", "strongest", "last"])
@pytest.mark.parametrize("ratio", [0.0, 0.1])
def test_light_of_one_path_without_noise_gives_one_path_with_any_settings(
    order: str, returns: str, ratio: float
) -> None:
    found = resolve(mixed((0.2, 30.0)), order=order, returns=returns, min_return_ratio=ratio)
    assert delay_ns(found.paths[0]) == pytest.approx(30.0)
    assert found.paths[0].amplitude[0] == pytest.approx(0.2)
    assert np.isfinite(found.paths[0].sigma_rad[0])
    assert found.status[0] == StatusBit.ONE_PATH
    assert np.isnan([found.paths[1].amplitude[0], found.paths[1].phase_rad[0], found.paths[1].sigma_rad[0]]).all()


def test_order_1_and_the_one_path_solver_are_the_same_and_never_find_two() -> None:
    p = phasors_of(Light(2.0, 0.4).voltages(np.random.default_rng(0), 1e5, 200))
    one, solver = resolve(p, order="1"), resolve(p, solver="one-path")
    np.testing.assert_array_equal(one.paths[0].phase_rad, solver.paths[0].phase_rad)
    assert (one.status == StatusBit.ONE_PATH | StatusBit.ILL_CONDITIONED).all()
    assert np.isnan(one.paths[1].phase_rad).all()


@pytest.mark.parametrize(("false_alarm", "size"), [(0.1, 40_000), (0.01, 100_000), (0.001, 300_000)])
@pytest.mark.parametrize("direct_ns", [5.0, 0.0])
def test_light_of_one_path_is_taken_for_two_in_a_third_of_the_false_alarm_rate(
    false_alarm: float, size: int, direct_ns: float
) -> None:
    """The misfit exceeds its threshold in the whole share of pixels that was asked for.

    In about a third of these pixels (.3 to .6) the second path moves the direct path enough to be kept.
    """
    p = phasors_of(Light(2.0, direct_ns=direct_ns).voltages(np.random.default_rng(3), 1e5, size))
    share = np.mean(resolve(p, false_alarm=false_alarm).status & StatusBit.TWO_PATHS != 0)
    assert 0.27 * false_alarm < share < 0.48 * false_alarm


@pytest.mark.parametrize("asr", [1.0, 5.0])
def test_without_mpi_the_direct_path_is_as_good_as_the_one_path_fit(asr: float) -> None:
    p = phasors_of(Light(asr, direct_ns=9.0).voltages(np.random.default_rng(4), 1e5, 50_000))
    errors = {o: ns_from_rad(resolve(p, order=o).paths[0].phase_rad) - 9.0 for o in ("auto", "1", "2")}
    rmse = {order: np.sqrt(np.mean(error**2)) for order, error in errors.items()}
    assert rmse["auto"] < 1.02 * rmse["1"]
    assert rmse["auto"] < 0.3 * rmse["2"]
    assert np.median(np.abs(errors["auto"])) < 1.02 * np.median(np.abs(errors["1"]))


@pytest.mark.parametrize("second_ns", [8.0, 11.0, 20.0])
@pytest.mark.parametrize("mpi", [0.01, 0.03, 0.1, 0.3])
def test_the_order_test_is_never_much_worse_than_the_better_of_one_and_two_paths(mpi: float, second_ns: float) -> None:
    p = phasors_of(Light(2.0, mpi, 5.0, second_ns).voltages(np.random.default_rng(5), 1e5, 10_000))
    errors = [ns_from_rad(resolve(p, order=order).paths[0].phase_rad) - 5.0 for order in ("auto", "1", "2")]
    auto, one, two = (float(np.sqrt(np.mean(error**2))) for error in errors)
    assert auto < 1.6 * min(one, two)


def test_bad_pixels_are_nan_with_their_reason_and_leave_the_others_alone() -> None:
    good = mixed((0.3, 5.0), (0.1, 12.0))
    p = np.repeat(good, 6, axis=1)
    p[0, 1], p[1, 2], p[1, 3], p[:, 4] = np.nan, np.inf, complex(0, np.nan), 1e-5
    found = resolve(p, saturated=[False, False, False, False, False, True])
    expected = [StatusBit.TWO_PATHS, *[StatusBit.NOT_FINITE] * 3, StatusBit.LOW_CONFIDENCE, StatusBit.SATURATED]
    assert found.status.tolist() == [int(bit) for bit in expected]
    for path in (found.paths[0], found.paths[1]):
        for values in (path.amplitude, path.phase_rad, path.sigma_rad):
            assert np.isfinite(values).tolist() == [True] + [False] * 5
            assert np.isnan(values[1:]).all()
    assert np.isfinite(found.confidence).tolist() == [True, False, False, False, True, False]
    alone = resolve(good)
    assert found.paths[0].phase_rad[0] == alone.paths[0].phase_rad[0]


def test_noise_alone_passes_for_a_signal_in_the_false_alarm_rate_and_zero_never_does() -> None:
    rng = np.random.default_rng(6)
    dark = Light(1e9).voltages(rng, 1e5, 50_000)
    passed = np.mean(resolve(phasors_of(dark)).status & StatusBit.LOW_CONFIDENCE == 0)
    assert passed == pytest.approx(0.01, abs=0.002)
    for min_confidence in (None, 0.0):
        assert resolve(np.zeros((2, 1), complex), min_confidence=min_confidence).status[0] == StatusBit.LOW_CONFIDENCE


def test_two_paths_whose_first_phasors_cancel_are_resolved() -> None:
    found = resolve(mixed((0.2, 5.0), (0.2, 25.0)))
    assert found.status[0] == StatusBit.TWO_PATHS
    assert {round(delay_ns(found.paths[0]), 6), round(delay_ns(found.paths[1]), 6)} == {5.0, 25.0}


def test_min_confidence_is_a_threshold_on_the_magnitude_of_the_first_phasor() -> None:
    p = mixed((0.2, 5.0))
    assert resolve(p, min_confidence=0.19).status[0] == StatusBit.ONE_PATH
    assert resolve(p, min_confidence=0.21).status[0] == StatusBit.LOW_CONFIDENCE


def test_status_bits_known_before_are_kept_and_new_ones_are_added() -> None:
    p = np.repeat(mixed((0.3, 5.0)), 4, axis=1)
    p[1, 2:] = np.nan
    hot, both = StatusBit.HOT_PIXEL, StatusBit.HOT_PIXEL | StatusBit.SATURATED
    given = np.array([hot, both, hot, 0], np.uint32)
    before = given.copy()
    found = resolve_paths(p, status=given, settings=ResolverSettings(), noise=NOISE)
    np.testing.assert_array_equal(given, before)
    assert found.status.tolist() == [hot, both, hot | StatusBit.NOT_FINITE, StatusBit.NOT_FINITE]
    assert np.isnan([*found.paths.phase_rad, found.confidence]).all()


def test_paths_closer_than_their_uncertainty_are_called_ill_conditioned() -> None:
    close = resolve(mixed((0.1, 5.0), (0.1, 6.0)), order="2")
    assert close.status[0] == StatusBit.TWO_PATHS | StatusBit.ILL_CONDITIONED
    assert resolve(mixed((0.1, 5.0), (0.1, 15.0)), order="2").status[0] == StatusBit.TWO_PATHS


@pytest.mark.parametrize("options", [{}, {"order": "2"}, {"order": "1"}, {"returns": "last"}])
def test_every_pixel_has_the_same_bits_wherever_its_block_begins(options: dict[str, Any]) -> None:
    rng = np.random.default_rng(7)
    lights = [Light(2.0), Light(2.0, 0.3), Light(50.0, 0.1), Light(1e9), Light(0.1, 0.02)]
    p = np.concatenate([phasors_of(light.voltages(rng, 1e5, 61)) for light in lights], axis=1)
    p = np.ascontiguousarray(p[:, rng.permutation(p.shape[1])])
    p[0, 17] = np.nan
    whole = resolve(p, **options)
    for size in (1, 7, 64, 200):
        parts = [resolve(p[:, i : i + size], **options) for i in range(0, p.shape[1], size)]
        for name in ("paths.amplitude", "paths.phase_rad", "paths.sigma_rad", "confidence", "status", "chi_squared"):
            get = attrgetter(name)
            np.testing.assert_array_equal(np.concatenate([get(part) for part in parts], axis=-1), get(whole))


def test_inputs_are_not_changed() -> None:
    p = mixed((0.3, 5.0), (0.1, 12.0))
    p = np.repeat(p, 3, axis=1)
    p[0, 1] = np.nan
    before = p.copy()
    resolve(p, saturated=[False, False, True])
    np.testing.assert_array_equal(p, before)
