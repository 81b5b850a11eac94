"""Status bits are a promise to whoever reads maps: their numbers, as the README has them, and how pixels are counted."""

import re
from pathlib import Path

import numpy as np

from cadtof_cli.resolver.status import MEANING, StatusBit, count_status

README = Path(__file__).parents[2] / "README.md"


def test_the_numbers_are_those_of_the_readme() -> None:
    documented = {
        int(number): name.split(" (")[0].strip()
        for number, name in re.findall(r"^\| (\d+) \| ([^:|;]+)", README.read_text(encoding="utf-8"), re.MULTILINE)
    }
    bits = {int(bit): bit.name for bit in StatusBit}
    assert set(bits) == {1 << place for place in range(len(bits))}
    assert set(bits) <= set(documented)
    for number, name in ((2048, "diffuse MPI"), (4096, "impossible")):
        assert documented[number].startswith(name)
    assert set(MEANING) == set(StatusBit)


def test_every_pixel_is_counted_once() -> None:
    status = np.array([[8, 8 | 64, 16], [16 | 32, 512, 2048], [1, 4, 0]], np.uint32)
    counts = count_status(status)
    assert (counts.one_path, counts.two_paths, counts.more_paths, counts.diffuse, counts.invalid) == (2, 2, 1, 1, 3)
