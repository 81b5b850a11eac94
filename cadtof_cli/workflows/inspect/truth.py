"""The truth of a run's maps, for the commands that compare the maps with it."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float
from cadtof_cli.capture.frames import TRUTH
from cadtof_cli.errors import CaptureError, SettingsError
from cadtof_cli.files.formats import MAP_SUFFIXES
from cadtof_cli.files.reading import is_folder
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.workflows.inspect.run_map import RunMap, require_same_part, require_same_size
from cadtof_cli.workflows.run_folder import Run

OTHER_UNIT = 30.0
"""True depths whose median is more than this many times that of the maps, and more than this many metres, are in another unit:
centimetres give a ratio of 100."""


def true_layer(run: Run, layer: str, path: Path, /) -> Float:
    """Return a layer of the truth of a run's maps, float64 (Y, X): of whole frames, or of the part that the maps show.

    A depth of 0 or less is NaN, no truth: see `without_holes`.

    Maps of another run may serve as truth. The header of such a map says what it holds; other truth says nothing.

    Raises:
        SettingsError: the truth holds z depth, or another part of the frames.
    """
    # without a record: a `run.json` beside the truth may be that of other maps
    said = Run(path, (path,), path.parent, None)
    if layer.endswith(".depth"):
        _require_range(said)
    if said.roi:
        require_same_part(run, said)
    known = RunMap.read(said, path).layer(layer).astype(np.float64)
    return without_holes(known) if layer.endswith(".depth") else known


def without_holes(depth: Float, /) -> Float:
    """Return depths with NaN in place of 0 and less: no surface is there, and many programs write 0 where they know no depth."""
    return np.where(depth <= 0.0, np.nan, depth)


@dataclass(frozen=True)
class Truth:
    """The true depths of a run's maps.

    `given` is the file with the truth of all maps, or a folder with a file for each capture, in the same tree as the run.
    """

    given: Path
    run: Run

    def __post_init__(self) -> None:
        """Raise CaptureError if the truth does not exist. Raise SettingsError if the maps hold z depth: truth is radial range."""
        require_truth(self.given)
        _require_range(self.run)

    @cached_property
    def _read(self) -> Callable[[Path], Float]:
        """The function that reads a file with truth. It keeps the last one, because the frames of a capture share it."""
        return lru_cache(maxsize=1)(partial(true_layer, self.run, DIRECT_DEPTH))

    def file(self, map_file: Path, /) -> Path:
        """Return the file with the truth of a map. In a folder, it is the `truth.*` in the place that the map has in its run.

        If there is no such file in that place, it is the one in the nearest folder above; raises CaptureError if there is none.
        """
        if not is_folder(self.given):
            return self.given
        below = Path(self.run.name(map_file)).parent
        for folder in (below, *below.parents):
            for path in (self.given / folder / f"{TRUTH}{suffix}" for suffix in MAP_SUFFIXES):
                if path.exists():
                    return path
        raise CaptureError(
            f"{self.given / below}: found no truth of {self.run.name(map_file)}, expected a file {TRUTH}{MAP_SUFFIXES[0]} there"
        )

    def depth(self, one: RunMap, /) -> Float:
        """Return the true depth of the pixels of a map, float64 (Y, X) in m.

        Raises:
            CadtofError: the map has no direct depth; the truth cannot be read, has another size, or is in another unit.
        """
        direct, file = one.layer(DIRECT_DEPTH).astype(np.float64), self.file(one.file)
        known = self.run.cropped(self._read(file))
        require_same_size(direct, known.shape, one.file, file)
        _require_metres(file, known, direct)
        return known

    def tell_of_captures(self, say: Callable[[str], None], /) -> None:
        """Say so if one file is the truth of the maps of several captures."""
        captures = self.run.captures_shown
        if captures > 1 and not is_folder(self.given):
            one = "compared with this one truth; a folder may hold a truth for each"
            say(f"{self.given}: the frames of {captures} captures are {one}")


def _require_metres(file: Path, known: Float, direct: NDArray[Any], /) -> None:
    """Raise CaptureError if true depths are probably in mm or cm: if their median is too large, see `OTHER_UNIT`."""
    both = np.isfinite(known) & np.isfinite(direct)
    if not both.any():
        return
    true, found = float(np.median(known[both])), float(np.median(direct[both]))
    if true > OTHER_UNIT * max(found, 1.0):
        raise CaptureError(
            f"{file}: found true depths of {true:.4g} at the median where the maps have {found:.3g} m; expected metres: are they"
            " in mm or cm?"
        )


def require_truth(path: Path, /) -> None:
    """Raise CaptureError if there is no file or folder with the truth."""
    # a link in a loop counts as present, and reading it fails
    if not os.path.lexists(path):
        raise CaptureError(f"{path}: no such file or folder; expected the truth of the maps")


def _require_range(run: Run) -> None:
    """Raise SettingsError if maps hold z depth."""
    if run.depth_kind == "z":
        raise SettingsError(
            f"{run.maps}: holds z depth, and truth is radial range; resolve with --depth range to evaluate"
        )
