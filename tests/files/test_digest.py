"""Digests find what accidents do to files and values."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.files import digest as room
from cadtof_cli.files.digest import Digest, content_digest, file_digest


@pytest.mark.parametrize("size", [0, 1, 4095, 4096, 4097, 2**22, 2**22 + 5000, 9_000_001])
def test_a_file_has_the_digest_of_its_bytes(size: int, tmp_path: Path) -> None:
    content = np.random.default_rng(size).integers(0, 256, size, np.uint8)
    path = tmp_path / "file"
    path.write_bytes(content.tobytes())
    pieces = Digest()
    for start, stop in itertools.pairwise([*range(0, min(size, 9000), 1000), size]):
        pieces.update(content[start:stop].data)
    assert file_digest(path) == pieces.hexdigest()


@pytest.mark.parametrize("offset", [0, 1, 7])
def test_numpy_and_the_compiled_sums_agree(offset: int) -> None:
    if room.compiled is None:
        pytest.skip("cadtof was installed without a C compiler")
    data = np.random.default_rng(1).integers(0, 256, 50 * 4096 + offset, np.uint8)[offset:].data
    found = []
    for one in (room.numpy_sums, room.compiled.sums):
        columns, rows = np.arange(512, dtype=np.uint64), np.empty(50, np.uint64)
        one(data, columns, rows)
        found.append((columns.tolist(), rows.tolist()))
    assert found[0] == found[1]


@pytest.mark.parametrize(("data", "columns", "rows"), [(4095, 512, 1), (4096, 511, 1), (4096, 512, 2), (8192, 512, 1)])
def test_buffers_that_do_not_fit_are_refused(data: int, columns: int, rows: int) -> None:
    if room.compiled is None:
        pytest.skip("cadtof was installed without a C compiler")
    with pytest.raises(ValueError, match="do not fit"):
        room.compiled.sums(bytes(data), np.zeros(columns, np.uint64), np.zeros(rows, np.uint64))


def test_every_change_of_one_byte_is_found() -> None:
    content = np.random.default_rng(0).integers(0, 256, 20_000, np.uint8)
    before = content_digest(content)
    for place in range(0, content.size, 37):
        content[place] ^= 1
        assert content_digest(content) != before
        content[place] ^= 1
    assert content_digest(content) == before


def test_order_shape_and_type_count() -> None:
    values = np.random.default_rng(0).integers(0, 2**16, (4, 2048), np.uint16)
    digests = {
        content_digest(one)
        for one in (values, values[::-1], values[:, ::-1], values.reshape(8, 1024), values.view(np.int16))
    }
    assert len(digests) == 5
