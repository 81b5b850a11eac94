"""Calibration captures, sound ones and wrong ones: light on dark frames, objects before walls."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Float
from tests.support.campaign import ALL_DEFECTS, camera, card, covered, wall, write
from tests.support.defects import DefectiveCamera, Defects
from tests.support.run_cadtof import Finished, cadtof

SHARE = 1 / 3
"""Share of the photons that come from the laser, at ASR 2."""

VOLTS_PER_COUNT = 6e-5

Frames = list[np.ndarray]


@dataclass(frozen=True)
class Case:
    """A step of a calibration with its captures; `sound`: the step must take them, else it must refuse them."""

    step: str
    sound: bool
    record: Callable[[Path, int], tuple[Path, ...]]


def calibrated(case: Case, folder: Path, seed: int, /) -> Finished:
    """Record the captures of a case and run its step; before a response, the dark part is calibrated."""
    captures = case.record(folder, seed)
    if case.step == "response":
        dark = write(folder / "dark", _camera(seed), covered(_camera(seed), count=10, seed=seed))
        assert cadtof("calibrate", "dark", dark, "-o", folder / "camera").status == 0
    return cadtof("calibrate", case.step, *captures, "-o", folder / "camera")


def _camera(seed: int, *, offset_v: float = 0.02) -> DefectiveCamera:
    return camera(replace(ALL_DEFECTS, offset_v=offset_v, seed=seed))


def _curved(seed: int) -> DefectiveCamera:
    """A camera whose only defect is the field curvature of its lens."""
    return camera(Defects(petzval_m=(0.06, -0.02), seed=seed))


def _dark(offset_v: float, count: int) -> Callable[[Path, int], tuple[Path, ...]]:
    def record(folder: Path, seed: int) -> tuple[Path, ...]:
        camera = _camera(seed, offset_v=offset_v)
        return (write(folder / "dark_frames", camera, covered(camera, count=count, seed=seed)),)

    return record


def _patterned(kind: str) -> Callable[[Path, int], tuple[Path, ...]]:
    """Dark frames of a camera whose offsets have a pattern of 5 mV beside their own 2 mV."""

    def record(folder: Path, seed: int) -> tuple[Path, ...]:
        camera, rng = _camera(seed, offset_v=0.002), np.random.default_rng([seed, 77])
        height, width = camera.pixels
        y, x = np.mgrid[:height, :width] / height - 0.5
        patterns = {
            "columns": rng.standard_normal((2, 2, 1, width)),
            "columns alike": rng.standard_normal((1, 2, 1, width)),
            "pixels alike": rng.standard_normal((1, 1, height, width)),
            "gradients": rng.standard_normal((2, 2, 1, 1)) * x + rng.standard_normal((2, 2, 1, 1)) * y,
            "common": rng.standard_normal((2, 2, 1, 1)) + np.zeros((2, 2, height, width)),
        }
        counts = np.rint(0.005 / VOLTS_PER_COUNT * patterns[kind])
        frames = [(frame + counts).astype(np.uint16) for frame in covered(camera, count=10, seed=seed)]
        return (write(folder / "dark_frames", camera, frames),)

    return record


def _lit(share: float, scene: str, offset_v: float) -> Callable[[Path, int], tuple[Path, ...]]:
    def record(folder: Path, seed: int) -> tuple[Path, ...]:
        camera = _camera(seed, offset_v=offset_v)
        if scene == "card":
            frames = card(camera, count=10, seed=seed)
        else:
            rng = np.random.default_rng([seed, 78])
            ranges = _shape(camera, scene, float(rng.uniform(0.8, 3.0)))
            frames = camera.frames(
                ranges[np.newaxis], share * (ranges.min() / ranges[np.newaxis]) ** 2, count=10, seed=seed
            )
        return (write(folder / "lit", camera, frames),)

    return record


def _shape(camera: DefectiveCamera, scene: str, distance_m: float) -> Float:
    """Return the ranges of a scene, (Y, X)."""
    wall_m, (height, width) = camera.wall_range_m(distance_m), camera.pixels
    if scene == "corner":
        return np.minimum(*(camera.wall_range_m(distance_m, (angle, 0.0)) for angle in (40.0, -40.0)))
    if scene == "box":
        box = np.zeros(camera.pixels)
        box[height // 3 : 2 * height // 3, width // 3 : 2 * width // 3] = 0.3
        return wall_m - box
    if scene == "curtain":
        return np.asarray(wall_m + 0.1 * np.sin(np.arange(width) / 8.0))
    angle = {"wall": 0.0, "leaning": 5.0, "tilted": 30.0}[scene]
    return camera.wall_range_m(distance_m, (angle, 0.0))


def _targets(scene: str, distances_m: tuple[float, ...]) -> Callable[[Path, int], tuple[Path, ...]]:
    def record(folder: Path, seed: int) -> tuple[Path, ...]:
        camera, captures = _camera(seed), []
        for place, distance in enumerate(distances_m):
            stated_m = distance + 0.1 * (scene == "wrong distance" and place == 0)
            if scene == "floor":
                frames = _with_floor(camera, distance, seed=100 * seed + place)
            else:
                ranges = _shape(camera, "wall" if scene == "wrong distance" else scene, distance)[np.newaxis]
                frames = camera.frames(ranges, np.full_like(ranges, SHARE), count=5, seed=100 * seed + place)
            captures.append(write(folder / f"target_{place}", camera, frames, distance_m=stated_m))
        return tuple(captures)

    return record


def _with_floor(camera: DefectiveCamera, distance_m: float, *, seed: int) -> Frames:
    """Return frames of a wall with MPI by way of a floor: up to 30 % at the lower edge, with a delay that varies."""
    ranges = camera.wall_range_m(distance_m)
    height = np.linspace(1.0, 0.0, camera.pixels[0])[:, np.newaxis]
    ratio = 0.3 * (1.0 - height) * np.ones(camera.pixels)
    extra = 0.3 + 0.5 * height + 0.2 / distance_m
    return camera.frames(
        np.stack([ranges, ranges + extra]), SHARE * np.stack([np.ones(camera.pixels), ratio]), count=5, seed=seed
    )


def _walls(scene: str, distances_m: tuple[float, ...]) -> Callable[[Path, int], tuple[Path, ...]]:
    def record(folder: Path, seed: int) -> tuple[Path, ...]:
        camera, captures = _curved(seed), []
        rng = np.random.default_rng([seed, 79])
        for place, distance in enumerate(distances_m):
            if scene == "wall":
                tilt = (float(rng.uniform(-10, 10)), float(rng.uniform(-10, 10)))
                frames = wall(camera, distance, tilt_deg=tilt, count=5, seed=100 * seed + place)
            else:
                ranges = _shape(camera, scene, distance)[np.newaxis]
                frames = camera.frames(ranges, np.full_like(ranges, SHARE), count=5, seed=100 * seed + place)
            captures.append(write(folder / f"wall_{place}", camera, frames))
        return tuple(captures)

    return record


FIVE, ONE = (0.5, 1.0, 1.7, 2.4, 3.0), (1.7,)

CASES: Mapping[str, Case] = {
    "dark: offsets 0 mV, 1 frame": Case("dark", True, _dark(0.0, 1)),
    "dark: offsets ± 2 mV, 10 frames": Case("dark", True, _dark(0.002, 10)),
    "dark: offsets ± 20 mV, 10 frames": Case("dark", True, _dark(0.02, 10)),
    "dark: columns of their own": Case("dark", True, _patterned("columns")),
    "dark: columns, alike in the harmonics": Case("dark", True, _patterned("columns alike")),
    "dark: pixels, alike in harmonics and channels": Case("dark", True, _patterned("pixels alike")),
    "dark: gradients": Case("dark", True, _patterned("gradients")),
    "dark: one offset for all pixels": Case("dark", True, _patterned("common")),
    "lit: wall, offsets ± 2 mV": Case("dark", False, _lit(SHARE, "wall", 0.002)),
    "lit: wall, offsets ± 20 mV": Case("dark", False, _lit(SHARE, "wall", 0.02)),
    "lit: corner, offsets ± 20 mV": Case("dark", False, _lit(SHARE, "corner", 0.02)),
    "lit: card with MPI, offsets ± 20 mV": Case("dark", False, _lit(SHARE, "card", 0.02)),
    "lit: tilted wall, a third of that light, ± 2 mV": Case("dark", False, _lit(SHARE / 3, "tilted", 0.002)),
    "lit: tilted wall, a tenth of that light, ± 2 mV": Case("dark", False, _lit(SHARE / 10, "tilted", 0.002)),
    "response: wall at 5 distances": Case("response", True, _targets("wall", FIVE)),
    "response: wall at 1 distance": Case("response", True, _targets("wall", ONE)),
    "response: corner at 5 distances": Case("response", False, _targets("corner", FIVE)),
    "response: corner at 1 distance": Case("response", False, _targets("corner", ONE)),
    "response: box of .3 m before the wall, 1 distance": Case("response", False, _targets("box", ONE)),
    "response: wall that leans by 5°, 5 distances": Case("response", False, _targets("leaning", FIVE)),
    "response: wall that leans by 5°, 1 distance": Case("response", False, _targets("leaning", ONE)),
    "response: MPI by way of the floor, 5 distances": Case("response", False, _targets("floor", FIVE)),
    "response: MPI by way of the floor, 1 distance": Case("response", False, _targets("floor", ONE)),
    "response: one distance wrong by .1 m of 5": Case("response", False, _targets("wrong distance", FIVE)),
    "petzval: two walls, tilted up to 10°": Case("petzval", True, _walls("wall", (1.0, 3.0))),
    "petzval: wall with a box in view": Case("petzval", True, _walls("box", (2.0,))),
    "petzval: corner": Case("petzval", False, _walls("corner", (2.0,))),
    "petzval: curtain": Case("petzval", False, _walls("curtain", (2.0,))),
}
"""Captures that must be taken, and captures that must be refused."""
