"""A contract for every resolver on every reference problem, which knows the truth."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.resolver.paths import ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import CLOSED_FORM, SOLVERS, ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.forward import ns_from_rad
from tests.support.mixtures import C, F, Mixture, noise_of

B = NDArray[np.bool_]

N_AV = 1e10
"""Integration length so long that noise decides nothing here; other tests measure the effect of noise."""


@dataclass(frozen=True)
class Resolver:
    """Settings of a resolver, and the harmonics that it gets."""

    name: str
    settings: ResolverSettings
    harmonics: tuple[int, ...]

    def __call__(
        self,
        phasors: C,
        *,
        n_av: float = N_AV,
        samples: F | None = None,
        saturated: B | None = None,
        hot: B | None = None,
        first: int = 0,
    ) -> ResolvedPaths:
        """Resolve phasors with status bits for `saturated` and `hot` pixels; `first` is the index of the first pixel."""
        status = np.zeros(phasors.shape[1], np.uint32)
        for pixels, bit in ((saturated, StatusBit.SATURATED), (hot, StatusBit.HOT_PIXEL)):
            if pixels is not None:
                status[pixels] |= np.uint32(bit)
        return resolve_paths(
            phasors,
            status=status,
            settings=self.settings,
            noise=replace(noise_of(self.harmonics, n_av=n_av), samples=samples),
            first=first,
        )


RESOLVERS = [
    Resolver("closed form", ResolverSettings(), (1, 2)),
    Resolver("closed form, always two", ResolverSettings(order="2"), (1, 2)),
    Resolver("likelihood", ResolverSettings(), (1, 2, 3)),
    Resolver("likelihood with a gap", ResolverSettings(), (1, 2, 4)),
    Resolver("likelihood without the second harmonic", ResolverSettings(), (1, 3, 4)),
    Resolver("likelihood of four", ResolverSettings(), (1, 2, 3, 4)),
    Resolver("likelihood, always two", ResolverSettings(order="2"), (1, 2, 3)),
    Resolver("up to three paths", ResolverSettings(paths=3), (1, 2, 3)),
    Resolver("up to three paths from five", ResolverSettings(paths=3), (1, 2, 3, 4, 5)),
    Resolver("up to four paths", ResolverSettings(paths=4), (1, 2, 3, 4)),
    Resolver("the paper's", ResolverSettings(solver="lm"), (1, 2)),
    Resolver("the paper's, always two", ResolverSettings(solver="lm", order="2"), (1, 2)),
    Resolver("the paper's on three", ResolverSettings(solver="lm"), (1, 2, 3)),
    Resolver("the paper's with a gap", ResolverSettings(solver="lm"), (1, 2, 4)),
]

ONE_PATH = [
    Resolver("one path", ResolverSettings(solver="one-path"), harmonics)
    for harmonics in ((1,), (1, 2), (1, 3), (1, 2, 3))
]

TWO_PATHS = {
    "Table 1, 5 and 16 ns": Mixture((1.0, 0.3), (5.0, 16.0)),
    "Table 1, 5 and 25 ns": Mixture((1.0, 0.3), (5.0, 25.0)),
    "Table 1, 5 and 11 ns": Mixture((1.0, 0.3), (5.0, 11.0)),
    "close": Mixture((1.0, 0.5), (8.0, 10.0)),
    "antipodal": Mixture((1.0, 0.3), (7.0, 27.0)),
    "equal amplitudes": Mixture((1.0, 1.0), (5.0, 16.0)),
    "weak MPI": Mixture((1.0, 0.11), (5.0, 16.0)),
    "weak first return": Mixture((0.4, 1.0), (5.0, 16.0)),
    "no ambient light": Mixture((1.0, 0.3), (5.0, 16.0), asr=0.0),
    "around the end of the range": Mixture((1.0, 0.3), (38.0, 44.0)),
}

NO_FUNDAMENTAL = Mixture((1.0, 1.0), (3.0, 23.0))
"""Two equal paths half a turn apart, which cancel in the fundamental and in every odd harmonic."""

every_resolver = pytest.mark.parametrize("resolver", RESOLVERS, ids=lambda resolver: resolver.name)


def delays(resolved: ResolvedPaths) -> list[float]:
    return [float(ns_from_rad(path.phase_rad)[0]) for path in resolved.paths]


def test_every_solver_keeps_the_contract() -> None:
    lost = set(SOLVERS) - {resolver.settings.solver for resolver in (*RESOLVERS, *ONE_PATH)}
    assert not lost, f"RESOLVERS, above, needs settings with solver={', '.join(lost)}: the tests below run with them"


@every_resolver
@pytest.mark.parametrize("problem", TWO_PATHS.values(), ids=TWO_PATHS)
def test_two_paths_are_found(resolver: Resolver, problem: Mixture) -> None:
    resolved = resolver(problem.exact(resolver.harmonics))
    np.testing.assert_allclose(delays(resolved)[:2], problem.delays_ns, atol=2e-4)
    found = [path.amplitude[0] for path in resolved.paths[:2]]
    np.testing.assert_allclose(found, problem.shares, rtol=1e-4)
    assert resolved.status[0] == StatusBit.TWO_PATHS
    assert all(np.isnan(path.phase_rad[0]) for path in resolved.paths[2:])
    bound = problem.bound_ns(resolver.harmonics, N_AV)
    sigma = [ns_from_rad(path.sigma_rad)[0] for path in resolved.paths[:2]]
    np.testing.assert_allclose(sigma, bound, rtol=0.05 if problem.asr else 0.5)


@every_resolver
def test_paths_that_cancel_in_the_fundamental_are_found_with_the_second_harmonic(
    resolver: Resolver,
) -> None:
    exact = NO_FUNDAMENTAL.exact(resolver.harmonics)
    exact[np.array(resolver.harmonics) % 2 == 1] = 0.0  # without rounding
    resolved = resolver(exact)
    if resolver.settings.solver == "lm":  # Eq. (9) divides by the first phasor
        assert resolved.status[0] == StatusBit.NOT_CONVERGED
        assert np.isnan(delays(resolved)).all()
    elif 2 in resolver.harmonics:
        np.testing.assert_allclose(sorted(delays(resolved)[:2]), NO_FUNDAMENTAL.delays_ns, atol=2e-4)
        assert resolved.status[0] == StatusBit.TWO_PATHS
    else:  # only harmonic 4 is left, which cannot distinguish delays a quarter turn apart
        quarter = np.mod(delays(resolved)[:2], 10.0)
        np.testing.assert_allclose(quarter, 3.0, atol=2e-4)


@pytest.mark.parametrize(
    "resolver", [*RESOLVERS, *ONE_PATH], ids=lambda resolver: f"{resolver.name} {resolver.harmonics}"
)
@pytest.mark.parametrize("delay", [0.0, 5.0, 19.9, 39.0])
def test_one_path_is_found(resolver: Resolver, delay: float) -> None:
    problem = Mixture((1.0,), (delay,))
    resolved = resolver(problem.exact(resolver.harmonics))
    error_rad = np.angle(np.exp(1j * (resolved.paths[0].phase_rad - problem.phases)))
    if resolver.settings.order == "2":  # two paths are forced, so they may share the light of one
        strong = resolved.paths[0].amplitude > 0.5 * problem.shares
        assert not strong.any() or np.abs(error_rad[strong]).max() < 0.01
        return
    assert np.abs(error_rad).max() < 1e-6
    np.testing.assert_allclose(resolved.paths[0].amplitude, problem.shares, rtol=1e-5)
    assert np.isnan(resolved.paths[1].phase_rad[0])
    assert resolved.status[0] == StatusBit.ONE_PATH


@every_resolver
def test_phasors_of_0_nan_and_infinity_give_no_answer(resolver: Resolver) -> None:
    phasors = np.zeros((len(resolver.harmonics), 4), np.complex128)
    phasors[0, 1], phasors[-1, 2], phasors[:, 3] = np.nan, 1j * np.inf, np.nan
    resolved = resolver(phasors)
    np.testing.assert_array_equal(
        resolved.status & (StatusBit.LOW_CONFIDENCE | StatusBit.NOT_FINITE),
        [StatusBit.LOW_CONFIDENCE, StatusBit.NOT_FINITE, StatusBit.NOT_FINITE, StatusBit.NOT_FINITE],
    )
    for path in resolved.paths:
        assert np.isnan([path.amplitude, path.phase_rad, path.sigma_rad]).all()


@every_resolver
def test_inputs_are_not_changed_and_neighbours_do_not_matter(resolver: Resolver) -> None:
    rng = np.random.default_rng(5)
    columns = [problem.phasors(resolver.harmonics, n_av=2e3, size=1, rng=rng) for problem in TWO_PATHS.values()]
    phasors = np.concatenate([*columns, np.full((len(resolver.harmonics), 1), np.nan)], axis=1)
    before = phasors.copy()
    together = resolver(phasors)
    np.testing.assert_array_equal(phasors, before)
    for size in (1, 5):
        alone = [resolver(phasors[:, i : i + size], first=i) for i in range(0, phasors.shape[1], size)]
        np.testing.assert_array_equal(together.status, np.concatenate([part.status for part in alone]))
        for index, path in enumerate(together.paths):
            for name in ("amplitude", "phase_rad", "sigma_rad"):
                parts = np.concatenate([getattr(part.paths[index], name) for part in alone])
                np.testing.assert_array_equal(getattr(path, name), parts)


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 3, 4), (1, 2, 3, 5)])
@pytest.mark.parametrize(
    "problem",
    [
        Mixture((1.0, 0.5, 0.3), (5.0, 13.0, 21.0)),
        Mixture((0.5, 1.0, 0.3), (5.0, 13.0, 21.0)),
        Mixture((1.0, 0.9, 0.8), (2.0, 15.0, 28.0)),
        Mixture((1.0, 0.3, 0.2), (5.0, 9.0, 30.0)),
    ],
)
def test_three_paths_are_found_the_first_return_first_then_by_falling_amplitude(
    harmonics: tuple[int, ...], problem: Mixture
) -> None:
    resolved = Resolver("", ResolverSettings(paths=3), harmonics)(problem.exact(harmonics))
    first, *later = zip(problem.delays_ns, problem.shares, strict=True)
    expected = [first, *sorted(later, key=lambda path: -path[1])]
    np.testing.assert_allclose(delays(resolved), [delay for delay, _ in expected], atol=1e-3)
    np.testing.assert_allclose([path.amplitude[0] for path in resolved.paths], [a for _, a in expected], rtol=1e-3)
    assert resolved.status[0] == StatusBit.MORE_PATHS


@every_resolver
def test_two_paths_are_ill_conditioned_where_a_sigma_exceeds_a_quarter_of_their_separation(resolver: Resolver) -> None:
    """The separation counts as the sine of half of it. Beyond the limit, sigma is only a lower bound of the scatter."""
    rng = np.random.default_rng(12)
    lights = [Mixture((1.0, 0.4), (10.0, 10.0 + gap), asr=2.0) for gap in np.geomspace(0.7, 12.0, 60)]
    drawn = [light.phasors(resolver.harmonics, n_av=3e3, size=6, rng=rng) for light in lights]
    found = resolver(np.concatenate(drawn, axis=1), n_av=3e3)
    two = (found.status & StatusBit.TWO_PATHS) > 0
    half = np.abs(np.sin(0.5 * (found.paths[1].phase_rad - found.paths[0].phase_rad)))[two]
    ratio = np.maximum(found.paths[0].sigma_rad, found.paths[1].sigma_rad)[two] / half
    flagged = (found.status[two] & StatusBit.ILL_CONDITIONED) > 0
    np.testing.assert_array_equal(flagged[ratio > 0.501], True)
    np.testing.assert_array_equal(flagged[ratio < 0.499], False)
    if resolver.settings.order == "2":
        assert ((ratio > 0.501) & (ratio < 0.95)).any()
    assert ((ratio < 0.499) & (ratio > 0.1)).any()


ORDER_TESTED = [resolver for resolver in RESOLVERS if resolver.settings.order == "auto"]

SEVERAL_HARMONICS = [resolver for resolver in ONE_PATH if len(resolver.harmonics) > 1]


@pytest.mark.parametrize("resolver", ORDER_TESTED + SEVERAL_HARMONICS, ids=lambda r: f"{r.name} {r.harmonics}")
@pytest.mark.parametrize("samples", [1.0, 16.0])
def test_one_path_is_ill_conditioned_in_a_tenth_of_pixels_and_near_a_second_path(
    resolver: Resolver, samples: float
) -> None:
    """A second path of share r at D rad shortens the phasor of harmonic h by the share h²·D²·r/2(1+r)².

    At 2 ns of 40 ns and ASR 6, this is two standard deviations with the harmonics {1, 2}.
    """
    rng = np.random.default_rng(14)
    n_av = 1e5 / samples
    clean, close = (
        resolver(
            light.phasors(resolver.harmonics, n_av=1e5, size=4000, rng=rng), n_av=n_av, samples=np.full(4000, samples)
        )
        for light in (Mixture((1.0,), (5.0,), asr=6.0), Mixture((1.0, 0.3), (5.0, 7.0), asr=6.0))
    )
    one = clean.status & ~StatusBit.POOLED
    assert (one == StatusBit.ONE_PATH | StatusBit.ILL_CONDITIONED).mean() == pytest.approx(0.1, abs=0.015)
    assert ((close.status & (StatusBit.ILL_CONDITIONED | StatusBit.TWO_PATHS)) > 0).mean() > 0.7


@pytest.mark.parametrize("resolver", [*RESOLVERS, *ONE_PATH], ids=lambda r: f"{r.name} {r.harmonics}")
def test_a_mean_of_frames_is_resolved_as_a_frame_of_as_many_times_the_length(resolver: Resolver) -> None:
    """A mean of 9 frames has the noise 1/(9·(2 n_av − 1)) in the order test, in the screening and in sigma."""
    rng = np.random.default_rng(13)
    longer = 0.5 * (9 * (2 * 1e4 - 1) + 1)
    lights = [
        *TWO_PATHS.values(),
        Mixture((1.0,), (5.0,)),
        Mixture((1.0, 0.02), (5.0, 16.0)),
        Mixture((1.0,), (5.0,), 300),
    ]
    drawn = np.concatenate([one.phasors(resolver.harmonics, n_av=longer, size=4, rng=rng) for one in lights], axis=1)
    mean, long = resolver(drawn, n_av=1e4, samples=np.full(drawn.shape[1], 9.0)), resolver(drawn, n_av=longer)
    same = (mean.status & ~np.uint32(StatusBit.POOLED)) == long.status
    assert same.mean() > 0.95
    assert (mean.status & StatusBit.POOLED).all()
    exact = resolver.settings.solver_module(resolver.harmonics, sine=True) == CLOSED_FORM
    for one, other in zip(mean.paths[:2], long.paths[:2], strict=True):
        ratio = (one.sigma_rad / other.sigma_rad)[np.isfinite(other.sigma_rad)]
        difference = (np.abs(one.phase_rad - other.phase_rad) / other.sigma_rad)[np.isfinite(other.sigma_rad)]
        if exact:
            np.testing.assert_allclose(ratio, 1.0, rtol=1e-5)
            assert difference.max(initial=0.0) < 1e-6
        elif np.isfinite(ratio).any():  # a search ends within a third of the standard deviation
            assert np.nanmedian(ratio) == pytest.approx(1.0, rel=1e-3)
            assert np.nanmedian(difference) < 0.3
    if np.isfinite(mean.chi_squared).any():
        assert np.nanmedian(np.abs(mean.chi_squared - long.chi_squared)) < 0.1


@pytest.mark.parametrize("resolver", [*RESOLVERS, *ONE_PATH], ids=lambda r: f"{r.name} {r.harmonics}")
def test_bad_pixels_have_their_reason_and_do_not_change_the_others(resolver: Resolver) -> None:
    rng = np.random.default_rng(14)
    good = [one.phasors(resolver.harmonics, n_av=1e5, size=1, rng=rng) for one in TWO_PATHS.values()]
    phasors = np.concatenate(good * 2, axis=1)
    phasors[0, 1], phasors[-1, 4] = np.nan, 1j * np.inf
    phasors[:, 7] = 1e-9
    saturated, hot = np.zeros((2, phasors.shape[1]), np.bool_)
    saturated[[0, 9]], hot[[9, 12]] = True, True
    found = resolver(phasors, n_av=1e5, saturated=saturated, hot=hot)
    reasons = {
        0: StatusBit.SATURATED,
        1: StatusBit.NOT_FINITE,
        4: StatusBit.NOT_FINITE,
        7: StatusBit.LOW_CONFIDENCE,
        9: StatusBit.SATURATED | StatusBit.HOT_PIXEL,
        12: StatusBit.HOT_PIXEL,
    }
    assert {index: found.status[index] for index in reasons} == reasons
    for path in found.paths:
        for values in (path.amplitude, path.phase_rad, path.sigma_rad):
            assert np.isnan(values[list(reasons)]).all()
    for index in set(range(phasors.shape[1])) - set(reasons):
        alone = resolver(phasors[:, [index]], n_av=1e5, first=index)
        assert found.status[index] == alone.status[0]
        assert found.confidence[index] == alone.confidence[0]
        for one, other in zip(found.paths, alone.paths, strict=True):
            np.testing.assert_array_equal(one.phase_rad[index], other.phase_rad[0])
            np.testing.assert_array_equal(one.amplitude[index], other.amplitude[0])
            np.testing.assert_array_equal(one.sigma_rad[index], other.sigma_rad[0])
    assert np.isnan(found.confidence[[0, 1, 9]]).all()
