"""The compiled search returns the bits of the search in numpy for any input, and refuses buffers that do not fit."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.likelihood.kernel import WHITE, compiled_search
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from cadtof_cli.resolver.likelihood.starts import scanned
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from tests.resolver.compiled import assert_refused
from tests.resolver.searches import (
    COUNTS,
    SOLVERS,
    assert_every_level_agrees,
    assert_problems_are_apart,
    assert_same_bits,
    hard_phasors,
)
from tests.support import mixtures
from tests.support.kernels import by_kernel
from tests.support.mixtures import noise_of


def mixture_problem(
    harmonics: tuple[int, ...], paths: int, count: int, *, white: bool
) -> tuple[WhiteFit | WeightedFit, Float]:
    rng = np.random.default_rng([paths, count, *harmonics])
    noise = noise_of(harmonics, n_av=1e4)
    measured = Measured.of_phasors(hard_phasors(len(harmonics), count, rng), harmonics=harmonics)
    phase = rng.uniform(0.0, 2.0 * np.pi, (paths, count))
    start = Mixture(rng.uniform(0.0, 0.4, (paths, count)), np.cos(phase), np.sin(phase))
    if white:
        return WhiteFit(measured, tuple(1.0 / one.dark_variance for one in noise.each)), start.points
    return WeightedFit.around(measured, start, noise=noise), start.points


@pytest.mark.parametrize("white", [True, False])
@pytest.mark.parametrize("paths", [1, 2, 3, 4])
@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 3, 4, 7), (1,)])
def test_mixtures_end_in_the_same_bits(search: ModuleType, harmonics: tuple[int, ...], paths: int, white: bool) -> None:
    for count in COUNTS:
        assert_every_level_agrees(search, *mixture_problem(harmonics, paths, count, white=white))


def test_a_32_bit_system_ends_in_the_same_bits(search: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, starts = mixture_problem((1, 2, 3), 2, 33, white=True)

    def ends() -> tuple[Any, Any]:
        with np.errstate(all="ignore"):
            return SOLVERS[0].solve(problem, starts), scanned(problem.measured, weights=(1.0, 1.0, 1.0), pairs=True)

    expected = by_kernel(search.levels()[0], ends)
    # the type of indices there
    monkeypatch.setattr(np, "intp", np.int32)
    for one, other in zip(expected, by_kernel(search.levels()[0], ends), strict=True):
        assert_same_bits(one, other)


def test_a_problem_ends_the_same_whichever_others_are_solved_with_it(search: ModuleType) -> None:
    assert_problems_are_apart(search, *mixture_problem((1, 2, 3), 2, 501, white=True))


@pytest.mark.parametrize("paths", [1, 2, 4])
@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 16), (1,)])
def test_weights_are_the_same_bits(search: ModuleType, harmonics: tuple[int, ...], paths: int) -> None:
    for count in COUNTS:
        rng = np.random.default_rng(count)
        rows = hard_phasors(3 * paths, count, rng)
        light = Mixture.of_points(5.0 * rows.real)
        measured = Measured.of_phasors(hard_phasors(len(harmonics), count, rng), harmonics=harmonics)
        with np.errstate(all="ignore"):
            expected = by_kernel(NUMPY, WeightedFit.around, measured, light, noise=noise_of(harmonics, n_av=1e4))
            for level in search.levels():
                found = by_kernel(level, WeightedFit.around, measured, light, noise=noise_of(harmonics, n_av=1e4))
                np.testing.assert_array_equal(found.weights, expected.weights)


def test_buffers_of_weights_that_do_not_fit_are_errors(search: ModuleType) -> None:
    sound = [search.levels()[0], 1, np.array([1], np.int64), np.ones((1, 3)), np.ones((3, 2)), np.empty((3, 1, 2))]
    for place, value in (
        (0, "mmx"),
        (1, 0),
        (1, 5),
        (2, np.array([17], np.int64)),
        (3, np.ones((2, 3))),
        (4, np.ones((4, 2))),
        (5, np.empty((3, 1, 3))),
        (5, sound[4]),
    ):
        assert_refused(search.weigh, sound, place, value)


@pytest.mark.parametrize(("pairs", "places"), [(True, None), (False, None), (True, 128)])
@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 3), (1,), (1, 2, 7), (1, 2, 4, 5)])
def test_scans_find_the_same_bits(
    search: ModuleType, harmonics: tuple[int, ...], pairs: bool, places: int | None
) -> None:
    for count in COUNTS:
        phasors = hard_phasors(len(harmonics), count, np.random.default_rng(count))
        phasors[:, 40::50] = 0.1  # several places of the grid are equally good
        measured, weights = Measured.of_phasors(phasors, harmonics=harmonics), tuple(range(3, 3 + len(harmonics)))
        with np.errstate(all="ignore"):
            expected = by_kernel(NUMPY, scanned, measured, weights=weights, pairs=pairs, places=places)
            for level in search.levels():
                found = by_kernel(level, scanned, measured, weights=weights, pairs=pairs, places=places)
                assert_same_bits(expected, found)


def test_buffers_of_scans_that_do_not_fit_are_errors(search: ModuleType) -> None:
    plane, found = np.ones((1, 2)), [np.empty(2, np.int64), np.empty(2, np.int64), np.empty(2), np.empty(2)]
    sound = [search.levels()[0], 1, 8, True, np.ones((8, 1, 2)), np.ones((4, 3)), plane, plane.copy(), *found]
    for place, value in (
        (0, "mmx"),
        (1, 9),
        (1, 2),
        (2, 1),
        (2, 129),
        (2, 9),
        (4, np.ones((8, 1, 1))),
        (5, None),
        (5, np.ones((4, 2))),
        (6, np.ones((1, 3))),
        (7, np.ones((1, 2), np.float32)),
        (8, np.empty(3, np.int64)),
        (9, np.empty(2)),
        (10, np.empty(1)),
        (11, sound[10]),
    ):
        assert_refused(search.scan, sound, place, value)


@pytest.mark.parametrize("settings", [ResolverSettings(paths=3), ResolverSettings(solver="lm", order="2")])
def test_resolved_paths_have_the_bits_of_numpy(search: ModuleType, settings: ResolverSettings) -> None:
    light = mixtures.Mixture((1.0, 0.5), (5.0, 14.0))
    drawn = light.phasors((1, 2, 3), n_av=1e4, size=500, rng=np.random.default_rng(3))

    status, noise = np.zeros(500, np.uint32), noise_of((1, 2, 3), n_av=1e4)
    one, other = (
        by_kernel(kernel, resolve_paths, drawn, status=status, settings=settings, noise=noise)
        for kernel in (NUMPY, search.levels()[0])
    )
    assert_same_bits(one.paths, other.paths)
    np.testing.assert_array_equal(one.status, other.status)
    np.testing.assert_array_equal(one.chi_squared, other.chi_squared)


def test_a_problem_too_large_for_the_compiled_search_is_left_to_numpy(search: ModuleType) -> None:
    kernel = search.levels()[0]
    assert by_kernel(kernel, compiled_search, (1,), paths=1) is search
    assert by_kernel(NUMPY, compiled_search, (1,), paths=1) is None
    for harmonics, paths in (((17,), 1), (tuple(range(1, 10)), 1), ((1,), 5)):
        assert by_kernel(kernel, compiled_search, harmonics, paths=paths) is None


def arguments(level: str) -> list[Any]:
    """Return valid arguments of the compiled `solve`, for two problems of one path."""
    plane, harmonics = np.ones((1, 2)), np.array([1], np.int64)
    outputs = [np.empty((3, 2)), np.empty(2), np.empty((3, 2)), np.empty(2, np.bool_)]
    return [level, WHITE, 1, 3, 0.0, 1e-3, harmonics, plane, plane, np.ones(1), np.ones((3, 2)), np.ones(2), *outputs]


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (0, "mmx"),
        (1, 2),
        (1, -1),
        (1, 1),
        (2, 0),
        (2, 5),
        (3, -1),
        (6, np.array([0], np.int64)),
        (6, np.array([17], np.int64)),
        (6, np.array([], np.int64)),
        (6, np.array([1.0])),
        (7, np.ones((1, 3))),
        (8, np.ones((1, 2), np.float32)),
        (8, None),
        (9, None),
        (9, np.ones(2)),
        (10, np.ones((3, 3))),
        (10, np.ones((3, 4))[:, ::2]),
        (11, np.ones(1)),
        (12, np.ones((2, 2))),
        (13, np.ones(3)),
        (14, np.ones((2, 2))),
        (15, np.ones(2)),
    ],
)
def test_buffers_that_do_not_fit_are_errors(search: ModuleType, place: int, value: object) -> None:
    assert_refused(search.solve, arguments(search.levels()[0]), place, value)


def test_outputs_that_overlap_inputs_or_are_read_only_are_refused(search: ModuleType) -> None:
    for place, other in ((12, 10), (13, 11), (14, 12)):
        given = arguments(search.levels()[0])
        given[place] = given[other]
        with pytest.raises(ValueError, match="lies in the memory"):
            search.solve(*given)
    given = arguments(search.levels()[0])
    given[13].flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        search.solve(*given)
