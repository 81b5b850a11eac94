"""Standard deviations of two paths that other pairs of paths explain nearly as well: they hold the distance to these."""

from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Pulse
from cadtof_cli.phasors.noise import NoiseModel, noise_model
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.paths import Fit, Paths, ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.response.other_pairs import MOVE, MOVES, Rule, widen
from cadtof_cli.resolver.response.table import ResponseBlock, response_block
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit

COUNT = 3000
TURN = 2.0 * np.pi


def response_of(late_rad: float = 0.0, *, fwhm_ns: float = 1.7, count: int = COUNT) -> ResponseBlock:
    """Return the response of a triangle whose harmonic 2 is late."""
    own = None if late_rad == 0.0 else np.stack([np.zeros(count), np.full(count, late_rad)])
    metadata = CaptureMetadata(modulation=Modulation(waveform="triangle"), pulse=Pulse(fwhm_ns=fwhm_ns))
    return response_block(ideal_response(metadata), own)


def noise_of(length: float) -> NoiseModel:
    metadata = CaptureMetadata(modulation=Modulation(waveform="triangle"), pixel=Pixel(integration_length=length))
    return noise_model(metadata, integration_length=length, quantised=False)


def recorded(
    response: ResponseBlock,
    noise: NoiseModel,
    *,
    apart_ns: float,
    ratio: float,
    asr: float,
    seed: int,
    count: int = COUNT,
) -> tuple[Complex, Float]:
    """Return noisy phasors of two paths, (2, n), and the phase of the first, (n,)."""
    rng = np.random.default_rng(seed)
    # the second path stays within the range: beyond it, it would be taken for the first
    x = rng.uniform(0.0, TURN * (1.0 - apart_ns / 40.0), count)
    amplitudes = np.array([1.0, ratio]) / (1.0 + ratio + asr)
    rows = []
    for row, one in enumerate(noise.each):
        light = np.sqrt(one.dark_variance) * (rng.normal(size=count) + 1j * rng.normal(size=count))
        for amplitude, phase in zip(amplitudes, (x, x + apart_ns / 40.0 * TURN), strict=True):
            re, im = response.added_by(row, phase.astype(np.float32))
            light = light + amplitude * (re + 1j * im)
        rows.append(light)
    return np.array(rows), x


def resolved(phasors: Complex, response: ResponseBlock, noise: NoiseModel) -> ResolvedPaths:
    settings = ResolverSettings(mpi_model="discrete", order="2")
    status = np.zeros(phasors.shape[1], np.uint32)
    return resolve_paths(phasors, status=status, settings=settings, noise=noise, response=response)


def errors(found: ResolvedPaths, x: Float) -> Float:
    """Return the errors of the direct phase, in units of its standard deviation."""
    off: Float = np.abs((found.paths.phase_rad[0] - x + np.pi) % TURN - np.pi)
    away: Float = off / found.paths.sigma_rad[0]
    return away


def is_doubtful(found: ResolvedPaths) -> Bool:
    return np.asarray((found.status & StatusBit.ILL_CONDITIONED) != 0)


