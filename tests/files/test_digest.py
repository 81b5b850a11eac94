"""A digest changes when an accident changes a file or its values."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.files.digests import Digest, content_digest, file_digest


@pytest.mark.parametrize("size", [0, 1, 4095, 4096, 4097, 2**22, 2**22 + 5000, 9_000_001])
def test_a_file_has_the_digest_of_its_bytes(size: int, tmp_path: Path) -> None:
    content = np.random.default_rng(size).integers(0, 256, size, np.uint8)
    path = tmp_path / "file"
    path.write_bytes(content.tobytes())
    pieces = Digest()
    for start, stop in itertools.pairwise([*range(0, min(size, 9000), 1000), size]):
        pieces.update(content[start:stop].data)
    assert file_digest(path) == pieces.hexdigest()


def test_every_change_of_one_byte_is_found() -> None:
    content = np.random.default_rng(0).integers(0, 256, 20_000, np.uint8)
    before = content_digest(content)
    for place in range(0, content.size, 37):
        content[place] ^= 1
        assert content_digest(content) != before
        content[place] ^= 1
    assert content_digest(content) == before


def test_a_digest_depends_on_order_shape_and_type() -> None:
    values = np.random.default_rng(0).integers(0, 2**16, (4, 2048), np.uint16)
    digests = {
        content_digest(one)
        for one in (values, values[::-1], values[:, ::-1], values.reshape(8, 1024), values.view(np.int16))
    }
    assert len(digests) == 5
