"""The settings of the resolver: their defaults, their limits, and the captures that they can be used for."""

from typing import Any

import pytest

from cadtof_cli.errors import SettingsError
from cadtof_cli.resolver.settings import ResolverSettings


def test_by_default_the_order_test_chooses_between_one_and_two_paths() -> None:
    chosen = ResolverSettings()
    assert (chosen.solver, chosen.paths, chosen.order, chosen.returns) == ("two-path", 2, "auto", "first")
    assert (chosen.starts, chosen.seed, chosen.false_alarm, chosen.min_return_ratio) == (10, 0, 0.01, 0.1)
    assert chosen.min_confidence is None


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ({"paths": 1, "order": "1"}, 1),
        ({"starts": 1, "seed": 0}, 2),
        ({"min_return_ratio": 0.0}, 2),
        ({"min_return_ratio": 1.0}, 2),
        ({"false_alarm": 1e-12}, 2),
        ({"false_alarm": 0.999}, 2),
        ({"paths": 3, "order": "3"}, 3),
        ({"solver": "lm", "paths": 2, "order": "2"}, 2),
    ],
)
def test_values_at_a_limit_are_accepted(options: dict[str, Any], most: int) -> None:
    chosen = ResolverSettings(**options)
    assert {name: getattr(chosen, name) for name in options} == options
    assert chosen.max_paths == most


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"paths": 0}, "--paths: found 0, expected 1 to 100"),
        ({"paths": 10**20}, "--paths: found 100000000000000000000, expected 1 to 100"),
        ({"starts": 0}, "--starts: found 0, expected 1 to 1000000000"),
        ({"starts": 10**20}, "--starts: found 100000000000000000000, expected 1 to"),
        ({"seed": -1}, "--seed: found -1, expected 0 or more"),
        ({"solver": "neural"}, "--solver: found 'neural', expected one of two-path, one-path"),
        ({"solver": "one-path", "order": "2"}, "--order: found '2', expected one of auto, 1 with --solver one-path"),
        ({"false_alarm": 0.0}, "--false-alarm: found 0.0"),
        ({"false_alarm": 1.0}, "--false-alarm: found 1.0, expected a probability"),
        ({"min_return_ratio": -0.1}, "--min-return-ratio: found -0.1, expected 0 to 1"),
        ({"min_return_ratio": 1.001}, "--min-return-ratio: found 1.001, expected 0 to 1"),
        ({"returns": "second"}, "--return: found 'second', expected one of first, strongest, last"),
        ({"solver": "lm", "paths": 3}, "--solver lm finds two paths, not --paths 3"),
        ({"order": "3"}, "--order: found '3', expected one of auto, 1, 2 with --solver two-path and --paths 2"),
        ({"order": "0"}, "--order: found '0'"),
    ],
)
def test_values_beyond_a_limit_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        ResolverSettings(**options)


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ({}, 2),
        ({"order": "1"}, 1),
        ({"order": "2"}, 2),
        ({"solver": "one-path"}, 1),
        ({"paths": 4}, 4),
        ({"paths": 4, "order": "2"}, 2),
    ],
)
def test_max_paths_follows_from_solver_paths_and_order(options: dict[str, Any], most: int) -> None:
    assert ResolverSettings(**options).max_paths == most


@pytest.mark.parametrize(
    ("options", "harmonics", "room"),
    [
        ({}, (1, 2), "two_path"),
        ({"solver": "one-path"}, (1, 2), "two_path"),
        ({"solver": "lm"}, (1, 2), "paper"),
        ({"solver": "lm"}, (1, 2, 3), "paper"),
        ({"solver": "lm", "order": "1"}, (1, 2), "likelihood"),
        ({"order": "1"}, (1, 3), "likelihood"),
        ({}, (1, 2, 3), "likelihood"),
    ],
)
def test_the_room_follows_from_solver_order_and_harmonics(
    options: dict[str, Any], harmonics: tuple[int, ...], room: str
) -> None:
    assert ResolverSettings(**options).solver_module(harmonics, sine=True) == f"{room}.solver"


@pytest.mark.parametrize(
    ("options", "harmonics", "words"),
    [
        ({}, (1, 2), None),
        ({}, (1, 3, 4), None),
        ({"order": "1"}, (1, 3), None),
        ({"solver": "one-path"}, (1,), None),
        ({"paths": 3}, (1, 2, 3), None),
        ({"paths": 3}, (1, 3), "3 paths need at least 3 periods"),
        (
            {"paths": 3},
            (1, 2, 5),
            r"only if these are harmonics 1, 2, 3, such as \[40.0, 20.0, 13.333\]: record another",
        ),
        ({"paths": 3}, (1, 2, 4), None),
        ({"paths": 3, "order": "2"}, (1, 2, 5), None),
        ({"mpi_model": "diffuse"}, (1, 3, 4), "--mpi-model diffuse: found harmonics 1, 3, 4 of the first period"),
        ({"mpi_model": "diffuse"}, (1, 2, 4), None),
        # it has no effect there
        ({"mpi_model": "diffuse", "order": "1"}, (1, 3, 4), None),
        ({"mpi_model": "diffuse", "solver": "one-path"}, (1, 3), None),
        ({"paths": 3}, (1, 2, 4, 5), None),
        ({}, (1,), "found 1 period; 2 paths need at least 2 periods"),
        (
            {},
            (1, 3),
            "with 2 periods, 2 paths have a unique solution only if these are harmonics 1, 2",
        ),
    ],
)
def test_harmonics_that_cannot_separate_the_paths_are_refused(
    options: dict[str, Any], harmonics: tuple[int, ...], words: str | None
) -> None:
    settings = ResolverSettings(**options)
    if words is None:
        settings.solver_module(harmonics, sine=True)
        return
    with pytest.raises(SettingsError, match=words):
        settings.solver_module(harmonics, sine=True)


@pytest.mark.parametrize(
    ("options", "harmonics", "module"),
    [
        ({}, (1, 2), "response.solver"),
        ({"solver": "one-path"}, (1, 2), "response.solver"),
        ({}, (1, 2, 3), "response.more_harmonics"),
        ({"paths": 3}, (1, 2, 3), "response.more_harmonics"),
        ({"solver": "one-path"}, (1, 3), "response.more_harmonics"),
        ({"solver": "one-path"}, (1,), "response.more_harmonics"),
    ],
)
def test_a_response_that_is_no_sine_has_solvers_of_its_own(
    options: dict[str, Any], harmonics: tuple[int, ...], module: str
) -> None:
    assert ResolverSettings(**options).solver_module(harmonics, sine=False) == module


@pytest.mark.parametrize("options", [{}, {"order": "1"}])
def test_the_papers_search_is_refused_for_a_response_that_is_no_sine(options: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match="waveform or calibrated response is not a pure sine: leave the option out"):
        ResolverSettings(solver="lm", **options).solver_module((1, 2, 3), sine=False)


def test_the_expected_time_per_pixel_follows_what_was_measured() -> None:
    """The times that were measured are .2 µs, 4 µs, 30 µs and 40 µs per pixel."""
    closed = ResolverSettings().seconds_per_pixel(2)
    likelihood = ResolverSettings().seconds_per_pixel(3)
    lm = ResolverSettings(solver="lm").seconds_per_pixel(2)
    many = ResolverSettings(paths=3).seconds_per_pixel(3)
    assert 10 * closed < likelihood < 10 * lm < 20 * many < 20e-4
    assert ResolverSettings(solver="lm", order="1").seconds_per_pixel(2) == closed
