"""Every command and every option says what it is for, and the README knows every command."""

import itertools
import re

import click
import pytest

from cadtof_cli.cli import COMMANDS
from cadtof_cli.commands.help import Command
from cadtof_cli.simulation.scene.scenes import SCENES
from tests.support.commands import every_command
from tests.support.run_cadtof import ROOT, cadtof


@pytest.mark.parametrize("words", every_command())
def test_a_command_has_help(words: str) -> None:
    command = every_command()[words]
    done = cadtof(*words.split(), "--help")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith(f"Usage: cadtof {words} ")
    assert isinstance(command, Command | click.Group), (
        f"{words}: cls=Command is missing, which notes options typed twice"
    )
    assert command.help
    assert command.help.strip().partition("\n")[0].endswith(".")
    for option in (param for param in command.params if isinstance(param, click.Option)):
        assert option.help, f"{words} {option.opts[0]} has no help"
        assert option.opts[0] in done.out


@pytest.mark.parametrize(
    ("words", "option", "heading"),
    [
        ("resolve", "--recursive", "Options"),
        ("resolve", "--calibration", "Resolving options"),
        ("resolve", "--pool", "Resolving options"),
        ("resolve", "--scheduler", "Worker options"),
        ("resolve", "--fwhm-ns", "Capture options (each overrides a key of capture.toml)"),
        ("calibrate dark", "--raw-shape", "Capture options (each overrides a key of capture.toml)"),
        ("inspect", "--roi", None),
        ("inspect", "--depth", "Resolving options"),
        ("simulate", "--periods-ns", "Options"),
        ("simulate", "--direct", "Options without --scene"),
        ("simulate", "--order", "Resolving without --scene"),
        ("simulate", "--albedo", "Options with --scene"),
        ("sweep", "--runs", "Options"),
        ("sweep", "--jitter-ns", "Pixel options"),
        ("sweep", "--wrapped", "Resolving options"),
    ],
)
def test_an_option_stands_under_its_heading(words: str, option: str, heading: str | None) -> None:
    sections = re.split(r"^(\S.*):\n", cadtof(*words.split(), "--help").out, flags=re.MULTILINE)
    found = [
        title
        for title, text in zip(sections[1::2], sections[2::2], strict=True)
        if re.search(rf"^  (-\w, )?{option}\b", text, re.MULTILINE)
    ]
    assert found == ([] if heading is None else [heading])


@pytest.mark.parametrize("words", every_command())
def test_a_default_is_shown_once(words: str) -> None:
    context = click.Context(every_command()[words], info_name=words)
    for option in (param for param in context.command.params if isinstance(param, click.Option)):
        record = option.get_help_record(context)
        assert record is None or record[1].count("default: ") < 2, f"{words} {option.opts[0]}"


@pytest.mark.parametrize("words", ["", *every_command()])
@pytest.mark.parametrize("columns", [30, 40, 59])
def test_help_fits_a_narrow_terminal(words: str, columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only a single word may be longer than a line, and no line ends within the name of an option."""
    monkeypatch.setenv("COLUMNS", str(columns))
    done = cadtof(*words.split(), "--help")
    options = done.out.partition("Options:\n")[2].partition("Capture options")[0].partition("Example")[0]
    assert "--help" in options
    assert not [line for line in options.splitlines() if len(line) > columns and " " in line.strip()]
    assert not re.findall(r"--[\w-]*-$", options, re.MULTILINE)


def test_an_option_with_a_default_per_scene_shows_all_of_them() -> None:
    help_text = re.sub(r"\s+", " ", cadtof("simulate", "--help").out.replace("-\n", "-"))
    for scene, option in itertools.product(SCENES, ("distance_m", "albedo", "opening_deg")):
        if hasattr(SCENES[scene], option):
            default = getattr(SCENES[scene], option)
            shown = re.search(rf"--{option.replace('_', '-')}\b[^]]*?[ ;]{scene} (random|[\d.]+)[;\]]", help_text)
            assert shown is not None, (scene, option)
            assert shown[1] == ("random" if default is None else f"{default:g}")


def test_the_program_lists_its_commands() -> None:
    done = cadtof("--help")
    assert (done.status, done.err) == (0, "")
    listed = re.findall(r"^  (\w+) +\S.*$", done.out.partition("Commands:")[2], re.MULTILINE)
    assert listed == list(COMMANDS)
    assert cadtof("--version").out.startswith("cadtof")


@pytest.mark.parametrize("name", COMMANDS)
def test_the_readme_names_the_command(name: str) -> None:
    named = f"cadtof {name}" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert named, f"README.md needs a row for `cadtof {name}` in its table of commands"


def test_a_command_that_does_not_exist() -> None:
    done = cadtof("frobnicate")
    assert (done.status, done.out) == (2, "")
    assert "No such command 'frobnicate'" in done.err


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("resolv", "resolve"), ("reslove", "resolve"), ("evalute", "evaluate"), ("calibarte", "calibrate")],
)
def test_a_command_that_is_mistyped(typed: str, meant: str) -> None:
    done = cadtof(typed, "somewhere", "-o", "out")
    assert (done.status, done.out) == (2, "")
    assert f"No such command '{typed}': did you mean {meant}?" in done.err


def test_a_calibration_without_its_step() -> None:
    done = cadtof("calibrate", "wall", "-o", "camera")
    assert (done.status, done.out) == (2, "")
    assert done.err.endswith("Error: found 'wall', expected one of the steps dark, response, petzval\n")


def test_an_option_that_is_mistyped() -> None:
    done = cadtof("resolve", "somewhere", "-o", "out", "--recusive")
    assert done.status == 2
    assert "--recursive" in done.err


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("resolve", "--periods-ns, --periods NS,NS…"),
        ("resolve", "--waveform sine|triangle"),
        ("resolve", "--saturated-counts LOW,HIGH"),
        ("info", "--principal-point-px, --principal-point X,Y"),
        ("info", "--lamp-offset-m, --lamp-offset M,M,M"),
        ("simulate", "--lamp-offset-m, --lamp-offset M,M,M"),
        ("simulate", "--petzval-m, --petzval M,M"),
        ("sweep", "--offsets-v, --offsets V,V"),
        ("report", "--focal-length-px, --focal-length PX"),
    ],
)
def test_a_value_is_shown_as_its_unit_once_per_number(words: str, line: str) -> None:
    assert re.search(rf"^  {re.escape(line)}( |$)", cadtof(words, "--help").out, re.MULTILINE)


@pytest.mark.parametrize("command", ["resolve", "info"])
def test_help_names_the_values_of_the_paper_that_are_used_if_none_is_given(command: str) -> None:
    words = " ".join(cadtof(command, "--help").out.split())
    for value in ("40,20", "sine", "0.2746", "1.7"):
        assert f"[if not given: {value}, the paper's]" in words
    assert words.count("[if not given: ") == 4
