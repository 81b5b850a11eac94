"""What a user can choose about a picture. The options are made from this record, so nothing heavy is imported here."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from cadtof_cli.errors import SettingsError, require
from cadtof_cli.records import setting

ColourScale = Literal["viridis", "plasma", "magma", "inferno", "RdBu_r", "twilight"]
"""Colour maps, perceptually uniform, also for the colour-blind. The last two are for values around 0 and for angles."""


@dataclass(frozen=True, kw_only=True)
class PreviewSettings:
    """What is drawn, and how."""

    layer: str | None = setting(
        None, "Draw this layer at full resolution, such as mpi.depth, status or H1.SC1.", metavar="NAME"
    )
    limits: tuple[float, float] | None = setting(
        None,
        "Ends of the colour scale, in the unit of the layer.  [default: from the values]",
        option="--range",
        metavar="LO,HI",
    )
    colours: ColourScale | None = setting(None, "Colour map.  [default: by the layer]", option="--cmap")
    truth: Path | None = setting(
        None,
        "File with the true direct.depth, or a folder with such a file, truth.exr, for each capture, in the same tree as the "
        "run; the errors are drawn too.",
    )
    frame: int | None = setting(None, "Draw this frame only; 0 is the first.")
    frames_per_second: float = setting(10.0, "Frames per second of a film.", option="--fps", metavar="F")
    overwrite: bool = setting(False, "Replace the file if it exists.")

    def __post_init__(self) -> None:
        ends = self.limits or (0.0, 1.0)
        rises = len(ends) == 2 and all(map(math.isfinite, ends)) and ends[0] < ends[1]
        found, known = ",".join(f"{one:g}" for one in ends), get_args(ColourScale)
        require(rises, "--range", found, "a least and a larger value such as 0.5,3")
        require(self.colours in {None, *known}, "--cmap", repr(self.colours), f"one of {', '.join(known)}")
        require(self.frame is None or self.frame >= 0, "--frame", self.frame, "0 or more")
        rate = self.frames_per_second
        require(0.1 <= rate <= 50.0, "--fps", f"{rate:g}", "0.1 to 50 frames a second")
        if self.truth is not None and (self.layer is not None or self.limits or self.colours):
            raise SettingsError("--truth draws the errors of a whole frame; leave out --layer, --range and --cmap")
