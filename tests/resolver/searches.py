"""Shared by tests of compiled searches: hard phasors, and comparisons of the ends of many searches, bit by bit."""

from dataclasses import fields
from types import ModuleType
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt, Minimum, PathsProblem
from tests.support.kernels import by_kernel
from tests.support.mixtures import C

SOLVERS = (
    LevenbergMarquardt(max_steps=40, absolute=0.1),
    LevenbergMarquardt(max_steps=5, relative=1e-2, absolute=1e-29, first_damping=1e-6),
    LevenbergMarquardt(max_steps=0),
)
COUNTS = (0, 1, 7, 33, 1001)
"""Numbers of pixels: none, fewer and more than the compiled search solves at a time."""


def hard_phasors(rows: int, count: int, rng: np.random.Generator) -> C:
    """Return phasors of plain noise; in every fifty pixels, five hold NaN, 0, 1e150, infinity and 1e-200 instead."""
    phasors: C = np.empty((rows, count), np.complex128)
    phasors.real, phasors.imag = 0.1 * rng.normal(size=(2, rows, count))
    for first, poison in enumerate((np.nan, 0.0, 1e150, np.inf, 1e-200)):
        phasors[:, first::50] = poison
    return phasors


def assert_same_bits(one: Any, other: Any) -> None:
    """Check that all fields of two records hold the same bits; NaN equals NaN."""
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert a.dtype == b.dtype
        assert a.tobytes() == b.tobytes() or np.array_equal(a, b, equal_nan=True), field.name


def assert_every_level_agrees(search: ModuleType, problem: PathsProblem, starts: Float) -> None:
    """Check that every instruction set ends the problems where numpy does, by every solver."""
    samples = np.random.default_rng(1).uniform(1.0, 400.0, size=(starts.shape[1],))
    with np.errstate(all="ignore"):
        for solver in SOLVERS:
            expected = by_kernel(NUMPY, solver.solve, problem, starts, samples=samples)
            for level in search.levels():
                assert_same_bits(expected, by_kernel(level, solver.solve, problem, starts, samples=samples))


def assert_problems_are_apart(search: ModuleType, problem: PathsProblem, starts: Float) -> None:
    """Check that a problem ends the same whichever others are solved with it."""
    whole = by_kernel(search.levels()[0], SOLVERS[0].solve, problem, starts)
    some = np.random.default_rng(2).permutation(starts.shape[1])[:77]
    alone = by_kernel(search.levels()[0], SOLVERS[0].solve, problem[some], starts[:, some])
    assert_same_bits(alone, Minimum(*(part[..., some] for part in vars(whole).values())))
