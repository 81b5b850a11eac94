"""The compiled search with a full response returns the bits of the search in numpy, and refuses arrays that do not fit."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.resolver.likelihood.kernel import RESPONSE
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit
from cadtof_cli.resolver.response.more_harmonics import ResponseFit
from cadtof_cli.resolver.response.table import ENTRIES, response_block
from tests.resolver.compiled import assert_refused
from tests.resolver.searches import (
    COUNTS,
    SOLVERS,
    assert_every_level_agrees,
    assert_problems_are_apart,
    hard_phasors,
)
from tests.support.kernels import by_kernel


def responses_of(harmonics: tuple[int, ...]) -> tuple[HarmonicResponse, ...]:
    """Return triangles whose channels differ, as a calibration finds them."""
    periods = tuple(40.0 / h for h in harmonics)
    metadata = CaptureMetadata(modulation=Modulation(periods_ns=periods, waveform="triangle"))
    return tuple(HarmonicResponse(one.harmonic, (*one.terms, (-1, 0.02 - 0.01j))) for one in ideal_response(metadata))


def problem_of(harmonics: tuple[int, ...], paths: int, count: int, *, own: bool) -> tuple[ResponseFit, Float]:
    rng = np.random.default_rng([paths, count, *harmonics])
    periods = tuple(40.0 / h for h in harmonics)
    metadata = CaptureMetadata(modulation=Modulation(periods_ns=periods, waveform="triangle"))
    noise = noise_model(metadata, integration_length=1e4, quantised=False)
    measured = Measured.of_phasors(hard_phasors(len(harmonics), count, rng), harmonics=harmonics)
    phase = rng.uniform(0.0, 2.0 * np.pi, (paths, count))
    start = Mixture(rng.uniform(0.0, 0.4, (paths, count)), np.cos(phase), np.sin(phase))
    weights = WeightedFit.around(measured, start, noise=noise).weights
    phases = rng.uniform(-3.0, 3.0, (len(harmonics), count)) if own else None
    return ResponseFit(measured, weights, response_block(responses_of(harmonics), phases)), start.points


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("paths", [1, 2, 3, 4])
@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 3, 4, 7), (1,)])
def test_searches_end_in_the_same_bits(search: ModuleType, harmonics: tuple[int, ...], paths: int, own: bool) -> None:
    for count in COUNTS:
        assert_every_level_agrees(search, *problem_of(harmonics, paths, count, own=own))


def test_a_problem_ends_the_same_whichever_others_are_solved_with_it(search: ModuleType) -> None:
    assert_problems_are_apart(search, *problem_of((1, 2, 3), 2, 501, own=True))


def test_the_search_of_a_response_moves_to_its_light(search: ModuleType) -> None:
    """The bits could agree because nothing moves."""
    problem, starts = problem_of((1, 2, 3), 2, 501, own=True)
    end = by_kernel(search.levels()[0], SOLVERS[0].solve, problem, starts)
    with np.errstate(all="ignore"):
        begin = problem.linearised(starts)
    seen = np.isfinite(end.cost) & (begin.cost < 1e9)
    assert (end.cost[seen] <= begin.cost[seen]).all()
    assert np.median(end.cost[seen]) < 0.3 * np.median(begin.cost[seen])
    assert end.converged[seen].mean() > 0.9


def arguments(level: str) -> list[Any]:
    """Return valid arguments of the compiled `solve`, for two problems of one path under a response."""
    plane, harmonics = np.ones((1, 2)), np.array([1], np.int64)
    outputs = [np.empty((3, 2)), np.empty(2), np.empty((3, 2)), np.empty(2, np.bool_)]
    response = [np.ones((1, ENTRIES, 4), np.float32), np.zeros((1, 2), np.float32), np.ones((1, 2), np.complex128)]
    inputs = [harmonics, plane, plane, np.ones((3, 1, 2)), np.ones((3, 2)), np.ones(2)]
    return [level, RESPONSE, 1, 3, 0.0, 1e-3, *inputs, *outputs, *response]


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (1, 0),
        (1, 1),
        (1, 3),
        (9, np.ones(1)),
        (16, None),
        (16, np.ones((1, ENTRIES, 3), np.float32)),
        (16, np.ones((1, ENTRIES, 4))),
        (17, None),
        (17, np.zeros((1, 3), np.float32)),
        (17, np.zeros((1, 2))),
        (18, None),
        (18, np.ones((1, 3), np.complex128)),
        (18, np.ones((1, 2))),
    ],
)
def test_arrays_that_do_not_fit_are_errors(search: ModuleType, place: int, value: object) -> None:
    assert_refused(search.solve, arguments(search.levels()[0]), place, value)


def test_pixels_without_own_phases_end_as_pixels_whose_own_phases_are_0(search: ModuleType) -> None:
    with_phases, without = (arguments(search.levels()[0]) for _ in range(2))
    search.solve(*with_phases)
    search.solve(*without[:-2])
    for place in range(12, 16):
        np.testing.assert_array_equal(with_phases[place], without[place])
