"""Shared by tests of the compiled code: the kernels to compare with numpy, the bits of maps, and refusals of buffers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.resolver.kernels import NUMPY, available_kernels


def compiled_kernels() -> list[str]:
    """Return the kernels besides numpy; there is at least one, so that no comparison is empty."""
    found = [kernel for kernel in available_kernels() if kernel != NUMPY]
    assert found
    return found


def bits_of(maps: DepthMaps) -> NDArray[np.uint32]:
    """Return the bits of all layers and of the status as 32-bit words, (layers + 1, pixels)."""
    return np.concatenate([maps.values.view(np.uint32), maps.status[np.newaxis]]).reshape(len(maps.pages), -1)


def assert_refused(function: Callable[..., object], sound: list[Any], place: int, value: object) -> None:
    """Check that a function that takes the sound arguments refuses a value in place of one of them."""
    function(*sound)
    given = list(sound)
    given[place] = value
    with pytest.raises((ValueError, TypeError, BufferError)):
        function(*given)
