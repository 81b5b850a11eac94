"""Take the pictures of docs/report.md: the page of a run in a browser, on a wide screen, on a phone, and in comparison."""

import argparse
import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from tests.support.browser import Browser, opened_browser

ROOT = Path(__file__).resolve().parent.parent

DOCS = ROOT / "docs"


def main() -> None:
    """Record captures with a broken frame, resolve them, write their pages, and take the pictures."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        corner = recorded_page(Path(temporary) / "corner", "corner", "auto")
        card = recorded_page(Path(temporary) / "card", "card", "discrete")
        with opened_browser(Path(temporary) / "profile") as browser:
            wide(browser, corner)
            compared(browser, card)
            phone(browser, corner)


def recorded_page(folder: Path, scene: str, mpi_model: str) -> Path:
    """Record a scene with one broken frame, resolve it, and return the page of the run."""
    folder.mkdir()
    settings = ("--frames", "12", "--seed", "4", "--integration-length", "4e5")
    cadtof(folder, "simulate", "--scene", scene, *settings, "-o", "monday", "-q")
    broken = folder / "monday" / "frame_0007.tif"
    broken.write_bytes(broken.read_bytes()[:1000])
    cadtof(folder, "resolve", "monday", "-o", "maps", "-q", "--mpi-model", mpi_model, status=1)
    cadtof(folder, "report", "maps", "-o", "report.html", "--truth", "monday/truth.exr")
    return folder / "report.html"


def cadtof(folder: Path, *arguments: str, status: int = 0) -> None:
    """Run `cadtof` in a folder, and end this script if `cadtof` does not end with the expected status."""
    command = [sys.executable, "-m", "cadtof_cli", *arguments]
    done = subprocess.run(command, check=False, capture_output=True, cwd=folder)
    if done.returncode != status:
        raise SystemExit(done.stderr.decode())


def wide(browser: Browser, page: Path) -> None:
    """Take a wide screen with the light style: totals, failures, frames and viewer."""
    browser.open(page, width=1280, height=1500)
    browser.point("#map", (0.3, 0.35), (0.7, 0.6), drag=True)
    browser.point("h1", (0.5, 0.5))
    browser.run("scrollTo(0, 0)")
    taken(browser, "report_wide.png")


def compared(browser: Browser, page: Path) -> None:
    """Take a wide screen with the dark style: first phasor beside the resolved depth, one status bit over both, the
    profile."""
    browser.open(page, width=1280, height=1240, dark=True)
    browser.click("#compare")
    browser.click("#overlays input")
    browser.point("#map", (0.1, 0.75), (0.9, 0.7), drag=True)
    browser.run("document.querySelector('#viewer').scrollIntoView()")
    taken(browser, "report_compare.png")


def phone(browser: Browser, page: Path) -> None:
    """Take a phone with the dark style: the viewer."""
    browser.open(page, width=390, height=1000, dark=True)
    browser.run("document.querySelector('#viewer').scrollIntoView()")
    taken(browser, "report_phone.png")


def taken(browser: Browser, name: str) -> None:
    """Save a screenshot as a file of docs."""
    browser.settle()
    with Image.open(io.BytesIO(browser.driver.get_screenshot_as_png())) as picture:
        picture.convert("RGB").save(DOCS / name, optimize=True)
    print(DOCS / name)


if __name__ == "__main__":
    main()
