"""The compiled search of Eq. (9) returns numpy's bits for any input, and refuses buffers that do not fit."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Index
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath
from cadtof_cli.resolver.paper.levenberg_marquardt import Ends, MisfitDamped, best_ends
from cadtof_cli.resolver.paper.starts import RandomStarts
from tests.resolver.compiled import assert_refused
from tests.support.kernels import by_kernel

STOPPINGS = (
    MisfitDamped(),
    MisfitDamped(max_steps=0),
    MisfitDamped(max_steps=3, relative=0.0, absolute=0.0, first_damping=1e-9),
    MisfitDamped(max_steps=30, absolute=-1.0, first_damping=1e11),
)
COUNTS = (0, 1, 31, 32, 33, 501)


def equations_of(harmonics: tuple[int, ...], count: int) -> EliminatedPath:
    """Return equations whose right sides q are those of two paths, near |q| = 1 and elsewhere; of no light; NaN and ∞."""
    rng = np.random.default_rng([count, *harmonics])
    z = 0.5 + rng.normal(size=count) * 10.0 ** rng.uniform(-8, 1, count) + 1j * 10.0 ** rng.uniform(-8, 1, count)
    right = []
    for j in harmonics:
        q = z**j / np.abs(z) ** (j - 1) + (1 - z) ** j / np.abs(1 - z) ** (j - 1)
        q += rng.choice([0.0, 1e-3, 1.0], count) * rng.normal(size=count)
        for first, poison in enumerate((np.nan, 0.0, 1e150, np.inf, 1e-200, 1.0)):
            q[first::37] = poison
        right.append((q.real.copy(), q.imag.copy()))
    return EliminatedPath(harmonics, tuple(right))


def assert_same_bits(one: Ends, other: Ends) -> None:
    np.testing.assert_array_equal(one.z.view(np.int64), other.z.view(np.int64))
    np.testing.assert_array_equal(one.cost.view(np.int64), other.cost.view(np.int64))
    np.testing.assert_array_equal(one.converged, other.converged)
    np.testing.assert_array_equal(one.steps, other.steps)


@pytest.mark.parametrize("stopping", STOPPINGS)
@pytest.mark.parametrize("harmonics", [(2,), (2, 3), (3,), (2, 4, 16)])
def test_searches_end_in_the_same_bits(search: ModuleType, harmonics: tuple[int, ...], stopping: MisfitDamped) -> None:
    starts = RandomStarts(4, 7)
    with np.errstate(all="ignore"):
        for count in COUNTS:
            equations, places = equations_of(harmonics, count), np.arange(count)[::-1] * 1000003
            for numbers in (None, range(2, 3)):
                expected = by_kernel(NUMPY, best_ends, equations, places, starts, numbers=numbers, stopping=stopping)
                for level in search.levels():
                    found = by_kernel(level, best_ends, equations, places, starts, numbers=numbers, stopping=stopping)
                    assert_same_bits(expected, found)


def test_indices_of_a_32_bit_system_end_in_the_same_bits(search: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    equations, starts = equations_of((2, 3), 33), RandomStarts(4, 7)
    with np.errstate(all="ignore"):
        expected = by_kernel(search.levels()[0], best_ends, equations, np.arange(33), starts)
        monkeypatch.setattr(np, "intp", np.int32)
        assert_same_bits(
            expected, by_kernel(search.levels()[0], best_ends, equations, np.arange(33, dtype=np.intp), starts)
        )


def test_any_bits_end_in_the_same_bits(search: ModuleType) -> None:
    bits = np.random.default_rng(3).integers(-(2**63), 2**63, (2, 4000), np.int64).view(np.float64)
    equations, places, starts = EliminatedPath((2,), ((bits[0], bits[1]),)), np.arange(4000), RandomStarts(3, 0)
    with np.errstate(all="ignore"):
        expected = by_kernel(NUMPY, best_ends, equations, places, starts)
        for level in search.levels():
            assert_same_bits(expected, by_kernel(level, best_ends, equations, places, starts))


def test_a_pixel_ends_the_same_whichever_others_are_solved_with_it(search: ModuleType) -> None:
    equations, places, starts = equations_of((2, 3), 501), np.arange(501), RandomStarts(5, 1)
    some: Index = np.random.default_rng(2).permutation(501)[:77]
    for level in (NUMPY, search.levels()[0]):
        with np.errstate(all="ignore"):
            whole = by_kernel(level, best_ends, equations, places, starts)
            part = by_kernel(level, best_ends, equations[some], places[some], starts)
        assert_same_bits(part, Ends(whole.z[:, some], whole.cost[some], whole.converged[some], whole.steps[some]))


def test_equations_too_many_for_the_compiled_search_are_left_to_numpy(search: ModuleType) -> None:
    for harmonics in ((17,), tuple(range(2, 11))):
        given = equations_of(harmonics, 2), np.arange(2), RandomStarts(1, 0)
        with np.errstate(all="ignore"):
            found, expected = (by_kernel(kernel, best_ends, *given) for kernel in (search.levels()[0], NUMPY))
        assert_same_bits(found, expected)


def arguments(level: str) -> list[Any]:
    """Return valid arguments of the compiled `shares`, for two pixels."""
    plane = np.ones((1, 2))
    outputs = [np.empty((2, 2)), np.empty(2), np.empty(2, np.bool_), np.empty(2, np.int64)]
    return [level, 0, 2, 9, 2**64 - 1, 1e-3, 1e-29, 0.5, np.array([2], np.int64), plane, plane, np.arange(2), *outputs]


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (0, "mmx"),
        (1, -1),
        (1, 2),
        (2, 0),
        (3, -1),
        (4, 0.5),
        (8, np.array([0], np.int64)),
        (8, np.array([17], np.int64)),
        (8, np.array([], np.int64)),
        (8, np.array([2.0])),
        (8, None),
        (9, np.ones((1, 3))),
        (10, np.ones((1, 2), np.float32)),
        (10, None),
        (11, np.arange(3)),
        (11, np.arange(4)[::2]),
        (11, np.arange(2, dtype=np.int32)),
        (12, np.ones(2)),
        (13, np.ones(3)),
        (14, np.ones(2)),
        (15, np.ones(2)),
        (15, np.ones(3, np.int64)),
    ],
)
def test_buffers_that_do_not_fit_are_errors(search: ModuleType, place: int, value: object) -> None:
    assert_refused(search.shares, arguments(search.levels()[0]), place, value)


def test_outputs_that_overlap_inputs_or_are_read_only_are_refused(search: ModuleType) -> None:
    given = arguments(search.levels()[0])
    given[15] = given[11]
    with pytest.raises(ValueError, match="lies in the memory"):
        search.shares(*given)
    given = arguments(search.levels()[0])
    given[13].flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        search.shares(*given)
