"""Every resolver on every reference problem; what is true comes from the problem."""

from dataclasses import dataclass

import numpy as np
import pytest

from cadtof_cli.resolver.paths import ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.forward import ns_from_rad
from tests.support.mixtures import C, Mixture, noise_of

N_AV = 1e10
"""So long that noise decides nothing here: what it does to the answers is measured elsewhere."""


@dataclass(frozen=True)
class Resolver:
    """Settings, and the harmonics that they are to work on."""

    name: str
    settings: ResolverSettings
    harmonics: tuple[int, ...]

    def __call__(self, phasors: C, **options: object) -> ResolvedPaths:
        """Resolve phasors."""
        count = phasors.shape[1]
        return resolve_paths(
            phasors,
            status=np.zeros(count, np.uint32),
            settings=self.settings,
            noise=noise_of(self.harmonics, n_av=N_AV),
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
"""Equal paths half a turn apart cancel in the fundamental, and in every odd harmonic."""

every_resolver = pytest.mark.parametrize("resolver", RESOLVERS, ids=lambda resolver: resolver.name)


def delays(resolved: ResolvedPaths) -> list[float]:
    return [float(ns_from_rad(path.phase_rad)[0]) for path in resolved.paths]


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
def test_paths_that_cancel_in_the_fundamental_are_found_where_the_second_harmonic_tells_them(
    resolver: Resolver,
) -> None:
    exact = NO_FUNDAMENTAL.exact(resolver.harmonics)
    exact[np.array(resolver.harmonics) % 2 == 1] = 0.0  # free of rounding
    resolved = resolver(exact)
    if resolver.settings.solver == "lm":  # Eq. (9) divides by the first phasor
        assert resolved.status[0] == StatusBit.NOT_CONVERGED
        assert np.isnan(delays(resolved)).all()
    elif 2 in resolver.harmonics:
        np.testing.assert_allclose(sorted(delays(resolved)[:2]), NO_FUNDAMENTAL.delays_ns, atol=2e-4)
        assert resolved.status[0] == StatusBit.TWO_PATHS
    else:  # only the fourth is left: any two of four delays that are a quarter turn apart
        quarter = np.mod(delays(resolved)[:2], 10.0)
        np.testing.assert_allclose(quarter, 3.0, atol=2e-4)


@pytest.mark.parametrize(
    "resolver", [*RESOLVERS, *ONE_PATH], ids=lambda resolver: f"{resolver.name} {resolver.harmonics}"
)
@pytest.mark.parametrize("delay", [0.0, 5.0, 19.9, 39.0])
def test_one_path_is_found(resolver: Resolver, delay: float) -> None:
    problem = Mixture((1.0,), (delay,))
    resolved = resolver(problem.exact(resolver.harmonics))
    away = np.angle(np.exp(1j * (resolved.direct.phase_rad - problem.phases)))
    if resolver.settings.order == "2":  # asked for two, with noise for the second: the paths may share the light
        strong = resolved.direct.amplitude > 0.5 * problem.shares
        assert not strong.any() or np.abs(away[strong]).max() < 0.01
        return
    assert np.abs(away).max() < 1e-6
    np.testing.assert_allclose(resolved.direct.amplitude, problem.shares, rtol=1e-5)
    assert np.isnan(resolved.mpi.phase_rad[0])
    assert resolved.status[0] == StatusBit.ONE_PATH


@every_resolver
def test_no_signal_and_no_number_give_no_answer(resolver: Resolver) -> None:
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
        alone = [resolver(phasors[:, i : i + size]) for i in range(0, phasors.shape[1], size)]
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
def test_three_paths_are_found_the_others_in_falling_amplitude(harmonics: tuple[int, ...], problem: Mixture) -> None:
    resolved = Resolver("", ResolverSettings(paths=3), harmonics)(problem.exact(harmonics))
    first, *later = zip(problem.delays_ns, problem.shares, strict=True)
    expected = [first, *sorted(later, key=lambda path: -path[1])]
    np.testing.assert_allclose(delays(resolved), [delay for delay, _ in expected], atol=1e-3)
    np.testing.assert_allclose([path.amplitude[0] for path in resolved.paths], [a for _, a in expected], rtol=1e-3)
    assert resolved.status[0] == StatusBit.MORE_PATHS
