"""Compare the maps of two checkouts bit by bit: of every capture, by every solver, with and without calibration."""

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent

Layers = dict[str, NDArray[Any]]

RESOLVE: dict[str, str] = {
    "default": "",
    "one-path": "--solver one-path",
    "lm": "--solver lm --jobs 2",
    "lm-order-2": "--solver lm --order 2 --starts 3 --seed 5 --jobs 1",
    "order-1": "--order 1",
    "order-2": "--order 2 --format exr",
    "strongest": "--return strongest --false-alarm 0.001",
    "last": "--return last --min-return-ratio 0.3 --jobs 3",
    "min-confidence": "--min-confidence 0.02",
    "z": "--depth z --focal-length-px 280",
    "pool": "--pool 3 --jobs 1",
    "pool-split": "--pool 5 --solver lm --starts 2 --jobs 2",
    "average": "--average 2",
    "two-jobs": "--jobs 2 --format tif",
    "spawn": "--jobs 2 --start-method spawn",
    "triangle": "--waveform triangle --jobs 1",
    "triangle-pool": "--waveform triangle --pool 3 --average 2",
    "saturated": "--saturated-counts 4000,8100",
}
"""Options of `cadtof resolve` by the name of the case, for all captures; those of three harmonics go without triangles."""

CALIBRATED: dict[str, str] = {
    "petzval-only": "--calibration petzval",
    "calibrated": "--calibration all",
    "calibrated-z-pool": "--calibration all --depth z --focal-length-px 280 --pool 3",
    "calibrated-order-2": "--calibration all --order 2 --jobs 2",
    "calibrated-lm": "--calibration dark --solver lm --starts 2",
}
"""Cases with one of the calibrations that OLD makes, for captures of two harmonics."""

MORE_HARMONICS: dict[str, str] = {"three-paths": "--paths 3", "three-paths-order-3": "--paths 3 --order 3 --jobs 2"}
"""Cases for captures of three harmonics."""

NOISE_UNKNOWN: dict[str, str] = {"noise-unknown": "", "noise-unknown-average": "--average 2 --solver lm --starts 2"}
"""Cases for a copy of the capture that does not say its integration length."""


@dataclass(frozen=True)
class Checkout:
    """A tree of the project, and further options for its `resolve`."""

    root: Path
    more: tuple[str, ...] = ()

    def run(self, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
        """Run this checkout's `cadtof` in a folder."""
        command = [sys.executable, "-m", "cadtof_cli", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(self.root), "PYTHONSAFEPATH": "1"}
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", help="folder of a checkout, or a git revision")
    parser.add_argument("new", help="folder of a checkout, or a git revision")
    parser.add_argument("--captures", nargs="*", type=Path, help="folders of captures; default: sample_data/*")
    parser.add_argument("--cases", nargs="*", help="names of cases; default: all")
    parser.add_argument("--new-options", default="", help="further options for the `resolve` of NEW")
    arguments = parser.parse_args()
    captures = arguments.captures or sorted(settings.parent for settings in ROOT.glob("sample_data/*/capture.toml"))
    different = compared = 0
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        old = Checkout(stack.enter_context(tree_of(arguments.old)))
        new = Checkout(stack.enter_context(tree_of(arguments.new)), tuple(shlex.split(arguments.new_options)))
        make_calibrations(old, place)
        for capture in (path.resolve() for path in captures):
            for name, options in cases_of(capture, arguments.cases):
                recorded = without_integration_length(capture, place) if name in NOISE_UNKNOWN else capture
                said = differences(old, new, recorded, options, place)
                compared += 1
                different += said.startswith("DIFFERENT")
                print(f"{capture.name:18}{name:24}{said}", flush=True)
    print(f"{compared - different} of {compared} cases the same, to the bit")
    return 1 if different or not compared else 0


@contextmanager
def tree_of(name: str) -> Iterator[Path]:
    """Yield the folder of a checkout; a revision is checked out into a temporary folder."""
    if Path(name).is_dir():
        if not (Path(name) / "cadtof_cli").is_dir():
            sys.exit(f"{name}: no checkout: no cadtof_cli in it")  # the installed package would run instead
        yield Path(name).resolve()
        return
    with tempfile.TemporaryDirectory() as place:
        tree = Path(place) / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(tree), name], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def cases_of(capture: Path, chosen: Sequence[str] | None) -> Iterator[tuple[str, str]]:
    """Yield names and options of a capture's cases."""
    three_harmonics = "13.3" in (capture / "capture.toml").read_text()
    cases = RESOLVE | NOISE_UNKNOWN | (MORE_HARMONICS if three_harmonics else CALIBRATED)
    if three_harmonics:  # waveforms other than a sine can be resolved with two harmonics only
        cases = {name: options for name, options in cases.items() if not name.startswith("triangle")}
    yield from ((name, options) for name, options in cases.items() if chosen is None or name in chosen)


def without_integration_length(capture: Path, place: Path) -> Path:
    """Return a copy of a capture whose capture.toml lacks the integration length; the frames are linked."""
    folder = place / "unknown" / capture.name
    if not folder.exists():
        folder.mkdir(parents=True)
        lines = (capture / "capture.toml").read_text().splitlines(keepends=True)
        kept = [line for line in lines if not line.startswith("integration_length")]
        (folder / "capture.toml").write_text("".join(kept))
        for path in capture.glob("frame*"):
            (folder / path.name).symlink_to(path)
    return folder


