"""All readers of input that may come from a stranger, each with its samples and the ways to spoil them."""

import contextlib
import io
import json
import os
import re
import shutil
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from unittest.mock import patch

from cadtof_cli.calibration import store
from cadtof_cli.calibration.store import Part
from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel, Voltage
from cadtof_cli.cli import main
from cadtof_cli.execution.outcome import Later
from cadtof_cli.files.formats import detect_format
from cadtof_cli.files.frames import FrameLayout, RawLayout
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.workflows.inspect.capture_facts import FrameLook, facts_of_frame
from cadtof_cli.workflows.recording import FrameReader
from cadtof_cli.workflows.resolve.frame_task import FrameTask, resolve_file
from tests.support.fuzz import samples
from tests.support.fuzz.formats import EXR, NPY, PNG, TIFF
from tests.support.fuzz.spoil import BYTES, TEXT, Spoil

FEW_PIXELS = 40_000
"""A frame with more pixels is read but not resolved: it may take long because it is large, which is no fault."""

_METADATA = CaptureMetadata(
    pixel=Pixel(integration_length=1e5), voltage=Voltage(zero_counts=8192.0, volts_per_count=6e-5)
)

_LAYOUT = FrameLayout((1, 2))


AN_ADDRESS = " object at 0x"
"""Where an object of Python stands in a message: it would differ from run to run."""


class SurpriseError(Exception):
    """Something that must never reach a user."""


@dataclass(frozen=True)
class Reader:
    """A reader: its samples, the ways to spoil them, and a function that reads one in a folder of sound files."""

    name: str
    samples: Callable[[Path], list[bytes]]
    ways: tuple[Spoil, ...]
    read: Callable[[Path, bytes], None]


