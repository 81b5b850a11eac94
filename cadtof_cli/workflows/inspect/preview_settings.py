"""What a user can choose about a picture. Options are made from it, so nothing heavy is imported here."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from cadtof_cli.errors import SettingsError

ColourScale = Literal["viridis", "plasma", "magma", "inferno", "RdBu_r", "twilight"]
"""Perceptually uniform, also for the colour-blind; the last two for values around 0 and for angles."""


@dataclass(frozen=True, kw_only=True)
class PreviewSettings:
    """What is drawn, and how.

    Attributes:
        layer: the one that is drawn; None: a figure of all that there is to see, and of several frames the leading one.
        limits: least and largest value of the scale, in the layer's unit; None: as suits the values.
        colours: of the scale; None: as suits the layer.
        truth: file with a direct depth, whose errors are drawn too.
        frame: which of the frames, from 0; None: all.
        frames_per_second: of a film.
        overwrite: whether a file that is there may be replaced.
    """

    layer: str | None = None
    limits: tuple[float, float] | None = None
    colours: ColourScale | None = None
    truth: Path | None = None
    frame: int | None = None
    frames_per_second: float = 10.0
    overwrite: bool = False

    def __post_init__(self) -> None:
        ends = self.limits or (0.0, 1.0)
        if len(ends) != 2 or not all(map(math.isfinite, ends)) or ends[0] >= ends[1]:
            found = ",".join(f"{one:g}" for one in ends)
            raise SettingsError(f"--range: found {found}, expected a least and a larger value such as 0.5,3")
        if self.colours is not None and self.colours not in get_args(ColourScale):
            raise SettingsError(f"--cmap: found {self.colours!r}, expected one of {', '.join(get_args(ColourScale))}")
        if not 0.1 <= self.frames_per_second <= 50.0:
            raise SettingsError(f"--fps: found {self.frames_per_second:g}, expected 0.1 to 50 frames a second")
        if self.truth is not None and (self.layer is not None or self.limits or self.colours):
            raise SettingsError("--truth draws the errors of a whole frame: without --layer, --range and --cmap")

    @property
    def of_layers(self) -> bool:
        """Whether something is chosen that only layers have."""
        return any(one is not None for one in (self.layer, self.limits, self.colours, self.truth))
