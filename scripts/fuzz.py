"""Give damaged input to every reader: frames, planes, maps, truth, settings, calibrations, records, options, stdin.

    scripts/fuzz [--for SECONDS] [--inputs N] [--first N] [--readers NAME,…] [--jobs N]
    scripts/fuzz --repeat READER:NUMBER
    scripts/fuzz --guided [--for SECONDS] [--readers NAME,…]

An input is a sound sample, damaged by code that knows its structure; the number of an input is enough to make it again.
A child process with limits reads it. An input fails if its reader takes over 5 s or over 512 MB, crashes, raises
anything but a CadtofError, says "unexpected", or prints something. Every failure is reported with the number of the
input, and the exit status is then 1. `--repeat` writes an input into the current folder, and reads it in this process.

With `--guided`, libFuzzer chooses which inputs to damage further, by the code that they reach. This needs atheris (`pip
install atheris`). Inputs that fail are kept in fuzz-READER in the current folder.
"""

import argparse
import contextlib
import importlib.util
import re
import subprocess
import sys
import time
from pathlib import Path

from cadtof_cli.errors import CadtofError
from tests.support.fuzz.campaign import Tally, input_of, run_campaign, sound_place
from tests.support.fuzz.readers import READERS

INPUTS = 50_000

GUIDED_S = 600.0


def repeat(reader: str, number: int) -> int:
    """Write one input into the current folder, and read it in this process."""
    with sound_place() as place:
        content = input_of(READERS[reader], number, place)
        kept = Path.cwd() / f"{number}-{reader}"
        kept.write_bytes(content)
        print(f"{kept}: {len(content):,} bytes")
        with contextlib.chdir(place):
            try:
                READERS[reader].read(place, content)
            except CadtofError as error:
                print(f"refused: {error}")
    return 0


def summary(tally: Tally, seconds: float) -> str:
    """Return the numbers of a campaign as text."""
    by_reader = ", ".join(f"{name} {count:,}" for name, count in sorted(tally.inputs.items()))
    found = ", ".join(f"{tally.count(kind)} {kind}" for kind in ("hang", "crash", "exception", "output", "memory"))
    return (
        f"{by_reader}\n{tally.total:,} inputs in {seconds:.0f} s, at most {tally.longest_s:.2f} s ({tally.longest}) and "
        f"{tally.peak_bytes / 2**20:.0f} MB each; found: {found}"
    )


def guided(readers: list[str], seconds: float) -> int:
    """Let libFuzzer choose the inputs, for one reader after the other; return the exit status."""
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed: pip install atheris", file=sys.stderr)
        return 2
    found = 0
    for name in readers:
        folder = Path(f"fuzz-{name}").absolute()
        script = Path(__file__).with_name("fuzz_guided.py")
        command = [sys.executable, str(script), name, str(max(int(seconds / len(readers)), 1)), str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, errors="backslashreplace", check=False)
        inputs = re.search(r"stat::number_of_executed_units: *(\d+)", done.stderr)
        lines = re.findall(r"cov: (\d+)", done.stderr)
        print(
            f"{name}: {inputs[1] if inputs else 0} inputs, {lines[-1] if lines else 0} places of the code", flush=True
        )
        if done.returncode:
            found += 1
            print(done.stderr[-3000:], flush=True)
    return 1 if found else 0


def run() -> int:
    """Run the campaign that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--for", dest="seconds", type=float, metavar="SECONDS", help="read inputs for this time")
    parser.add_argument("--inputs", type=int, metavar="N", help=f"number of inputs (default: {INPUTS:,})")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first input of each reader")
    parser.add_argument("--readers", default=",".join(READERS), metavar="NAME,…")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="number of child processes at once")
    parser.add_argument("--repeat", metavar="READER:NUMBER")
    parser.add_argument("--guided", action="store_true", help="let libFuzzer choose the inputs; needs atheris")
    options = parser.parse_args()
    if options.repeat:
        reader, _, number = options.repeat.rpartition(":")
        if reader not in READERS or not number.isdecimal():
            parser.error(f"--repeat: found {options.repeat}, expected READER:NUMBER with one of {', '.join(READERS)}")
        return repeat(reader, int(number))
    if unknown := set(options.readers.split(",")).difference(READERS):
        parser.error(f"--readers: found {', '.join(sorted(unknown))}, expected some of {', '.join(READERS)}")
    if options.guided:
        return guided(options.readers.split(","), options.seconds or GUIDED_S)
    began = time.monotonic()
    inputs = options.inputs or (INPUTS if options.seconds is None else 10**9)
    with sound_place() as place:
        tally = run_campaign(
            options.readers.split(","),
            place,
            inputs=inputs,
            first=options.first,
            seconds=options.seconds,
            jobs=options.jobs,
            say=lambda line: print(line, flush=True),
        )
    print(summary(tally, time.monotonic() - began))
    return 1 if tally.findings else 0


if __name__ == "__main__":
    sys.exit(run())
