"""Radiosity, pair by pair, has the same bits in numpy and in every compiled kernel, which refuses unfit buffers."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.planes import Surfaces
from cadtof_cli.resolver.diffuse.radiosity import interreflections, light_of
from cadtof_cli.resolver.kernels import NUMPY
from tests.resolver.compiled import compiled_kernels
from tests.support.kernels import by_kernel

pytestmark = pytest.mark.usefixtures("compiled")


def pieces(count: int, seed: int) -> Surfaces:
    """Return small pieces of surface with random positions and normals; some are at the same position."""
    rng = np.random.default_rng(seed)
    ray, normal = rng.normal(size=(2, 3, count))
    ray[:, ::7] = ray[:, :1]
    ray /= np.linalg.norm(ray, axis=0)
    normal -= 2.0 * ray
    normal /= np.linalg.norm(normal, axis=0)
    range_m = rng.uniform(1.0, 4.0, count)
    range_m[::7] = 2.0
    cosine = np.maximum(-(ray * normal).sum(0), 0.08)
    return Surfaces(range_m, normal, ray, cosine, rng.uniform(0.05, 0.4, count))


@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 5)])
@pytest.mark.parametrize(("seen", "beyond"), [(1, 0), (31, 1), (33, 40), (150, 64)])
def test_light_between_pieces_has_the_same_bits(harmonics: tuple[int, ...], seen: int, beyond: int) -> None:
    room, around = pieces(seen, 1), pieces(beyond, 2)
    amplitude = np.random.default_rng(3).uniform(0.01, 0.5, seen)

    def light() -> list[Any]:
        found = interreflections(room, around, amplitude, harmonics=harmonics, rad_per_m=0.5)
        guessed = light_of(around, room, rad_per_m=0.5)
        return [found.seen, found.beyond, found.later, found.direct, found.open_share, guessed]

    expected = by_kernel(NUMPY, light)
    assert all(np.isfinite(one).all() for one in expected)
    for kernel in compiled_kernels():
        for one, other in zip(by_kernel(kernel, light), expected, strict=True):
            np.testing.assert_array_equal(one, other)


ONTO, SOURCES = 5, 37

WRITTEN = 3
"""Number of buffers that the function writes: the last ones."""


def buffers() -> list[Any]:
    shapes: list[Any] = [*[(ONTO, SOURCES)] * 2, *[(SOURCES,)] * 2, *[(ONTO, SOURCES)] * 3]
    types = [np.float32] * 5 + [np.complex64] * 2
    return [np.ones(shape, dtype) for shape, dtype in zip(shapes, types, strict=True)]


def test_buffers_that_do_not_fit_are_refused(compiled: ModuleType) -> None:
    level = compiled.levels()[0]

    def function(level: str, *given: Any) -> None:
        compiled.light_matrix(level, 0.5, *given)

    function(level, *buffers())
    with pytest.raises(ValueError, match="level"):
        function("mmx", *buffers())
    for place, sound in enumerate(buffers()):
        for unfit in (
            np.ones(sound.size + 1, sound.dtype),
            np.ones(sound.size - 1, sound.dtype),
            np.ones(sound.shape),
            None,
            "text",
        ):
            given = buffers()
            given[place] = unfit
            with pytest.raises((TypeError, ValueError)):
                function(level, *given)
    for place in range(-WRITTEN, 0):
        given = buffers()
        given[place].setflags(write=False)
        with pytest.raises((ValueError, BufferError)):
            function(level, *given)
        given = buffers()
        given[0] = given[place].view(np.float32).ravel()[: ONTO * SOURCES]
        with pytest.raises(ValueError, match="lies in the memory"):
            function(level, *given)


def test_a_call_without_pieces_returns_none(compiled: ModuleType) -> None:
    none = np.empty((0, 0), np.float32)
    filled = (none.copy(), *(none.astype(np.complex64) for _ in range(2)))
    assert compiled.light_matrix(compiled.levels()[0], 0.5, none, none, none, none, *filled) is None
