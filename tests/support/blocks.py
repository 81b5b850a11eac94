"""Frames that are resolved in blocks of another size than usual."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from cadtof_cli.pipeline import frame


@contextmanager
def blocks_of(pixels: int) -> Iterator[None]:
    """Resolve frames in blocks of so many pixels."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("BLOCK_PIXELS", "SEARCHED_BLOCK_PIXELS"):
            patch.setattr(frame, name, pixels)
        yield
