"""Draw the figures of docs/diffuse.md: predicted tails against rendered tails, and errors over sigma, room by room.

`python scripts/render_rooms.py ROOMS --seeds 19000-19029 --width 160 --light-paths 256`, then
`python scripts/diffuse_figures.py ROOMS --out docs` writes diffuse_tail.png (the first room with two and with three
harmonics) and diffuse_sigma.png (all rooms). `scripts/diffuse_accuracy.py --figure` draws the errors of one room.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from diffuse_accuracy import SHARES
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from with_truth import capture_truth, first_stored, resolved

from cadtof_cli.arrays import Float
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.pipeline.first_phasor import first_phasor_depth
from cadtof_cli.pipeline.plan import FramePlan

PATCH = 8
"""Side of a patch in frames of 160 × 120 pixels."""

LARGEST_SCORE = 4.0

COLOURS = {2: "tab:orange", 3: "tab:blue"}


@dataclass(frozen=True)
class Room:
    """A rendered room: by how much MPI lengthens its ranges, in cm, as rendered and as predicted; `scores` are
    errors over sigma."""

    name: str
    harmonics: int
    rendered: Float
    predicted: Float
    scores: Float

    @property
    def seed(self) -> str:
        """Name of the room: captures of the same room with other numbers of harmonics share it."""
        return self.name.rpartition("_h")[0]

    @property
    def within(self) -> float:
        """Share of errors within one sigma."""
        return float(np.mean(np.abs(self.scores) < 1.0))


def main() -> None:
    """Draw both figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", type=Path, help="folder of rooms from scripts/render_rooms.py")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the figures")
    parser.add_argument("--shown", default="", help="room whose tail is drawn, such as room_7002 [default: the first]")
    chosen = parser.parse_args()
    rooms = [measured(capture) for capture in find_captures(sorted(chosen.rooms.iterdir()))]
    shown = chosen.shown or rooms[0].seed
    tails([room for room in rooms if room.seed == shown]).savefig(chosen.out / "diffuse_tail.png", dpi=80)
    calibration(rooms).savefig(chosen.out / "diffuse_sigma.png", dpi=80)


def measured(capture: Capture) -> Room:
    """Resolve the one frame of a room."""
    truth = capture_truth(capture.root)
    stored = first_stored(capture)
    maps = resolved(stored, capture.source.metadata, model="auto").maps
    first = first_phasor_depth(stored, plan=FramePlan(metadata=capture.source.metadata))
    depth = maps.layer(DIRECT_DEPTH).astype(np.float64)
    scores = ((depth - truth) / maps.layer(DIRECT_SIGMA)).ravel()
    harmonics = len(capture.source.metadata.modulation.periods_ns)
    return Room(capture.root.name, harmonics, 100 * (first - truth), 100 * (first - depth), scores[np.isfinite(scores)])


def tails(rooms: Sequence[Room]) -> Figure:
    """Draw by how much MPI lengthens the ranges of one room, as rendered and as predicted: for every pixel, and for
    every patch."""
    figure = Figure(figsize=(15.0, 3.8), layout="constrained")
    *maps, scatter = figure.subplots(1, len(rooms) + 2, width_ratios=[1.3] * (len(rooms) + 1) + [1.0])
    pictures = [(f"{rooms[0].seed}: rendered", rooms[0].rendered)]
    pictures += [(f"predicted, {room.harmonics} harmonics", room.predicted) for room in rooms]
    most = float(np.nanpercentile(rooms[0].rendered, 99))
    for axes, (title, lag) in zip(maps, pictures, strict=True):
        drawn = axes.imshow(lag, vmin=0.0, vmax=most)
        axes.set_title(title)
        axes.set_axis_off()
    figure.colorbar(drawn, ax=maps, shrink=0.8, label="range that MPI adds, cm")
    for room in rooms:
        scatter.plot(by_patch(room.rendered), by_patch(room.predicted), ".", ms=4, color=COLOURS[room.harmonics])
        scatter.plot([], [], ".", color=COLOURS[room.harmonics], label=f"{room.harmonics} harmonics")
    scatter.axline((0, 0), slope=1, color="black", lw=0.8)
    scatter.set(xlabel="rendered, cm", ylabel="predicted, cm", title="medians of patches")
    scatter.legend(loc="upper left")
    return figure


def by_patch(image: Float) -> Float:
    """Return the median of every patch; NaN if a pixel of the patch has no light."""
    rows, columns = (size // PATCH for size in image.shape)
    cut = image[: rows * PATCH, : columns * PATCH].reshape(rows, PATCH, columns, PATCH).swapaxes(1, 2)
    return np.asarray(np.median(cut.reshape(rows * columns, -1), axis=1))


def calibration(rooms: Sequence[Room]) -> Figure:
    """Draw the errors over sigma of all rooms together, and the share within one sigma room by room."""
    figure = Figure(figsize=(12.0, 3.8), layout="constrained")
    together, apart = figure.subplots(1, 2)
    edges = np.linspace(-LARGEST_SCORE, LARGEST_SCORE, 81)
    together.plot(edges, np.exp(-0.5 * edges**2) / np.sqrt(2 * np.pi), color="black", lw=0.8, label="normal deviates")
    for harmonics, colour in COLOURS.items():
        chosen = [room for room in rooms if room.harmonics == harmonics]
        scores = np.concatenate([np.clip(room.scores, -LARGEST_SCORE, LARGEST_SCORE) for room in chosen])
        together.hist(scores, edges, density=True, histtype="step", color=colour, label=f"{harmonics} harmonics")
        shares_by_room(apart, [room.within for room in chosen], harmonics, colour)
    together.set(
        xlabel="error of depth over its predicted sigma", ylabel="density", title=f"{len(chosen)} rooms together"
    )
    together.legend()
    apart.axhspan(*SHARES, color="tab:green", alpha=0.15)
    apart.axhline(0.683, color="black", lw=0.8)
    apart.set(xlabel="rooms, sorted", ylabel="share of errors within one sigma", title="room by room", ylim=(0, 1))
    apart.legend(loc="lower right")
    return figure


def shares_by_room(axes: Axes, shares: Sequence[float], harmonics: int, colour: str) -> None:
    """Draw the shares of all rooms, in rising order."""
    true = sum(SHARES[0] <= share <= SHARES[1] for share in shares)
    label = f"{harmonics} harmonics: {true} of {len(shares)} in {SHARES[0]} to {SHARES[1]}"
    axes.plot(np.arange(1, len(shares) + 1), sorted(shares), "o-", ms=4, color=colour, label=label)


if __name__ == "__main__":
    main()