def run_command(arguments: Sequence[object], /, *, stdin: bytes | None = None) -> str:
    """Run a command line in this process and return its stderr; raise SurpriseError if users must not see that."""
    out, err = io.StringIO(), io.StringIO()
    status: object = 0
    with (
        patch.object(sys, "argv", ["cadtof", *map(str, arguments)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        _fed(stdin),
    ):
        try:
            main()
        except SystemExit as ended:
            status = ended.code
    stderr = err.getvalue()
    words = [
        word
        for word in ("unexpected", "Traceback", "Warning:", AN_ADDRESS)
        if word in stderr.replace("; Warning: ", "; ")
    ]
    if status not in {0, 1, 2} or (words and "unexpected extra argument" not in stderr):
        raise SurpriseError(f"{arguments} ended with {status}: {stderr[-1500:]}")
    if status and not stderr:
        raise SurpriseError(f"{arguments} ended with {status} and said nothing")
    if "--json" in arguments and status == 0:
        for line in out.getvalue().splitlines():
            json.loads(line)
    return stderr


@contextlib.contextmanager
def _fed(stdin: bytes | None) -> Iterator[None]:
    if stdin is None:
        yield
        return
    fed = os.memfd_create("stdin")
    os.write(fed, stdin)
    os.lseek(fed, 0, os.SEEK_SET)
    with os.fdopen(fed) as stream, patch.object(sys, "stdin", stream):
        yield


def read_frame(path: Path, layout: FrameLayout = _LAYOUT, others: tuple[Path, ...] = ()) -> None:
    """Read every frame of a file, look into the first, and resolve it; CadtofErrors are raised."""
    source = FrameSource("frame", (path, *others))
    with open_frames(source, layout) as frames:
        count, (height, width) = frames.count, frames.shape[2:]
        for index in {0, count - 1}:
            frames.read(index)
    if height * width > FEW_PIXELS:
        return
    source = source if count == 1 else source.expanded(count)[0]
    reader = FrameReader(layout, _METADATA)
    facts_of_frame(FrameLook(0, source, reader))
    task = FrameTask((source,), reader, FramePlan(metadata=_METADATA), path.parent / "frame_out.tif")
    report = resolve_file(task)
    if isinstance(report, Later):
        report = report.wait(lambda: None)
    if "unexpected" in str(report.reason):
        raise SurpriseError(str(report.reason))


def _file(suffix: str, layout: FrameLayout, place: Path, content: bytes) -> None:
    path = place / f"frame{suffix}"
    path.write_bytes(content)
    read_frame(path, layout)


def _plane(suffix: str, place: Path, content: bytes) -> None:
    sound = place / f"sound{suffix}"
    if not sound.exists():
        sound.write_bytes(samples.planes(suffix)[0])
    path = place / f"plane{suffix}"
    path.write_bytes(content)
    detect_format(path)
    read_frame(path, others=(sound, sound, sound))


def _maps(suffix: str, place: Path, content: bytes) -> None:
    path = place / f"map{suffix}"
    path.write_bytes(content)
    run_command(("info", path, "-j", 1, "--json"))
    for arguments in (
        ("evaluate", path, "--truth", "truth.exr", "--json"),
        ("evaluate", "out", "--truth", path),
        ("compare", path, "out/frame_0.tif", "--json"),
        *(("export", path, "-o", f"new{kind}", "--focal-length-px", 28) for kind in (".npz", ".ply", ".csv", ".png")),
    ):
        if run_command(arguments).startswith("Error: "):
            return


def _truth(place: Path, content: bytes) -> None:
    (place / "spoiled.exr").write_bytes(content)
    run_command(("evaluate", "out", "--truth", "spoiled.exr", "--json"))
    run_command(("info", "spoiled.exr", "-j", 1))


@contextlib.contextmanager
def _in_place_of(path: Path, content: bytes) -> Iterator[None]:
    """Put other content into a sound file until the context is left."""
    sound = path.read_bytes()
    path.write_bytes(content)
    try:
        yield
    finally:
        path.write_bytes(sound)


def _toml(place: Path, content: bytes) -> None:
    with _in_place_of(place / "cap" / "capture.toml", content):
        if run_command(("info", "cap", "-j", 1, "--json")).startswith("Error: "):
            return
        for arguments in (
            ("resolve", "cap", "-o", "new", "-j", 1, "--overwrite", "--json"),
            ("inspect", "cap", "--pixel", "3,4", "--json"),
            ("calibrate", "dark", "cap", "-o", "newcal", "--overwrite"),
        ):
            run_command(arguments)


def _calibration(name: str, place: Path, content: bytes) -> None:
    def trusting(part: Part) -> str:
        digest_of(part)
        return recorded or digest_of(part)

    digest_of, recorded = store.digest_of, ""
    with contextlib.suppress(Exception):
        recorded = str(tomllib.loads((place / "cal" / name).with_suffix(".toml").read_text())["part"]["digest"])
    with _in_place_of(place / "cal" / name, content):
        run_command(("info", "cal"))
        # whoever changes a part can change its digest too
        with patch.object(store, "digest_of", trusting):
            store.cached_calibration.cache_clear()
            store._read_at.cache_clear()
            if not run_command(("info", "cal", "--json")).startswith("wrong: "):
                run_command(("resolve", "cap", "-o", "new", "-j", 1, "--overwrite", "--calibration", "cal"))
                run_command(("inspect", "cap", "--pixel", "3,4", "--calibration", "cal"))
            store.cached_calibration.cache_clear()
            store._read_at.cache_clear()


def _record(name: str, place: Path, content: bytes) -> None:
    with _in_place_of(place / "out" / name, content):
        for arguments in (
            ("info", "out", "-j", 1, "--json"),
            ("evaluate", "out", "--truth", "truth.exr", "--json"),
            ("export", "out/frame_0.tif", "-o", "new.ply"),
            ("compare", "out", "exr", "--json"),
            ("resolve", "cap", "-o", "out", "-j", 1, "--resume", "--json"),
        ):
            run_command(arguments)


def _options(place: Path, content: bytes) -> None:
    words = [word for word in content.decode("utf-8", "surrogateescape").split("\n") if "\0" not in word]
    if not words or words[0] not in {"resolve", "info", "inspect", "evaluate", "export", "compare", "calibrate"}:
        return
    shutil.rmtree(place / "new", ignore_errors=True)

    if any(re.fullmatch(r"/+|.*/\.\.", word) for word in words):
        # such a word names all folders of this machine
        return
    with contextlib.suppress(ValueError, IndexError):
        words[words.index("-j") + 1] = "1"
    run_command(words)


def _paths(place: Path, content: bytes) -> None:
    shutil.rmtree(place / "new", ignore_errors=True)
    run_command(("resolve", "-", "-o", "new", "-j", 1, "--json"), stdin=content)
    run_command(("info", "-", "-j", 1), stdin=content)


def _of(made: Callable[[], list[bytes]]) -> Callable[[Path], list[bytes]]:
    return lambda _: made()


def _named(name: str) -> Callable[[Path], list[bytes]]:
    return lambda place: samples.file_of(place, name)


_RAW = FrameLayout((1, 2), raw=RawLayout("uint16", (2, 2, *samples.SHAPE)))

READERS = {
    reader.name: reader
    for reader in (
        Reader("tif", _of(samples.tiffs), TIFF, partial(_file, ".tif", _LAYOUT)),
        Reader("stack", _of(samples.stacks), TIFF, partial(_file, ".tif", _LAYOUT)),
        Reader("exr", _of(samples.exrs), EXR, partial(_file, ".exr", _LAYOUT)),
        Reader("npy", _of(samples.npys), NPY, partial(_file, ".npy", _LAYOUT)),
        Reader("raw", _of(samples.raws), BYTES, partial(_file, ".raw", _RAW)),
        Reader("plane-tif", _of(partial(samples.planes, ".tif")), TIFF, partial(_plane, ".tif")),
        Reader("plane-exr", _of(partial(samples.planes, ".exr")), EXR, partial(_plane, ".exr")),
        Reader("plane-png", _of(partial(samples.planes, ".png")), PNG, partial(_plane, ".png")),
        Reader("plane-npy", _of(partial(samples.planes, ".npy")), NPY, partial(_plane, ".npy")),
        Reader("map-tif", _named("out/frame_0.tif"), TIFF, partial(_maps, ".tif")),
        Reader("map-exr", _named("exr/frame_0.exr"), EXR, partial(_maps, ".exr")),
        Reader("truth", _named("truth.exr"), EXR, _truth),
        Reader("capture.toml", _of(samples.tomls), TEXT, _toml),
        *(
            Reader(name, _named(f"cal/{name}"), EXR if name.endswith(".exr") else TEXT, partial(_calibration, name))
            for name in samples.CALIBRATION_FILES
        ),
        Reader("run.json", samples.run_records, TEXT, partial(_record, "run.json")),
        Reader("frames.jsonl", _named("out/frames.jsonl"), TEXT, partial(_record, "frames.jsonl")),
        Reader("options", _of(samples.command_lines), TEXT, _options),
        Reader("stdin", _of(samples.lists_of_paths), TEXT, _paths),
    )
}
