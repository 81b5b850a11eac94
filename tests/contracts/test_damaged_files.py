"""Reading a damaged file raises a FrameError that names it, or returns the right values. It prints nothing.

If a file has no checksum, changed bytes may also be read as changed values, or as another width or sample type; this
cannot be detected. But missing bytes are always detected.
"""

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout
from tests.files.forms import FORMS, Form, known_frame

LAYOUT = FrameLayout((1, 2))
SHAPE = (20, 24)
ROUNDS = 30

Damage = Callable[[bytes, random.Random], bytes]


def _truncated(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.randrange(len(content))]


def _bit_flipped(content: bytes, rng: random.Random) -> bytes:
    damaged = bytearray(content)
    damaged[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    return bytes(damaged)


def _zeroed(content: bytes, rng: random.Random) -> bytes:
    begin = rng.randrange(len(content))
    end = min(len(content), begin + rng.choice((1, 4, 64, 700)))
    return content[:begin] + bytes(end - begin) + content[end:]


def _header_damaged(content: bytes, rng: random.Random) -> bytes:
    """Change a byte near the beginning or the end, where TIFF and EXR keep their headers."""
    damaged = bytearray(content)
    place = rng.randrange(min(len(content), 420))
    damaged[place if rng.random() < 0.5 else -1 - place] = rng.randrange(256)
    return bytes(damaged)


def _outcome(source: FrameSource) -> Stored | FrameError:
    try:
        with open_frames(source, LAYOUT) as frames:
            assert frames.count == 1
            return frames.read(0)
    except FrameError as error:
        return error


@pytest.mark.parametrize("damage", [_truncated, _bit_flipped, _zeroed, _header_damaged])
@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_damage_is_an_error_or_does_not_matter(
    form: Form,
    damage: Damage,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    recorded = known_frame(form.dtype, shape=SHAPE)
    source = form.write(tmp_path / "frame", recorded)
    path = source.paths[-1]
    content = path.read_bytes()
    rng = random.Random(f"{form.name} {damage.__name__}")
    for _ in range(ROUNDS):
        path.write_bytes(damage(content, rng))
        outcome = _outcome(source)
        if isinstance(outcome, FrameError):
            assert str(path) in str(outcome)
            assert not isinstance(outcome.__cause__, Warning)
            continue
        assert outcome.shape[:2] == (2, 2)
        if form.checked or damage is _truncated:
            assert outcome.tobytes() == recorded.tobytes()
    assert capfd.readouterr() == ("", "")
    # a log record that reaches pytest's handler would be printed in a program without a handler
    assert caplog.records == []


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_every_truncation_is_an_error_unless_all_values_are_still_there(form: Form, tmp_path: Path) -> None:
    recorded = known_frame(form.dtype, shape=(4, 6))
    source = form.write(tmp_path / "frame", recorded)
    path = source.paths[-1]
    content = path.read_bytes()
    for length in range(0, len(content), 1 + len(content) // 120):
        path.write_bytes(content[:length])
        outcome = _outcome(source)
        assert isinstance(outcome, FrameError) or np.array_equal(outcome, recorded), length


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_reading_goes_on_after_damage(form: Form, tmp_path: Path) -> None:
    recorded = known_frame(form.dtype, shape=SHAPE)
    source = form.write(tmp_path / "frame", recorded)
    path = source.paths[-1]
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(FrameError), open_frames(source, LAYOUT) as frames:
        frames.read(0)
    path.write_bytes(content)
    with open_frames(source, LAYOUT) as frames:
        assert frames.read(0).tobytes() == recorded.tobytes()
