"""Grids of numbers as they are typed in options."""

import pytest

from cadtof_cli.commands.values import grid_from_text
from cadtof_cli.errors import SettingsError


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("5", (5.0,)),
        ("1,2.5,1e3", (1.0, 2.5, 1000.0)),
        ("1:6:6", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        ("6:1:2", (6.0, 1.0)),
        ("2:2:1", (2.0,)),
        ("log:1e3:1e5:3", (1000.0, 10000.0, 100000.0)),
    ],
)
def test_a_grid_is_a_list_or_even_or_logarithmic_steps(text: str, values: tuple[float, ...]) -> None:
    assert grid_from_text(text, name="--asr") == pytest.approx(values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "--asr: found '' in '', expected a number in 1,2,5 or start:stop:n"),
        ("1,x", "found 'x' in '1,x'"),
        ("1,,2", "found '' in '1,,2'"),
        ("1:2", "found '1:2', expected 1,2,5 or"),
        ("1:2:3:4", "found '1:2:3:4'"),
        ("1:6:0", "found '0' steps in '1:6:0', expected 1 to 10000"),
        ("1:6:2.5", "found '2.5' steps"),
        ("1:6:-3", "found '-3' steps"),
        ("1:6:1", "expected two ends that differ and 2 steps or more"),
        ("3:3:4", "expected two ends that differ"),
        ("log:0:10:3", "expected ends above 0 for a log grid"),
        ("log:1,2", "found 'log:1,2', expected"),
        ("inf", "found 'inf'"),
        ("nan:2:3", "found 'nan'"),
        ("1,1", "contains a value twice"),
    ],
)
def test_impossible_grids_are_refused(text: str, message: str) -> None:
    with pytest.raises(SettingsError) as caught:
        grid_from_text(text, name="--asr")
    assert message in str(caught.value)
