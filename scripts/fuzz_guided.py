"""Run one reader with inputs from libFuzzer, which keeps those that reach new code. Needs atheris.

`scripts/fuzz --guided` starts it:

    python scripts/fuzz_guided.py READER SECONDS FOLDER

FOLDER gets the inputs that libFuzzer keeps, and the inputs that fail, named by how they fail (crash-…, timeout-…,
oom-…).
"""

import contextlib
import os
import random
import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["cadtof_cli", "tifffile"], enable_loader_override=False):
    from cadtof_cli.errors import CadtofError
    from tests.support.fuzz.campaign import MOST_BYTES, MOST_SECONDS, sound_place
    from tests.support.fuzz.readers import READERS, Reader
    from tests.support.fuzz.spoil import spoiled

MOST_LENGTH = 2**17

GENERAL_SHARE = 0.3
"""Share of inputs that libFuzzer changes by its own methods; the others are changed by ours."""


def run(name: str, seconds: int, folder: Path) -> None:
    """Give inputs to the reader until the time is over."""
    reader = READERS[name]
    kept = folder / "kept"
    kept.mkdir(parents=True, exist_ok=True)
    # libFuzzer ends the process here, so this folder is not removed: the system has to clear it away
    with sound_place() as place:
        os.chdir(place)
        for number, sample in enumerate(reader.samples(place)):
            (kept / f"sample-{number}").write_bytes(sample)
        _fuzz(reader, place, seconds, folder)


def _fuzz(reader: Reader, place: Path, seconds: int, folder: Path) -> None:
    def read(content: bytes) -> None:
        with contextlib.suppress(CadtofError):
            reader.read(place, content or b"\0")

    def changed(content: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < GENERAL_SHARE:
            return bytes(atheris.Mutate(content, most))
        return spoiled(content or b"\0", reader.ways, rng)[:most]

    options = [
        f"-max_total_time={seconds}",
        f"-timeout={MOST_SECONDS:.0f}",
        f"-rss_limit_mb={MOST_BYTES // 2**20}",
        f"-max_len={MOST_LENGTH}",
        f"-artifact_prefix={folder}/",
        "-print_final_stats=1",
    ]
    atheris.Setup(["fuzz", *options, str(folder / "kept")], read, custom_mutator=changed)
    atheris.Fuzz()


if __name__ == "__main__":
    run(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]).absolute())
