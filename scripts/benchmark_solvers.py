"""Measure every solver against the Cramér–Rao bound, scipy and the closed form, and print the tables of docs/solvers.md."""

import argparse
from collections.abc import Callable

from solvers.bound import harmonics, paths
from solvers.lm import lm, starts
from solvers.pooling import pooling
from solvers.speed import speed
from solvers.triangles import triangles

from cadtof_cli.execution.memory import keep_freed_memory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "parts", nargs="*", help="which of lm, starts, harmonics, paths, triangles, pooling, speed [default: all]"
    )
    parser.add_argument("--pixels", type=int, default=4000, help="pixels drawn for each row of the accuracy tables")
    parser.add_argument("--scipy-pixels", type=int, default=4000, help="pixels that scipy solves as well, 2 ms each")
    parser.add_argument(
        "--repeats", type=int, default=5, help="number of runs of every timed frame; the fastest counts"
    )
    arguments = parser.parse_args()
    keep_freed_memory()
    parts: dict[str, Callable[[], None]] = {
        "lm": lambda: lm(arguments.scipy_pixels),
        "starts": lambda: starts(arguments.pixels),
        "harmonics": lambda: harmonics(arguments.pixels),
        "paths": lambda: paths(arguments.pixels),
        "triangles": triangles,
        "pooling": pooling,
        "speed": lambda: speed(arguments.repeats),
    }
    for name in arguments.parts or parts:
        if name not in parts:
            parser.error(f"parts: found {name!r}, expected some of {', '.join(parts)}")
        parts[name]()


if __name__ == "__main__":
    main()
