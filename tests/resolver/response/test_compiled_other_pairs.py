"""Other pairs of paths: the compiled code returns numpy's bits by every instruction set, and refuses unfit buffers.

`scripts/sanitize` runs these tests with the address and undefined-behaviour sanitizers.
"""

from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cadtof_cli.arrays import Float32
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.response.other_pairs import Rule, WeightedPhasors, reached
from cadtof_cli.resolver.response.table import ENTRIES
from tests.resolver.compiled import assert_refused, compiled_kernels
from tests.resolver.response.phasors import COUNT, NOISE, block, paths, recorded
from tests.support.hard_pixels import HARD
from tests.support.kernels import by_kernel

pytestmark = pytest.mark.usefixtures("compiled")


RULES = [Rule(np.float32(ratio), np.float32(sign)) for ratio, sign in ((0.1, 1.0), (1.0, 1.0), (0.2, -1.0))]


def assert_same_bits(seen: WeightedPhasors, phase_rad: Float32, sigma_rad: Float32, rule: Rule = RULES[0]) -> Float32:
    with np.errstate(all="ignore"):
        expected = by_kernel(NUMPY, reached, seen, phase_rad, sigma_rad, rule)
        for kernel in compiled_kernels():
            found = by_kernel(kernel, reached, seen, phase_rad, sigma_rad, rule)
            np.testing.assert_array_equal(found.view(np.uint32), expected.view(np.uint32), err_msg=kernel)
    return expected


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("phases", [False, True])
@pytest.mark.parametrize("apart", [0.4, 0.9, 3.0])
def test_pairs_reach_as_far_to_the_bit(rule: Rule, phases: bool, apart: float) -> None:
    """Close paths reach far, and paths that are far apart do not."""
    response, true = block(phases=phases), paths(1)
    true[3] = true[1] + np.float32(apart)
    seen = WeightedPhasors.of(response, recorded(true, response), NOISE)
    found = assert_same_bits(seen, true[1::2], np.full((2, COUNT), 0.01, np.float32), rule)
    assert (found > 0.0).mean() > (0.5 if apart < 1.0 and not phases else 0.005)


@pytest.mark.parametrize("harmonics", [3, 4, 5, 9])
def test_more_harmonics_reach_as_far_to_the_bit(harmonics: int) -> None:
    """The compiled code keeps three and four harmonics in registers, and has no room for nine."""
    response, true = block(phases=True, harmonics=harmonics), paths(1)
    true[3] = true[1] + np.float32(0.3)
    noise = replace(
        NOISE, each=tuple(replace(NOISE.each[0], harmonic=1 + row, floor=1e-7 * row) for row in range(harmonics))
    )
    seen = WeightedPhasors.of(response, recorded(true, response), noise)
    assert (assert_same_bits(seen, true[1::2], np.full((2, COUNT), 0.01, np.float32)) > 0.0).any()


@pytest.mark.parametrize("name", HARD)
def test_hard_pixels_reach_as_far_to_the_bit(name: str) -> None:
    rng = np.random.default_rng(3)
    odd = np.array([0.0, -0.0, 1.0, 1e-30, 5e5, 1e30, np.nan, np.inf, -1.0, 4.0], np.float32)
    with np.errstate(all="ignore"):
        seen = WeightedPhasors.of(block(phases=True), np.stack(HARD[name](rng, COUNT)), NOISE)
    assert_same_bits(seen, paths(5)[1::2], np.full((2, COUNT), 0.01, np.float32))
    assert_same_bits(seen, rng.choice(odd, (2, COUNT)), rng.choice(odd, (2, COUNT)))


@pytest.mark.parametrize("count", [0, 1, 7, 31, 32, 33])
def test_a_pixel_reaches_as_far_in_a_block_of_any_size(count: int) -> None:
    response, true = block(phases=False), paths(1)
    true[3] = true[1] + np.float32(0.8)
    whole, some = WeightedPhasors.of(response, recorded(true, response), NOISE), np.arange(100, 100 + count)
    sigma = np.full((2, COUNT), 0.01, np.float32)
    expected = assert_same_bits(whole, true[1::2], sigma)[:, some]
    np.testing.assert_array_equal(assert_same_bits(whole[some], true[1::2][:, some], sigma[:, some]), expected)


PIXELS = 37
SIZES = (4 + 3 * 2, 8 * ENTRIES, 2 * PIXELS, 4 * PIXELS, PIXELS, 2 * PIXELS, 2 * PIXELS, 2 * PIXELS)
"""Numbers of values: constants, tables, phases, phasors, per variance, found, sigma, farthest."""

PHASES = 2


@pytest.mark.parametrize("place", range(len(SIZES)))
def test_buffers_that_do_not_fit_are_refused(compiled: ModuleType, place: int) -> None:
    sound: list[Any] = [compiled.levels()[0], *(np.ones(size, np.float32) for size in SIZES)]
    for value in (3, "text", np.ones(SIZES[place] + 1, np.float32), np.ones(SIZES[place], np.float64)):
        assert_refused(compiled.follow_pairs, sound, place + 1, value)
    if place != PHASES:
        assert_refused(compiled.follow_pairs, sound, place + 1, None)


def test_an_output_that_overlaps_an_input_or_is_read_only_is_refused(compiled: ModuleType) -> None:
    sound: list[Any] = [compiled.levels()[0], *(np.ones(size, np.float32) for size in SIZES)]
    assert_refused(compiled.follow_pairs, sound, len(SIZES), sound[-2])
    only_read = np.ones(SIZES[-1], np.float32)
    only_read.flags.writeable = False
    assert_refused(compiled.follow_pairs, sound, len(SIZES), only_read)
    assert_refused(compiled.follow_pairs, sound, 0, "mmx")
    for harmonics in (1, 9):
        others = 4 + 3 * harmonics, 4 * ENTRIES * harmonics, harmonics * PIXELS, 2 * harmonics * PIXELS
        unfit = [np.ones(size, np.float32) for size in (*others, *SIZES[4:])]
        with pytest.raises(ValueError, match="harmonics, expected 2 to 8"):
            compiled.follow_pairs(compiled.levels()[0], *unfit)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), phases=st.booleans())
def test_any_bits_are_an_answer(compiled: ModuleType, seed: int, phases: bool) -> None:
    rng = np.random.default_rng(seed)
    given: list[Any] = [np.frombuffer(bytearray(rng.bytes(4 * size)), np.float32) for size in SIZES]
    if not phases:
        given[PHASES] = None
    read = [None if values is None else values.tobytes() for values in given[:-1]]
    for level in compiled.levels():
        compiled.follow_pairs(level, *given)
        assert not (given[-1] < 0.0).any()
        assert [None if values is None else values.tobytes() for values in given[:-1]] == read
