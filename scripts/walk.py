"""Count the files, functions and records of the package that a command meets, by tracing.

scripts/walk [resolve | petzval] [--list] runs the command on a small capture in one process, from the click command to
the written file, and traces all threads. Then it runs the command on two frames. Functions that are called more often
now are those that each further frame meets. The other functions are called once per run.

By default, the process does every run once before it is traced. With --first, the first run is traced. It also meets
what a process works out for all runs, such as the header of the first frame, what the kernel needs to know, and the
noise.
"""

import argparse
import contextlib
import io
import math
import shlex
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import tifffile

ROOT = Path(__file__).resolve().parent.parent

HEIGHT, WIDTH = 12, 20
"""Size of the traced frame; no other array of a run has as many values along its last axes."""

SETTINGS = """[voltage]
zero_counts = 8192.0
volts_per_count = 6.0e-5
saturated_counts = [0, 16383]
[pixel]
integration_length = 100000
[optics]
focal_length_px = 20.0
[target]
distance_m = 2.0
"""


WAYS = {"resolve": ["cadtof", "resolve", "-j", "1"], "petzval": ["cadtof", "calibrate", "petzval"]}

_MAKING = {"__init__", "_init"}
"""Functions that make a record: its own, or that of `cadtof_cli/records.py`."""


class Walk:
    """A profile hook.

    It notes the files and functions of the package that are called, and records that hold a value per pixel.
    """

    def __init__(self, package: Path) -> None:
        self.package = str(package)
        self.files: dict[str, None] = {}
        self.functions: Counter[str] = Counter()
        self.records: dict[str, None] = {}

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """Count one call or return."""
        code = frame.f_code
        if event == "return" and code.co_name in _MAKING:
            self._count_record(frame.f_locals.get("self"))
        if event != "call" or not code.co_filename.startswith(self.package) or code.co_name.startswith("<"):
            return
        if _is_imported(frame) or (code.co_qualname.split(".")[0] == code.co_name and _is_class_body(frame)):
            return
        file = str(Path(code.co_filename).relative_to(self.package))
        self.files[file] = None
        self.functions[f"{file}: {code.co_qualname}"] += 1

    def _count_record(self, record: object) -> None:
        if type(record).__module__.startswith("cadtof_cli") and any(map(_is_of_every_pixel, _held(record))):
            self.records[type(record).__qualname__] = None


def _is_imported(frame: FrameType) -> bool:
    """Return whether a function is called while a module is imported: such calls do not count."""
    above = frame.f_back
    while above is not None and (above.f_code.co_name != "<module>" or above.f_globals["__name__"] == "__main__"):
        above = above.f_back
    return above is not None


def _is_class_body(frame: FrameType) -> bool:
    return "__qualname__" in frame.f_locals and "__module__" in frame.f_locals


def _held(record: object) -> Iterator[object]:
    """Yield what a record holds, and what the records in it hold."""
    for value in vars(record).values() if hasattr(record, "__dict__") else ():
        yield value
        if type(value).__module__.startswith("cadtof_cli") and hasattr(value, "__dict__"):
            yield from vars(value).values()


def _is_of_every_pixel(value: object) -> bool:
    if not isinstance(value, np.ndarray) or value.ndim == 0:
        return False
    return HEIGHT * WIDTH in {value.shape[-1], math.prod(value.shape[-2:])}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "commands", nargs="*", default=["resolve", "petzval"], help="resolve or petzval [default: both]"
    )
    parser.add_argument("--list", action="store_true", help="name the functions and records that were met")
    parser.add_argument("--options", default="", help="further options for the command, such as '--mpi-model discrete'")
    parser.add_argument("--first", action="store_true", help="watch the first run of a process")
    parser.add_argument("--tree", type=Path, default=ROOT, help="another checkout to trace")
    arguments = parser.parse_args()
    if arguments.first and len(arguments.commands) > 1:
        others = [word for word in sys.argv[1:] if word not in WAYS]
        for name in arguments.commands:
            subprocess.run([sys.executable, __file__, name, *others], check=True)
        return
    sys.path.insert(0, str(arguments.tree.resolve()))
    from cadtof_cli import cli

    package = Path(cli.__file__).parent
    with tempfile.TemporaryDirectory() as place:
        one, two = (_recorded(Path(place) / f"wall{frames}", frames) for frames in (1, 2))
        for name in arguments.commands:
            words = [*WAYS[name], *shlex.split(arguments.options)]
            if arguments.first:
                _tell(
                    name, _walked([*words, str(one), "-o", f"{place}/{name}"], package, first=True), [], arguments.list
                )
                continue
            walk, longer = (
                _walked([*words, str(folder), "-o", f"{place}/{name}{folder.name}"], package) for folder in (one, two)
            )
            _tell(name, walk, sorted(longer.functions - walk.functions), arguments.list)


def _tell(name: str, walk: Walk, met: list[str], listed: bool) -> None:
    """Print what a command met, and which part of it each further frame meets."""
    told = f"{name}: {len(walk.files)} files, {len(walk.functions)} functions, {len(walk.records)} records that hold pixels"
    if met:
        told += f"; a frame meets {len({line.split(':')[0] for line in met})} files, {len(met)} functions"
    print(told)
    if listed:
        lines = [f"{'frame ' if line in met else '      '}{line}" for line in sorted(walk.functions)]
        print("\n".join(f"  {line}" for line in (*lines, *walk.records)))


def _walked(argv: list[str], package: Path, *, first: bool = False) -> Walk:
    """Trace a command line, whose last word is its OUT. It runs untraced into another folder before, unless `first` is set."""
    from cadtof_cli.cli import main as cadtof

    walk = Walk(package)
    for words in (argv,) if first else ([*argv[:-1], f"{argv[-1]}-before"], argv):
        sys.argv = words
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            watching = walk if words is argv else None
            # threads wait for the disk
            threading.setprofile(watching)
            sys.setprofile(watching)
            try:
                cadtof()
            except SystemExit as ended:
                sys.setprofile(None)
                if ended.code:
                    raise
    return walk


def _recorded(folder: Path, frames: int) -> Path:
    """Write a capture of `frames` frames: light of one delay, and noise."""
    rng = np.random.default_rng(1)
    folder.mkdir()
    (folder / "capture.toml").write_text(SETTINGS)
    phase = 2.0 * np.pi * 2.0 * 2.0 / 0.299792458 / 40.0
    planes = [wave(h * phase) for h in (1, 2) for wave in (np.cos, np.sin)]
    for index in range(frames):
        volts = 0.1 * np.array(planes)[:, np.newaxis, np.newaxis] + rng.normal(scale=0.0004, size=(4, HEIGHT, WIDTH))
        frame = np.rint(volts / 6.0e-5 + 8192.0).astype(np.uint16)
        tifffile.imwrite(folder / f"frame{index}.tif", frame, photometric="minisblack", metadata=None)
    return folder


if __name__ == "__main__":
    main()