@pytest.mark.parametrize(
    ("apart_ns", "ratio", "asr", "length", "late_rad", "least", "without"),
    [
        (4.0, 0.3, 5.0, 1e5, 0.0, 0.94, 0.45),
        (5.0, 0.15, 1.0, 2e4, 0.0, 0.94, 0.65),
        (6.0, 0.3, 5.0, 1e5, 0.3, 0.94, 0.65),
        (6.0, 0.3, 0.0, 1e6, 1.0, 0.77, 0.4),
        (6.0, 0.8, 2.0, 1e5, 0.0, 0.94, 0.85),
    ],
)
def test_close_paths_of_a_triangle_lie_within_their_sigma(
    apart_ns: float,
    ratio: float,
    asr: float,
    length: float,
    late_rad: float,
    least: float,
    without: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`without` is more than the share within two sigma if sigma is that of the pair found, as it was before."""
    response, noise = response_of(late_rad), noise_of(length)
    phasors, x = recorded(response, noise, apart_ns=apart_ns, ratio=ratio, asr=asr, seed=31)
    found = resolved(phasors, response, noise)
    away = errors(found, x)
    assert np.mean(away < 2.0) > least
    # sigma is no larger than it has to be
    assert np.mean(away < 1.0) < 0.82
    assert np.mean((away > 5.0) & ~is_doubtful(found)) < 0.5 * (1.0 - least)
    monkeypatch.setattr("cadtof_cli.resolver.response.other_pairs.widen", lambda *_given, **_options: None)
    before = resolved(phasors, response, noise)
    np.testing.assert_array_equal(before.paths.phase_rad, found.paths.phase_rad)
    assert np.mean(errors(before, x) < 2.0) < without


@pytest.mark.parametrize(
    ("late_rad", "fwhm_ns", "far_off", "beyond"),
    [(0.3, 1.7, 0.21, 0.007), (1.0, 1.7, 0.35, 0.014), (0.3, 0.3, 0.52, 0.13), (1.0, 0.3, 0.47, 0.17)],
)
def test_a_late_harmonic_makes_more_pairs_alike(late_rad: float, fwhm_ns: float, far_off: float, beyond: float) -> None:
    """The shares that docs/calibration.md names: off by 10 cm; by 5 sigma and 2 cm, of which sigma does not tell."""
    response, noise = response_of(late_rad, fwhm_ns=fwhm_ns), noise_of(1e6)
    phasors, x = recorded(response, noise, apart_ns=6.0, ratio=0.3, asr=2.0, seed=34)
    found = resolved(phasors, response, noise)
    away = errors(found, x)
    off_m = away * found.paths.sigma_rad[0] / TURN * 6.0
    assert np.mean(off_m > 0.1) == pytest.approx(far_off, rel=0.1)
    assert np.mean((away > 5.0) & (off_m > 0.02)) == pytest.approx(beyond, rel=0.2, abs=0.005)


def test_paths_that_are_far_apart_keep_their_sigma(monkeypatch: pytest.MonkeyPatch) -> None:
    response, noise = response_of(), noise_of(1e5)
    phasors, x = recorded(response, noise, apart_ns=13.0, ratio=0.3, asr=5.0, seed=32)
    found = resolved(phasors, response, noise)
    assert 0.66 < np.mean(errors(found, x) < 1.0) < 0.72
    monkeypatch.setattr("cadtof_cli.resolver.response.other_pairs.widen", lambda *_given, **_options: None)
    before = resolved(phasors, response, noise)
    assert np.mean(found.paths.sigma_rad[0] > 1.02 * before.paths.sigma_rad[0]) < 0.03


def test_sigma_reaches_along_a_line_of_pairs_that_explain_the_same_phasors() -> None:
    """With short pulses, 2 and 8 ns are on neighbouring pieces of harmonic 2: paths may be at 0 and 5 or at 2.7 and 10 ns."""
    response, noise = response_of(fwhm_ns=0.02, count=1), noise_of(1e7)
    (at,), (later,) = np.array([2.0]) / 40.0 * TURN, np.array([8.0]) / 40.0 * TURN
    rows = []
    for row in range(2):
        parts = [response.added_by(row, np.array([phase], np.float32)) for phase in (at, later)]
        rows.append(sum(share * (re + 1j * im) for share, (re, im) in zip((0.6, 0.3), parts, strict=True)))
    fit = two_paths_at([at, later])
    widen(fit, np.array(rows), noise=noise, response=response, settings=ResolverSettings())
    assert 0.3 < fit.paths.sigma_rad[0, 0] / TURN * 40.0 < 2.5
    assert 0.4 < fit.paths.sigma_rad[1, 0] / TURN * 40.0 < MOVES * MOVE / TURN * 40.0 + 0.01
    assert fit.doubt[0] > 0.5


def two_paths_at(phases: list[float]) -> Fit:
    """Return a fit of one pixel, two paths of tiny sigma."""
    paths = Paths(np.array([[0.6], [0.3]]), np.array(phases)[:, np.newaxis], np.full((2, 1), 1e-4))
    return Fit(paths, np.zeros(1), np.ones(1, np.bool_), np.zeros(1))


def test_one_path_and_three_paths_stay_as_they_are() -> None:
    response, noise = response_of(count=1), noise_of(1e5)
    one = two_paths_at([0.3, 1.2])
    one.paths[1] = Paths.none((1,))
    widen(one, np.full((2, 1), 0.2 + 0.1j), noise=noise, response=response, settings=ResolverSettings())
    assert (one.paths.sigma_rad[0, 0], one.doubt[0]) == (1e-4, 0.0)
    two = two_paths_at([0.3, 1.2])
    three = replace(two, paths=Paths(*(np.concatenate([part, part[:1]]) for part in vars(two.paths).values())))
    widen(three, np.full((3, 1), 0.2 + 0.1j), noise=noise, response=response, settings=ResolverSettings())
    assert (three.paths.sigma_rad == 1e-4).all()


@pytest.mark.parametrize(("longest_ns", "apart_ns", "without"), [(40.0, 3.0, 0.83), (80.0, 8.0, 0.84)])
def test_three_periods_leave_other_pairs_too_if_paths_are_closer(
    longest_ns: float, apart_ns: float, without: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    periods = (longest_ns, longest_ns / 2.0, longest_ns / 3.0)
    metadata = CaptureMetadata(
        modulation=Modulation(waveform="triangle", periods_ns=periods), pixel=Pixel(integration_length=7e4)
    )
    response = response_block(ideal_response(metadata), None)
    noise = noise_model(metadata, integration_length=7e4, quantised=False)
    apart = 40.0 * apart_ns / longest_ns
    phasors, x = recorded(response, noise, apart_ns=apart, ratio=0.3, asr=5.0, seed=35)
    found = resolved(phasors, response, noise)
    two = np.isfinite(found.paths.amplitude[1])
    assert np.mean(errors(found, x)[two] < 2.0) > 0.965
    monkeypatch.setattr("cadtof_cli.resolver.response.other_pairs.widen", lambda *_given, **_options: None)
    assert np.mean(errors(resolved(phasors, response, noise), x)[two] < 2.0) < without


@pytest.mark.parametrize(
    ("rule", "amplitude", "expected"),
    [
        # the first of two paths, of which each has a tenth of the other
        (Rule(np.float32(0.1), np.float32(1.0)), (0.6, 0.3), (0.2, 0.1)),
        # the path found first is too weak now, so that the other one is the direct path
        (Rule(np.float32(0.1), np.float32(1.0)), (0.02, 0.6), (0.4, 0.7)),
        # the strongest
        (Rule(np.float32(1.0), np.float32(1.0)), (0.3, 0.6), (0.4, 0.7)),
        # the last: the path found as direct one is behind no more
        (Rule(np.float32(0.1), np.float32(-1.0)), (0.6, 0.3), (0.4, 0.7)),
    ],
)
def test_a_pair_counts_by_its_own_direct_path(
    rule: Rule, amplitude: tuple[float, float], expected: tuple[float, float]
) -> None:
    """The direct path has moved by .2 rad to earlier phases, the MPI path, .5 rad behind it, by .1 rad."""
    direct, mpi, gap = (np.array([value], np.float32) for value in (-0.2, -0.1, 0.5))
    of_pair = np.array([amplitude[0]], np.float32), np.array([amplitude[1]], np.float32)
    found = rule.errors(of_pair, (direct, mpi), gap)
    np.testing.assert_allclose(np.concatenate(found), expected, rtol=1e-5)


def test_means_of_many_samples_reach_less_far() -> None:
    """With 100 times the samples, noise makes pairs look alike only a tenth as far away, unless they are alike."""
    response, noise = response_of(), noise_of(1e3)
    phasors, x = recorded(response, noise_of(1e5), apart_ns=7.0, ratio=0.3, asr=2.0, seed=33)
    pooled = replace(noise, samples=np.full(COUNT, 100.0))
    within = np.mean(errors(resolved(phasors, response, pooled), x) < 2.0)
    assert within > 0.94
    single = resolved(phasors, response, noise).paths.sigma_rad[0]
    assert np.median(single / resolved(phasors, response, pooled).paths.sigma_rad[0]) > 4.0
