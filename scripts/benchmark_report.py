"""Measure the page of a run of many QVGA frames: its size, the time to write it, and the time until a browser shows it."""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.support.browser import Browser, opened_browser

ASKED_MB, ASKED_S = 30.0, 2.0

ASKED_FRAMES = 500


def main() -> int:
    """Print a table; return 1 if the page is larger, or opens more slowly, than asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=ASKED_FRAMES)
    parser.add_argument("--repeats", type=int, default=5, help="how often the page is opened; the median counts")
    parser.add_argument("--keep", type=Path, help="folder for capture, maps and page [default: a temporary one]")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        page = folder / "report.html"
        seconds = written_page(folder, page, arguments.frames)
        with opened_browser(Path(temporary) / "profile") as browser:
            opened = [opening_seconds(browser, page) for _ in range(arguments.repeats)]
        size_mb, median = page.stat().st_size / 1e6, statistics.median(opened)
    print(f"frames                    {arguments.frames:8}")
    print(f"written in, s             {seconds:8.1f}")
    print(f"size, MB                  {size_mb:8.1f}   asked: below {ASKED_MB:g}")
    print(
        f"opens in, s (median)      {median:8.2f}   asked: below {ASKED_S:g}   all: {', '.join(f'{one:.2f}' for one in opened)}"
    )
    return int(size_mb >= ASKED_MB or median >= ASKED_S)


def written_page(folder: Path, page: Path, frames: int) -> float:
    """Record and resolve a capture unless that is done already, and write its report; return how long the report
    took, in s."""
    capture, out = folder / "capture", folder / "out"
    if not out.exists():
        cadtof("simulate", "--scene", "corner", "--frames", str(frames), "-o", str(capture), "-q")
        cadtof("resolve", str(capture), "-o", str(out), "-q", "--mpi-model", "discrete")
    begun = time.perf_counter()
    cadtof("report", str(out), "-o", str(page), "--truth", str(capture / "truth.exr"), "--overwrite")
    return time.perf_counter() - begun


def cadtof(*arguments: str) -> None:
    """Run `cadtof`."""
    subprocess.run([sys.executable, "-m", "cadtof_cli", *arguments], check=True, stdout=subprocess.DEVNULL)


def opening_seconds(browser: Browser, page: Path) -> float:
    """Return the time from the start of the navigation until the viewer shows the first frame, in s."""
    browser.driver.get("about:blank")
    browser.open(page)
    return int(browser.run("return document.documentElement.dataset.ready")) / 1000.0


if __name__ == "__main__":
    sys.exit(main())
