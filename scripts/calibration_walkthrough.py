"""Calibrate a simulated QVGA camera with all defects at once, and write docs/calibration.md from the results."""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from string import Template

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.calibration.store import load_calibration
from cadtof_cli.capture.metadata import Waveform
from cadtof_cli.files.layers import read_layers, write_layers
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.resolver.status import StatusBit
from tests.support import campaign
from tests.support.campaign import ALL_DEFECTS, CARD_M, TARGETS_M, covered, wall, write
from tests.support.defects import DefectiveCamera, Defects

ROOT = Path(__file__).resolve().parent.parent
PIXELS = (240, 320)
DEFECTS = replace(ALL_DEFECTS, hot_share=0.001, phase_rad=(0.0, 0.3))
CLEAN_ROWS = 40


@dataclass
class Diary:
    """The folder in which the commands run. Each command is printed with its output, unless the diary is `quiet`."""

    place: Path
    quiet: bool = False

    def run(self, *arguments: str) -> str:
        """Run `cadtof`, and return the command with its output as the page shows them."""
        done = subprocess.run(
            [sys.executable, "-m", "cadtof_cli", *arguments],
            cwd=self.place,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            sys.exit(f"cadtof {' '.join(arguments)}: {done.stderr}")
        lines = [f"$ cadtof {' '.join(arguments)}", *done.stderr.splitlines(), *done.stdout.splitlines()]
        if not self.quiet:
            print("\n".join(lines), flush=True)
        return "\n".join(f"    {line}".rstrip() for line in lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of the page and its pictures")
    parser.add_argument(
        "--keep", type=Path, metavar="DIR", help="only record the captures of the page, into this new folder"
    )
    parser.add_argument("--cost", action="store_true", help="only print what applying the calibration costs")
    arguments = parser.parse_args()
    out: Path = arguments.out
    if arguments.keep is not None:
        arguments.keep.mkdir(parents=True)
        record(arguments.keep, camera())
        print(f"{arguments.keep}: {', '.join(sorted(folder.name for folder in arguments.keep.iterdir()))}")
        return
    if arguments.cost:
        with tempfile.TemporaryDirectory() as place, tempfile.TemporaryDirectory() as pictures:
            diary = Diary(Path(place), quiet=True)
            walk(diary, Path(pictures))
            print(f"  resolve with every calibration over without, one core (asked: 2.5 at most): {cost(diary):.2f}")
            print(f"  triangle waves over the same frames taken for sines, one core: {triangle_cost(diary):.1f}")
        return
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        diary = Diary(Path(place))
        said = walk(diary, out)
        said |= numbers(diary)
    template = Template((Path(__file__).with_name("calibration_page.md")).read_text(encoding="utf-8"))
    (out / "calibration.md").write_text(template.substitute(said), encoding="utf-8")
    print(f"page: {out / 'calibration.md'}")


def walk(diary: Diary, out: Path) -> dict[str, str]:
    seen = camera()
    record(diary.place, seen)
    said = {
        "dark": diary.run("calibrate", "dark", "covered", "-o", "camera"),
        "response": diary.run("calibrate", "response", *(f"target_{d}m" for d in TARGETS_M), "-o", "camera"),
        "petzval": diary.run("calibrate", "petzval", "wall_1m", "wall_3m", "-o", "camera", "--plot", "walls.png"),
        "before": diary.run("resolve", "card", "-o", "before"),
        "after": diary.run("resolve", "card", "-o", "after", "--calibration", "camera"),
        "evaluate_before": diary.run("evaluate", "before", "--truth", "card/truth.exr"),
        "evaluate_after": diary.run("evaluate", "after", "--truth", "card/truth.exr"),
    }
    diary.run("preview", "before", "--frame", "0", "-o", "before.png", "--truth", "card/truth.exr")
    diary.run("preview", "after", "--frame", "0", "-o", "after.png", "--truth", "card/truth.exr")
    for name in ("walls", "before", "after"):
        (out / f"calibration_{name}.png").write_bytes((diary.place / f"{name}.png").read_bytes())
    said["petzval_toml"] = "\n".join(
        f"    {line}".rstrip() for line in (diary.place / "camera/petzval.toml").read_text().splitlines()
    )
    return said


def numbers(diary: Diary) -> dict[str, str]:
    """Return the numbers of the page's tables, by their names in the template."""
    calibration = load_calibration(diary.place / "camera")
    petzval, dark = calibration.petzval, calibration.dark
    assert petzval is not None
    assert dark is not None
    truth = camera().drawn().offset_v
    sound = ~dark.hot
    off = np.abs(dark.offset_v - truth)[..., sound] / np.maximum(dark.noise_v[..., sound] / np.sqrt(20), 1e-12)
    bias, after = card_bias(diary, "before"), card_bias(diary, "after")
    single, two, converged = triangle(diary)
    return {
        "k2": f"{petzval.curvature.k2_m:.4f} ± {petzval.curvature.k2_stderr_m:.4f}",
        "k4": f"{petzval.curvature.k4_m:.4f} ± {petzval.curvature.k4_stderr_m:.4f}",
        "k2_off": f"{abs(petzval.curvature.k2_m - 0.06) / petzval.curvature.k2_stderr_m:.1f}",
        "k4_off": f"{abs(petzval.curvature.k4_m + 0.02) / petzval.curvature.k4_stderr_m:.1f}",
        "flatness": f"{flatness(diary):.3f}",
        "dark_within": f"{np.mean(off <= 3.0):.2%}",
        "bias_before": f"{bias:.2f}",
        "bias_after": f"{after:.3f}",
        "triangle_single": f"{single:.3f}",
        "triangle_two": f"{two:.3f}",
        "triangle_converged": f"{converged:.2%}",
        "cost": f"{cost(diary):.2f}",
        "triangle_cost": f"{triangle_cost(diary):.1f}",
    }


def flatness(diary: Diary) -> float:
    """Return the RMS error of frames of a wall that was not fitted, divided by the RMS of their noise from frame to frame."""
    seen = camera()
    truth = seen.wall_range_m(2.0, (2.0, 1.0))
    write(diary.place / "fresh", seen, wall(seen, 2.0, tilt_deg=(2.0, 1.0), count=10, seed=90))
    diary.run("resolve", "fresh", "-o", "fresh_maps", "--calibration", "camera", "--order", "1", "-q")
    maps = sorted((diary.place / "fresh_maps").glob("*.tif"))
    error = np.stack([read_layers(path)[DIRECT_DEPTH] - truth for path in maps])
    noise = error.std(axis=0, ddof=1)
    return float(np.sqrt(np.nanmean(error**2) / np.nanmean(noise**2)))


def card_bias(diary: Diary, maps: str) -> float:
    """Return the median error of the direct depth on the card below its clean rows, in cm."""
    truth = read_layers(diary.place / "card/truth.exr")[DIRECT_DEPTH]
    errors = [read_layers(p)[DIRECT_DEPTH] - truth for p in sorted((diary.place / maps).glob("*.tif"))]
    body = np.stack(errors)[:, CLEAN_ROWS:]
    return float(100 * np.nanmedian(body))


def triangle(diary: Diary) -> tuple[float, float, float]:
    """Return the bias of one and of two paths under triangle modulation, in cm, and the share of pixels that converge."""
    seen = replace(camera("triangle"), defects=Defects())
    write(diary.place / "triangle", seen, card(seen, count=4, seed=5, separations_ns=(6.0, 20.0)))
    diary.run("resolve", "triangle", "-o", "triangle_maps", "-q")
    errors, kept = [], []
    for path in sorted((diary.place / "triangle_maps").glob("*.tif")):
        layers = read_layers(path)
        bounded = layers["direct.sigma"] < 0.1
        status = layers["status"].astype(np.uint32)
        kept.append((status[bounded] & StatusBit.NOT_CONVERGED) == 0)
        errors.append(100 * (layers[DIRECT_DEPTH].astype(np.float64) - CARD_M))
    error = np.stack(errors)
    return (
        float(abs(np.nanmedian(error[:, :CLEAN_ROWS]))),
        float(abs(np.nanmedian(error[:, CLEAN_ROWS:]))),
        float(np.mean(np.concatenate(kept))),
    )


def cost(diary: Diary) -> float:
    """Return the time of `resolve` with the calibration divided by the time without."""
    write(diary.place / "many", camera(), card(camera(), count=30, seed=8))
    return time_ratio(diary, "many", ("--calibration", "camera"), ())


def triangle_cost(diary: Diary) -> float:
    """Return the time of resolving frames as triangle waves divided by the time of the same frames as sines."""
    seen = replace(camera("triangle"), defects=Defects())
    write(diary.place / "triangles", seen, card(seen, count=30, seed=9))
    return time_ratio(diary, "triangles", ("--waveform", "triangle"), ("--waveform", "sine"))


def time_ratio(diary: Diary, capture: str, options: Sequence[str], reference: Sequence[str]) -> float:
    """Return the time of `resolve` with options divided by that with others, the best of three runs each, on one core."""
    times: list[list[float]] = [[], []]
    for _ in range(3):
        for number, words in enumerate((options, reference)):
            began = time.perf_counter()
            diary.run("resolve", capture, "-o", f"{capture}_maps{number}", "--overwrite", "-q", "-j", "1", *words)
            times[number].append(time.perf_counter() - began)
    return min(times[0]) / min(times[1])


def camera(waveform: Waveform = "sine") -> DefectiveCamera:
    return campaign.camera(DEFECTS, waveform=waveform, pixels=PIXELS)


def record(place: Path, seen: DefectiveCamera) -> None:
    write(place / "covered", seen, covered(seen, count=20))
    for index, distance in enumerate(TARGETS_M):
        frames = wall(seen, distance, count=10, seed=10 + index)
        write(place / f"target_{distance}m", seen, frames, distance_m=distance)
    write(place / "wall_1m", seen, wall(seen, 1.0, tilt_deg=(3.0, -2.0), count=10, seed=20))
    write(place / "wall_3m", seen, wall(seen, 3.0, tilt_deg=(-2.0, 4.0), count=10, seed=21))
    write(place / "card", seen, card(seen, count=4, seed=30))
    write_layers(place / "card/truth.exr", {DIRECT_DEPTH: np.full(PIXELS, CARD_M, np.float32)})


def card(
    seen: DefectiveCamera, *, count: int, seed: int, separations_ns: tuple[float, float] = (3.0, 20.0)
) -> list[NDArray[np.uint16]]:
    return campaign.card(seen, count=count, seed=seed, separations_ns=separations_ns, weakest=0.05)


if __name__ == "__main__":
    main()
