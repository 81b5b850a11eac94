"""Measure which frames with two true paths in every pixel `--mpi-model auto` takes for tails, and what that costs.

`python scripts/second_paths.py FRAMES` resolves one of these sets of frames:

    cards                   292 frames of the scenes `card` and `inter-reflection`
    panels --seed 98000     192 frames of `inter-reflection`
    drawn --seed 95000      324 frames of panes, patterns, steps and mirrors, whose geometry is drawn
    changing --seed 96500   180 frames whose second paths change from pixel to pixel or from block to block
    smooth --seed 94000     180 frames whose second paths change smoothly, share and delay on their own
    corners --seed 99200    240 frames of the opposite kind: corners that fill the view, whose MPI is a short tail

It prints a row per kind of scene: the number of frames, the number of those that are taken for tails, and, over the
latter, the medians of the frames' median errors in cm, as taken and by two paths. If a frame is not taken for a tail,
its maps must equal those of `--mpi-model discrete` to the bit; the script fails if they do not.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from with_truth import resolved, with_length

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.resolver.settings import MpiModel
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure
from cadtof_cli.simulation.scene.light import Light, Scene
from cadtof_cli.simulation.scene.scenes import Card, Corner, InterReflection
from cadtof_cli.units import C_M_PER_NS
from cadtof_cli.workflows.simulate.record import expose

PERIODS_NS = (40.0, 20.0, 40.0 / 3.0, 10.0)

LENGTHS = {
    "cards": (2e3, 1e5, 1e6),
    "panels": (1e4, 1e5, 1e6),
    "drawn": (3e3, 5e4, 5e5),
    "corners": (2e3, 1e4, 1e5, 1e6),
    "changing": (1e4, 1e5, 1e6),
    "smooth": (1e4, 1e5, 1e6),
}
"""Integration lengths of two harmonics by set of frames; other numbers of harmonics share the same light."""

KINDS = ("pane", "pane, pattern", "same delay", "slanted", "steps", "ball", "part", "from the side", "weak first")
"""Kinds of drawn scenes, in this order: a pane before a wall; the same, with a pattern on the wall; a second path
that is later by the same delay everywhere; a second path whose share and delay slant; second paths in a view with
boxes, in one with a ball, in a part of the view, and by way of a mirror at the side; a weak pane before a strong
wall."""

FARTHEST_M = 5.8

BLOCKS_PX = (1, 2, 5, 10, 20)
"""Sides of blocks of pixels. In scenes that change, the pixels of a block have the same second path."""

Scenes = Iterator[tuple[str, Scene, Camera, tuple[float, ...]]]
"""Kind, scene, camera, and integration lengths."""

MODELS: tuple[MpiModel, MpiModel] = ("auto", "discrete")


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A scene with two true paths in every pixel, of one of `KINDS` or of a derived class; the seed draws its geometry."""

    kind: str
    seed: int
    share: float
    asr: float = 2.0

    @property
    def summary(self) -> str:
        """One sentence about the scene."""
        return f"two paths, {self.kind}, share {self.share:g}"

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return two paths per pixel."""
        across, down, _ = camera.rays(slice(None))
        near, far, share = (one[rows] for one in self.paths(across, down))
        photons = np.full(near.shape, 0.5) if self.kind == "weak first" else (near.mean() / near) ** 2
        delays = np.stack([np.minimum(near, FARTHEST_M), np.minimum(near, FARTHEST_M) + far - near]) * 2.0 / C_M_PER_NS
        return Light(
            delays_ns=delays, photons=photons * np.stack([np.ones_like(share), share]), ambient=0 * near + self.asr
        )

    def paths(self, across: Float, down: Float) -> tuple[Float, Float, Float]:
        """Return the ranges of both paths in m, and the light of the second path over that of the first."""
        rng = np.random.default_rng(self.seed)
        tilt, distance = rng.uniform(-0.3, 0.3, 2), rng.uniform(1.0, 2.2)
        near, later = plane(across, down, distance, tilt), rng.uniform(0.7, 1.7)
        share, other = np.full(across.shape, self.share), rng.uniform(-0.8, 0.8, (2, 2))
        far, slanted = near + later, 0.4 * across
        match self.kind:
            case "pane" | "pane, pattern":
                far = plane(across, down, distance + later, tilt + 0.2 * other[0])
            case "slanted":
                share = share * np.clip(1.0 + 1.7 * (other[1, 0] * across + other[1, 1] * down), 0.05, None)
                far = far + other[0, 0] * across + other[0, 1] * down
            case "steps":
                for left, top, depth in rng.uniform((-0.5, -0.35, 0.1), (0.3, 0.2, 0.4), (5, 3)):
                    box = (across > left) & (across < left + 0.2) & (down > top) & (down < top + 0.15)
                    near = np.where(box, near - depth, near)
                far = near + later
            case "ball":
                ball = np.hypot(across - 0.1, down) < 0.2
                near = np.where(ball, near - 0.4, near)
                far, share = near + np.where(ball, later, 0.8 * later) + slanted, share * np.where(ball, 1.4, 1.0)
            case "part":
                far, share = far + slanted, np.where(across > other[0, 0] * 0.2 - 0.1, share, 0.0)
            case "from the side":
                seen = np.stack([across, down, np.ones_like(across)]) * (near / np.sqrt(1 + across**2 + down**2))
                mirror = np.array([later, 0.3, 0.4 * distance])[:, None, None]
                way = np.linalg.norm(seen - mirror, axis=0)
                far = 0.5 * (near + way + float(np.linalg.norm(mirror))) + 0.2
                share = share * (way.mean() / way) ** 2
            case "weak first":
                far, share = near + 1.2 + 0.3 * later, 1.0 / share
        if self.kind in ("pane, pattern", "same delay"):
            share = share * pattern(across, down, rng)
        return near, far, share


@dataclass(frozen=True, kw_only=True)
class Changing(Drawn):
    """A wall whose second path changes from block to block: for each block of `block_px` pixels, delay and share are drawn."""

    block_px: int

    def paths(self, across: Float, down: Float) -> tuple[Float, Float, Float]:
        """Return the ranges of both paths in m, and the light of the second path over that of the first."""
        rng = np.random.default_rng(self.seed)
        near = np.minimum(plane(across, down, rng.uniform(1.0, 3.5), rng.uniform(-0.3, 0.3, 2)), FARTHEST_M)
        share, later_ns = (self._of_blocks(rng.uniform(*ends, near.shape)) for ends in ((0.1, 1.0), (3.0, 12.0)))
        return near, near + 0.5 * C_M_PER_NS * later_ns, self.share * share

    def _of_blocks(self, values: Float) -> Float:
        """Return an image in which each block has the value of its first pixel."""
        y, x = (np.arange(side) // self.block_px * self.block_px for side in values.shape)
        return values[np.ix_(y, x)]


@dataclass(frozen=True, kw_only=True)
class Smooth(Drawn):
    """A wall that is bent, before a second path whose delay and share are bent, too: each by waves of its own."""

    def paths(self, across: Float, down: Float) -> tuple[Float, Float, Float]:
        """Return the ranges of both paths in m, and the light of the second path over that of the first."""
        rng = np.random.default_rng(self.seed)
        bent, spread = rng.uniform((0.0, 0.03), (0.15, 0.25)), rng.uniform(0.05, 0.8)
        near = rng.uniform(1.0, 3.0) * (1.0 + bent[0] * waves(across, down, rng))
        later = rng.uniform(0.8, 2.5) * (1.0 + bent[1] * waves(across, down, rng))
        share = np.minimum(self.share * np.exp(spread * waves(across, down, rng)), 0.9)
        return near, near + np.maximum(later, 0.3), share


def waves(across: Float, down: Float, rng: np.random.Generator) -> Float:
    """Return one to three long waves; together they have a variance of 1."""
    count = int(rng.integers(1, 4))
    total = np.zeros_like(across)
    for per_view, way, turn in rng.uniform((0.25, 0.0, 0.0), (3.0, 2.0 * np.pi, 2.0 * np.pi), (count, 3)):
        total += np.sin(2.0 * np.pi * per_view * (across * np.cos(way) + down * np.sin(way)) + turn)
    return np.asarray(total * np.sqrt(2.0 / count))


def plane(across: Float, down: Float, distance_m: float, tilt: Float) -> Float:
    """Return the ranges of a plane."""
    return np.asarray(distance_m * np.sqrt(1 + across**2 + down**2) / (1 + tilt[0] * across + tilt[1] * down))


def pattern(across: Float, down: Float, rng: np.random.Generator) -> Float:
    """Return a pattern of six waves; its logarithm has a standard deviation of .5."""
    waves = rng.normal(size=(6, 2)) * 8.0
    turns = rng.uniform(0.0, 2.0 * np.pi, 6)
    total = sum(np.sin(a * across + b * down + turn) for (a, b), turn in zip(waves, turns, strict=True))
    return np.asarray(np.exp(0.5 * np.asarray(total) / np.sqrt(3.0)))


def cards() -> Scenes:
    """Return the scenes of `simulate` that have two true paths."""
    camera, lengths = Camera(width=160, height=120), LENGTHS["cards"]
    for share in (0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5):
        for distance in (0.75, 2.0, 4.0):
            for delays in ((3.0, 20.0), (3.0, 9.0), (5.0, 12.0), (9.0, 16.0)):
                scene = Card(distance_m=distance, separations_ns=delays, mpi_ratios=(share, share))
                yield "card of one share", scene, camera, lengths if distance == 2.0 else (1e5,)
    for shares in ((0.005, 0.03), (0.01, 0.1), (0.05, 0.6)):
        for clean in (0.0, 1 / 6):
            yield "card of all shares", Card(mpi_ratios=shares, clean_share=clean), camera, lengths
    for delay in (4.0, 6.0, 8.0, 11.0, 14.0):
        for share in (0.02, 0.1):
            scene = Card(distance_m=1.5, separations_ns=(delay, delay), mpi_ratios=(share, share), clean_share=0.0)
            yield "one share, one delay", scene, camera, lengths
    for share in (0.005, 0.01, 0.02, 0.033, 0.05, 0.1, 0.3):
        for reflector in (1.0, 2.0, 3.0, 5.0):
            yield "inter-reflection", InterReflection(mpi_ratio=share, reflector_m=reflector), camera, lengths


def panels(seed: int) -> Scenes:
    """Return inter-reflections on panels from near to far, by reflectors close by and far off, of all shares."""
    camera, rng = Camera(width=160, height=120), np.random.default_rng(seed)
    for _ in range(64):
        distance, share, reflector = rng.uniform(1.0, 3.5), 0.25 * 25.0 ** -rng.uniform(), rng.uniform(1.2, 7.0)
        scene = InterReflection(
            distance_m=distance, wall_m=distance + rng.uniform(0.5, 1.2), mpi_ratio=share, reflector_m=reflector
        )
        yield f"panel, share {'.05 and more' if share > 0.05 else 'below .05'}", scene, camera, LENGTHS["panels"]


def corners(seed: int) -> Scenes:
    """Return corners from near to far, dark and bright, narrow and wide."""
    camera, rng = Camera(width=160, height=120), np.random.default_rng(seed)
    for _ in range(60):
        distance, albedo, opening = rng.uniform(1.0, 4.0), rng.uniform(0.2, 0.95), rng.uniform(60.0, 120.0)
        yield "corner", Corner(distance_m=distance, albedo=albedo, opening_deg=opening), camera, LENGTHS["corners"]


def drawn(seed: int) -> Scenes:
    """Return scenes of every kind, with four shares in three sizes of frames and views."""
    for kind in KINDS:
        for share in (0.02, 0.05, 0.1, 0.25):
            for (width, height), lens in (((160, 120), 0.72), ((320, 240), 0.875), ((100, 130), 1.3)):
                camera = Camera(width=width, height=height, focal_length_px=lens * width)
                yield kind, Drawn(kind=kind, seed=seed, share=share), camera, LENGTHS["drawn"]
                seed += 1


def changing(seed: int) -> Scenes:
    """Return scenes whose second paths change, with four shares, in blocks of all sizes."""
    for block in BLOCKS_PX:
        for most in (0.05, 0.15, 0.4, 0.8):
            for width, height, lens in ((160, 120, 0.72), (320, 240, 0.875), (100, 130, 1.3)):
                camera = Camera(width=width, height=height, focal_length_px=lens * width)
                kind = f"blocks of {block} pixels"
                yield kind, Changing(kind=kind, block_px=block, seed=seed, share=most), camera, LENGTHS["changing"]
                seed += 1


def smooth(seed: int) -> Scenes:
    """Return scenes whose second paths change smoothly, with five shares."""
    for share in (0.03, 0.07, 0.15, 0.3, 0.5):
        for _ in range(4):
            for width, height, lens in ((160, 120, 0.72), (320, 240, 0.875), (100, 130, 1.3)):
                camera = Camera(width=width, height=height, focal_length_px=lens * width)
                kind = f"smooth, share about {share:g}"
                yield kind, Smooth(kind=kind, seed=seed, share=share), camera, LENGTHS["smooth"]
                seed += 1


def recordings(
    scene: Scene, camera: Camera, lengths: tuple[float, ...], modulation: Modulation, seed: int
) -> Iterator[tuple[Float, Float, CaptureMetadata]]:
    """Yield the volts of a frame, its true ranges and its metadata for every integration length; light is followed once."""
    metadata = CaptureMetadata(
        modulation=modulation,
        pixel=Pixel(integration_length=1e5),
        optics=camera.optics,
    )
    usual = Exposure(scene=scene, camera=camera, metadata=metadata, seed=seed)
    whole = expose(usual)
    for length in lengths:
        each = float(round(length * 2 / len(modulation.periods_ns)))
        volts, known = with_length(usual, whole, each)
        yield volts, whole.truth[DIRECT_DEPTH], known


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", choices=tuple(LENGTHS), help="which set of frames")
    parser.add_argument("--harmonics", type=int, default=2, choices=(2, 3, 4))
    parser.add_argument("--waveform", default="sine", choices=("sine", "triangle"))
    parser.add_argument("--seed", type=int, default=3, help="seed of the noise, and of scenes that are drawn")
    chosen = parser.parse_args()
    by_seed: dict[str, Callable[[int], Scenes]] = {
        "panels": panels,
        "drawn": drawn,
        "corners": corners,
        "changing": changing,
        "smooth": smooth,
    }
    scenes = cards() if chosen.frames == "cards" else by_seed[chosen.frames](chosen.seed)
    modulation = Modulation(periods_ns=PERIODS_NS[: chosen.harmonics], waveform=chosen.waveform)
    counts: dict[str, int] = {}
    tails: dict[str, list[tuple[float, float]]] = {}
    for kind, scene, camera, lengths in scenes:
        for volts, truth_m, metadata in recordings(scene, camera, lengths, modulation, chosen.seed):
            taken, two = (resolved(volts, metadata, model=model) for model in MODELS)
            counts[kind] = counts.get(kind, 0) + 1
            if taken.mpi is not None and taken.mpi.taken == "diffuse":
                errors = (100 * np.nanmedian(abs(one.maps.layer(DIRECT_DEPTH) - truth_m)) for one in (taken, two))
                tails.setdefault(kind, []).append((float(next(errors)), float(next(errors))))
            elif taken.maps.values.tobytes() != two.maps.values.tobytes():
                raise SystemExit(f"{kind}: found other maps than those of two paths, expected the same bits")
    print("| scene | frames | taken for tails | error as taken, by two paths, cm |\n|---|---|---|---|")
    for kind, count in counts.items():
        found = np.array(tails.get(kind, []))
        cell = f"{np.median(found[:, 0]):.2f}, {np.median(found[:, 1]):.2f}" if found.size else ""
        print(f"| {kind} | {count} | {len(found)} | {cell} |")
    print(f"| together | {sum(counts.values())} | {sum(map(len, tails.values()))} | |")


if __name__ == "__main__":
    main()
