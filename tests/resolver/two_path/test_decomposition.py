"""The decomposition of any phasors into two paths has the same bits in numpy and in every compiled kernel."""

from dataclasses import fields
from types import ModuleType

import numpy as np
import pytest

from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.two_path.closed_form import TwoPaths
from cadtof_cli.resolver.two_path.decomposition import decomposed
from tests.resolver.compiled import compiled_kernels
from tests.support.hard_pixels import HARD
from tests.support.kernels import by_kernel

pytestmark = pytest.mark.usefixtures("compiled")


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("count", [1, 31, 33, 1000])
def test_hard_pixels_have_the_same_bits(name: str, count: int) -> None:
    p1, p2 = HARD[name](np.random.default_rng(count), count)
    expected = by_kernel(NUMPY, decomposed, p1, p2)
    with np.errstate(all="ignore"):
        phases = expected.phases()
    for kernel in compiled_kernels():
        found = by_kernel(kernel, decomposed, p1, p2)
        for field in fields(TwoPaths)[:-1]:
            np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name), err_msg=field.name)
        np.testing.assert_array_equal(found.phases(), phases)


def test_two_known_paths_are_found() -> None:
    rng = np.random.default_rng(3)
    a, b, x = rng.uniform(0.6, 1.0, 500), rng.uniform(0.1, 0.5, 500), rng.uniform(0.5, 5.0, 500)
    y = x + rng.uniform(0.3, 1.2, 500)
    p1, p2 = (a * np.exp(1j * h * x) + b * np.exp(1j * h * y) for h in (1, 2))
    for kernel in (NUMPY, *compiled_kernels()):
        paths = by_kernel(kernel, decomposed, p1, p2)
        first = paths.a > paths.b
        np.testing.assert_allclose(np.where(first, *paths.amplitude), a)
        np.testing.assert_allclose(np.where(first, *paths.phases()), x)
        np.testing.assert_allclose(np.where(first, *paths.phases()[::-1]), np.mod(y, 2.0 * np.pi))


@pytest.mark.parametrize("place", range(3))
def test_buffers_that_do_not_fit_are_refused(compiled: ModuleType, place: int) -> None:
    level = compiled.levels()[0]
    sound = [np.ones(5, complex), np.ones(5, complex), np.zeros((9, 5))]
    compiled.decompose(level, *sound)
    assert sound[2][0].tolist() == [1.0] * 5
    for unfit in (
        np.ones(sound[place].size + 1, sound[place].dtype),
        np.zeros(sound[place].shape, np.float32),
        None,
        "text",
    ):
        given = [*sound[:place], unfit, *sound[place + 1 :]]
        with pytest.raises((TypeError, ValueError)):
            compiled.decompose(level, *given)
    with pytest.raises(ValueError, match="level"):
        compiled.decompose("mmx", *sound)
    memory = np.zeros((9, 5))
    with pytest.raises(ValueError, match="lies in the memory"):
        compiled.decompose(level, memory.ravel()[:10].view(complex), sound[1], memory)
    sound[2].setflags(write=False)
    with pytest.raises((ValueError, BufferError)):
        compiled.decompose(level, *sound)
