"""The campaign of `scripts/fuzz`, in short: every reader, some hundred inputs, and no exception but CadtofError."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.fuzz.campaign import input_of
from tests.support.fuzz.readers import READERS, Reader, SurpriseError, run_command
from tests.support.fuzz.spoil import BYTES
from tests.support.run_cadtof import ENVIRONMENT, ROOT

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="children are watched by /proc")

INPUTS = 264


def test_the_catch_all_is_never_reached() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "fuzz.py"), "--inputs", str(INPUTS)]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=300, check=False)
    *_, readers, figures = done.stdout.splitlines()
    assert "found: 0 hang, 0 crash, 0 exception, 0 output, 0 memory" in figures, done.stdout
    assert figures.startswith(f"{INPUTS} inputs in ")
    assert readers.count(f" {INPUTS // len(READERS)}") == len(READERS)
    assert done.returncode == 0


_FAULTS = {
    "hang": "while True: pass",
    "crash": "import ctypes; ctypes.string_at(0)",
    "exception": "raise ZeroDivisionError",
    "output": "import os; os.write(1, b'said')",
    "memory": "whole = bytearray(600 * 2**20)",
}


def test_the_campaign_finds_every_kind_of_fault() -> None:
    script = """
import sys
from tests.support.fuzz import campaign
from tests.support.fuzz.readers import READERS, Reader

def read(place, content):
    exec(content)

READERS["tried"] = Reader("tried", None, (), read)
for kind, fault in eval(sys.argv[1]).items():
    campaign.MOST_SECONDS = 2.0 if kind == "hang" else 60.0
    campaign.input_of = lambda reader, number, place: fault.encode() if number == 1 else b""
    with campaign.sound_place() as place:
        tally = campaign.run_campaign(["tried"], place, inputs=3)
    print(kind, tally.total, [(one.kind, one.number) for one in tally.findings])
"""
    done = subprocess.run(
        [sys.executable, "-c", script, repr(_FAULTS)],
        env=ENVIRONMENT, capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    for kind, line in zip(_FAULTS, done.stdout.splitlines(), strict=True):
        assert line == f"{kind} 3 [('{kind}', 1)]", done.stdout


def test_an_input_can_be_made_again_from_its_number(tmp_path: Path) -> None:
    reader = Reader("any", lambda _: [b"one sample", b"another one"], BYTES, lambda *_: None)
    assert [input_of(reader, number, tmp_path) for number in range(20)] == [
        input_of(reader, number, tmp_path) for number in range(20)
    ]


def test_an_unexpected_error_of_a_command_is_a_surprise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def surprised(*_: object, **__: object) -> None:
        raise ValueError("surprise")

    monkeypatch.setattr("cadtof_cli.workflows.inspect.info.look_into", surprised)
    with pytest.raises(SurpriseError, match="unexpected ValueError: surprise"):
        run_command(("info", tmp_path))
