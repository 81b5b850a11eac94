"""How printed texts are compared: words must be equal, numbers agree within a tolerance, timings are ignored."""

import pytest
from docs_checks.printed import close, differences, like


@pytest.mark.parametrize(
    ("expected", "found"),
    [
        ("depth 1.00 m", "depth 1.01 m"),
        ("depth  1.00   m", "depth 1.00 m"),
        ("bias -0.5", "bias -0.51"),
        ("resolved 1 of 1 frames in 0.1 s (12 frames/s)", "resolved 1 of 1 frames in 3 s (0.3 frames/s)"),
        ("from … to 3", "from here, 5 and 6, to 3"),
        ("9.172e+04", "9.18e+04"),
        ("σ –", "σ –"),
        ("shape 2 × 240", "shape 2 × 240"),
    ],
)
def test_lines_with_close_numbers_and_any_timings_are_alike(expected: str, found: str) -> None:
    assert like(expected, found)


@pytest.mark.parametrize(
    ("expected", "found"),
    [
        ("depth 1.00 m", "depth 1.10 m"),
        ("depth 1.00 m", "height 1.00 m"),
        ("7 frames", "8 frames"),
        ("bias -0.5", "bias 0.5"),
        ("from … to 3", "from here to 4"),
        ("depth 1.00 m", "depth 1.00 m and more"),
    ],
)
def test_lines_that_differ_in_words_or_numbers_are_not_alike(expected: str, found: str) -> None:
    assert not like(expected, found)


def test_numbers_are_close_within_a_share_or_one_in_the_last_digit() -> None:
    assert close("0.01", "0.02")
    assert not close("0.01", "0.03")
    assert close("100", "101")
    assert not close("100", "103")
    assert not close("3", "4")


def test_texts_are_compared_line_by_line() -> None:
    assert not list(differences("a 1\n…\nb 2", "a 1\nx\ny\nb 2"))
    assert not list(differences("a 1\n…", "a 1\nx\ny"))
    assert list(differences("a 1\nb 2", "a 1")) == ["expected 'b 2', and nothing more is printed"]
    assert list(differences("a 1", "a 1\nb 2")) == ["expected no more, found 'b 2'"]
    assert list(differences("a 1\n…\nc 3", "a 1\nb 2")) == ["expected 'c 3', and nothing more is printed"]
    assert list(differences("a 1", "a 7")) == ["expected 'a 1', found 'a 7'"]
