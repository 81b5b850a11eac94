"""Status bits are a promise to readers of maps: their numbers are those of the README; every pixel is counted once."""

import re
from pathlib import Path

import numpy as np

from cadtof_cli.files.layers import STATUS_LIMIT
from cadtof_cli.report.colours import palette
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.status import StatusBit, describe_status, has_answer, why_no_answer
from cadtof_cli.resolver.two_path.kernel import count_status
from tests.support.kernels import by_kernel

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"


def test_the_numbers_and_names_of_status_bits_are_those_of_the_readme() -> None:
    table = README.read_text(encoding="utf-8").split("| bit of `status` | meaning |")[1].split("\n\n")[0]
    documented = {
        int(number): name.strip() for number, name in re.findall(r"^\| (\d+) \| ([^:|;]+)", table, re.MULTILINE)
    }
    known = {int(bit): describe_status(bit)[0] for bit in StatusBit}
    assert documented == known, (
        "write each bit of resolver/status.py, with its name, into README.md, table `bit of status`"
    )
    assert list(documented) == [1 << place for place in range(len(StatusBit))]


def test_the_inverse_of_bits_is_all_others() -> None:
    """Python 3.11.2, that of Debian 12, has it wrong for flags whose members are made of two values."""
    for bits in (*StatusBit, StatusBit.ONE_PATH | StatusBit.POOLED):
        assert ~bits == sum(bit for bit in StatusBit if not bit & bits)


def test_the_kernel_has_the_same_numbers() -> None:
    source = (ROOT / "cadtof_cli/resolver/two_path/_kernel_frame.h").read_text(encoding="utf-8")
    numbers = {name: int(value) for name, value in re.findall(r"\b([A-Z_]+) = (\d+)\b", source)}
    assert len(numbers) >= 10
    for name, value in numbers.items():
        assert value == StatusBit[name], f"_kernel_frame.h: {name} is {value}, not as in resolver/status.py"


def test_files_hold_all_bits_and_no_larger_number() -> None:
    limit = 1 << len(StatusBit)
    assert limit == STATUS_LIMIT, f"files/layers.py: STATUS_LIMIT must be {limit}, or maps with the new bit are refused"


def test_every_bit_has_a_colour_of_its_own_on_the_page() -> None:
    colours = palette()["status"]
    assert list(colours) == [bit.name for bit in StatusBit], "report/page/palette.json needs a colour for each bit"
    assert len(set(colours.values())) == len(colours)


def test_every_pixel_counts_as_one_of_the_kinds_of_answers() -> None:
    status = np.array([[8, 8 | 64, 16], [16 | 32, 512, 2048], [1, 4, 0]], np.uint32)
    counts = by_kernel(NUMPY, count_status, status)
    assert (counts.one_path, counts.two_paths, counts.more_paths, counts.diffuse, counts.invalid) == (2, 2, 1, 1, 3)


def test_bits_are_described_in_words() -> None:
    assert describe_status(StatusBit.TWO_PATHS | StatusBit.ILL_CONDITIONED) == ("two paths", "ill-conditioned")


def test_an_answer_is_a_path_or_a_predicted_tail() -> None:
    status = np.array([0, 1, 2, 4, 256, 4096, 8, 16, 512, 2048, 8 | 64, 16 | 32 | 128, 64 | 1024], np.uint32)
    assert has_answer(status).tolist() == [False] * 6 + [True] * 6 + [False]


def test_the_reasons_for_no_answer_are_printed_with_their_shares() -> None:
    dark = np.array([4, 4, 4, 1], np.uint32)
    message = why_no_answer(dark)
    assert message.startswith("no pixel has an answer (25.0% ")
    assert "75.0%" in message
    assert message.endswith(
        "; if there was light, check integration_length, amplitude_v, --min-confidence and --false-alarm"
    )
    assert why_no_answer(dark, noise_estimated=True).endswith("if there was light, give --integration-length")
    assert why_no_answer(np.full(4, StatusBit.SATURATED, np.uint32)).endswith(")")
    low = np.full(4, StatusBit.LOW_CONFIDENCE, np.uint32)
    assert "--min-confidence" in why_no_answer(low)
    impossible = why_no_answer(np.full(4, StatusBit.IMPOSSIBLE, np.uint32))
    assert impossible.endswith(
        "; check amplitude_v, volts_per_count and fwhm_ns; if the view moves fast, try --order 1"
    )
    assert "--min-confidence" not in impossible
    assert "100.0%" in why_no_answer(low)
