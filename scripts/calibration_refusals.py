"""Count how many sound and how many unsound calibration captures are refused. Each seed is another camera."""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.support.wrong_targets import CASES, calibrated


def main() -> int:
    """Print a table of counts; return 1 if a sound capture was refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1000, help="first seed: thresholds were set on seeds below 100")
    arguments = parser.parse_args()
    wrong = 0
    print("| captures | should be | refused |\n|---|---|---|")
    for title, case in CASES.items():
        refused = 0
        for seed in range(arguments.first, arguments.first + arguments.seeds):
            with tempfile.TemporaryDirectory() as folder:
                refused += calibrated(case, Path(folder), seed).status == 2
        wrong += refused * case.sound
        print(f"| {title} | {'taken' if case.sound else 'refused'} | {refused} of {arguments.seeds} |", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
