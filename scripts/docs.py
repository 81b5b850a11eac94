"""Build the documentation site: warnings are errors, and every link within it is checked. See `scripts/docs --help`."""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from docs_site.links import broken_links
from docs_site.stage import ROOT, stage


def main() -> None:
    """Build the site, or print the problems that were found."""
    parser = argparse.ArgumentParser(prog="scripts/docs", description=__doc__)
    parser.add_argument(
        "out",
        nargs="?",
        type=Path,
        default=ROOT / "out" / "site",
        help="folder of the site; an existing one is replaced",
    )
    out: Path = parser.parse_args().out
    problems = build(out)
    print("\n".join(problems) if problems else f"site: {out / 'index.html'}")
    sys.exit(1 if problems else 0)


def build(out: Path, /) -> list[str]:
    """Build the site into a folder, which is replaced; return the problems that were found."""
    with tempfile.TemporaryDirectory() as place:
        stage(Path(place) / "pages")
        site = Path(place) / "site"
        command = [
            sys.executable,
            "-m",
            "sphinx",
            "-q",
            "-W",
            "--keep-going",
            "-b",
            "html",
            f"{place}/pages",
            str(site),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return done.stderr.replace(f"{place}/", "").splitlines()
        shutil.rmtree(site / ".doctrees", ignore_errors=True)
        problems = list(broken_links(site))
        if out.exists():
            shutil.rmtree(out)
        out.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(site, out)
    return problems


if __name__ == "__main__":
    main()