def differences(old: Checkout, new: Checkout, capture: Path, options: str, place: Path) -> str:
    """Return `same`, `both refuse`, or what differs between two checkouts' maps, records of frames and exit status."""
    outs = {}
    for side, checkout in (("old", old), ("new", new)):
        out = place / side
        shutil.rmtree(out, ignore_errors=True)
        words = (*shlex.split(options), *checkout.more)
        done = checkout.run("resolve", str(capture), "-o", str(out), "-q", *words, folder=place)
        outs[side] = (out, done.returncode, done.stderr.strip())
    (out_old, status_old, said_old), (out_new, status_new, said_new) = outs["old"], outs["new"]
    if status_old != status_new:
        return f"DIFFERENT: exit status {status_old} and {status_new}: {said_old} | {said_new}"
    if status_old:
        alike = said_old.replace("old/", "new/") == said_new
        return f"both refuse: {said_new}" if alike else f"DIFFERENT: {said_old} | {said_new}"
    found = different_maps(out_old, out_new)
    return f"DIFFERENT: {'; '.join(found)}" if found else "same"


def different_maps(old: Path, new: Path) -> list[str]:
    """Return what differs between two runs' maps and lines of frames."""
    found = ["frames.jsonl"] if lines_of(old) != lines_of(new) else []
    names = [sorted(path.name for path in out.iterdir() if path.suffix in {".tif", ".exr"}) for out in (old, new)]
    if names[0] != names[1] or not names[0]:
        return [*found, f"files {names[0]} and {names[1]}"]
    for name in names[0]:
        found += different_layers(name, layers_of(old / name), layers_of(new / name))
    return found


def different_layers(name: str, old: Layers, new: Layers) -> list[str]:
    """Return which layers of a map are not the same bits."""
    if list(old) != list(new):
        return [f"{name}: layers {', '.join(old)} and {', '.join(new)}"]
    found = []
    for layer, values in old.items():
        other = new[layer]
        if values.shape != other.shape or values.dtype != other.dtype:
            found.append(f"{name} {layer}: {values.shape} {values.dtype} and {other.shape} {other.dtype}")
        elif values.tobytes() != other.tobytes():
            count = int(np.count_nonzero(values.view(np.uint32) != other.view(np.uint32)))
            found.append(f"{name} {layer}: {count} pixels")
    return found


def lines_of(out: Path) -> list[dict[str, Any]]:
    """Return the lines of a run's frames.jsonl, without times and places."""
    lines = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
    kept = ("source", "status", "reason", "one_path", "two_paths", "more_paths", "invalid")
    return [{name: line.get(name) for name in kept} for line in lines]


def layers_of(path: Path) -> Layers:
    """Return the layers of a map by name, read by the libraries and not by cadtof."""
    if path.suffix == ".exr":
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: channel.pixels.copy() for name, channel in file.channels().items()}
    with tifffile.TiffFile(path) as tiff:
        document = tifffile.xml2dict(tiff.ome_metadata or "")
        channels = document["OME"]["Image"]["Pixels"]["Channel"]
        return {channel["Name"]: page.asarray() for channel, page in zip(channels, tiff.pages, strict=True)}


def make_calibrations(old: Checkout, place: Path) -> None:
    """Let OLD measure the calibrations of a camera with offsets, delays and field curvature: dark, petzval and all three."""

    def cadtof(*arguments: str) -> None:
        done = old.run(*arguments, folder=place)
        if done.returncode:
            raise SystemExit(f"{' '.join(arguments)}: {done.stderr}")

    camera = ("--petzval", "0.06,-0.02", "--frames", "3")
    for index, distance in enumerate(("1.2", "2.1", "3.3", "4.6")):
        wall = ("simulate", "--scene", "wall", "--distance", distance, "--seed", str(index), *camera)
        cadtof(*wall, "-o", f"wall{index}")
    write_dark_frames(place / "covered", place / "wall0" / "capture.toml")
    walls = [f"wall{index}" for index in range(4)]
    for folder in ("dark", "all"):
        cadtof("calibrate", "dark", "covered", "-o", folder)
    cadtof("calibrate", "response", *walls, "-o", "all")
    cadtof("calibrate", "petzval", *walls, "-o", "all")
    cadtof("calibrate", "petzval", *walls[:2], "-o", "petzval")


def write_dark_frames(folder: Path, settings: Path) -> None:
    """Write covered-lens frames: an offset to each pixel, a little noise, and three hot pixels."""
    rng = np.random.default_rng(7)
    folder.mkdir()
    (folder / "capture.toml").write_text(settings.read_text())
    offsets = 8192.0 + rng.normal(scale=9.0, size=(4, 240, 320))
    offsets[:, [5, 100, 200], [7, 150, 300]] += 900.0
    for index in range(4):
        frame = np.rint(offsets + rng.normal(scale=7.0, size=offsets.shape)).astype(np.uint16)
        tifffile.imwrite(folder / f"dark_{index}.tif", frame, photometric="minisblack", metadata=None)


if __name__ == "__main__":
    sys.exit(main())
