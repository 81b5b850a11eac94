"""Measure the limits of the resolver, and write the pages, tables and figures of docs/limits."""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

from limits.false_alarm import false_alarm
from limits.light import light
from limits.motion import motion
from limits.separation import separation
from limits.stages import RIPPLES_HZ, stages

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Run the parts asked for."""
    parts: dict[str, Callable[[Path, bool], str]] = {
        "separation": lambda out, quick: separation(out, pixels=25 if quick else 200),
        "false_alarm": lambda out, quick: false_alarm(out, pixels=500 if quick else 20_000),
        "stages": lambda out, quick: stages(out, frequencies=RIPPLES_HZ[::5] if quick else RIPPLES_HZ),
        "light": lambda out, quick: light(out, rows=60 if quick else 120),
        "motion": lambda out, quick: motion(out, runs=20 if quick else 400),
    }
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"which of {', '.join(parts)} [default: all]")
    parser.add_argument("--quick", action="store_true", help="few pixels; noisier numbers, into out/limits")
    parser.add_argument("--out", type=Path, help="folder [default: docs/limits; --quick: out/limits]")
    arguments = parser.parse_args()
    out = arguments.out or ROOT / ("out/limits" if arguments.quick else "docs/limits")
    out.mkdir(parents=True, exist_ok=True)
    for name in arguments.parts or parts:
        if name not in parts:
            parser.error(f"parts: found {name!r}, expected some of {', '.join(parts)}")
        begun = time.perf_counter()
        (out / f"{name}.md").write_text(parts[name](out, arguments.quick), encoding="utf-8")
        print(f"{name}: {time.perf_counter() - begun:.1f} s", flush=True)


if __name__ == "__main__":
    main()
