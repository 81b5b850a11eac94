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
from cadtof_cli.optics import planar_per_range
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS, DepthKind
from cadtof_cli.workflows.inspect.run_map import GivenOptics, RunMap, require_same_part, require_same_size
from cadtof_cli.workflows.run_folder import Run

OTHER_UNIT = 30.0
"""True depths whose median is more than this many times that of the maps, and more than this many metres, are in another unit:
centimetres give a ratio of 100."""


@dataclass(frozen=True, eq=False)
class _Known:
    """A layer of a file with truth: its values, float64 (Y, X), and the kind of the depths if it holds depths."""

    values: Float
    kind: DepthKind | None


def true_layer(one: RunMap, layer: str, path: Path, /) -> Float:
    """Return a layer of the truth of a map, float64 (Y, X): of the pixels that the map shows, depths of the kind that it holds.

    A depth of 0 or less is NaN, no truth: see `without_holes`. The truth holds whole frames, or the part that the maps show.

    Maps of another run may serve as truth. The header of such a map says what it holds; other depths are radial range.

    Raises:
        CadtofError: the truth cannot be read, lacks the layer, or has other pixels; or its depths are of another kind than those
            of the map, and the optics are unknown.
    """
    return _of_map(_read(one.run, layer, path), one, layer, path)


def _read(run: Run, layer: str, path: Path, /) -> _Known:
    # without a record: a `run.json` beside the truth may be that of other maps
    said = Run(path, (path,), path.parent, None)
    if said.roi:
        require_same_part(run, said)
    known = RunMap.read(said, path).layer(layer).astype(np.float64)
    return _Known(without_holes(known), said.depth_kind) if layer.endswith(".depth") else _Known(known, None)


def _of_map(known: _Known, one: RunMap, layer: str, path: Path) -> Float:
    whole, run = known.values, one.run
    values = run.cropped(whole)
    require_same_size(one.layer(layer), values.shape, one.file, path)
    if known.kind in {None, run.depth_kind}:
        return values
    optics, size = run.optics(one.file), (whole.shape[0], whole.shape[1])
    if optics.focal_length_px is None:
        found, expected = DEPTH_IN_WORDS[known.kind or "range"], DEPTH_IN_WORDS[run.depth_kind]
        raise SettingsError(
            f"{path}: holds {found} and {run.maps} {expected}, and no run.json tells the optics that convert one into the "
            "other; resolve with --focal-length-px, and give maps in the folder of their run"
        )
    if run.roi is not None and values.shape == whole.shape:
        # truth of a part: pixels count from its corner, and it does not tell the middle of the frame
        if optics.principal_point_px is None:
            raise SettingsError(
                f"{path}: holds only the pixels of --roi, and run.json names no principal point, so z depth cannot be "
                "computed; give truth of whole frames, or resolve with --principal-point-px"
            )
        optics = GivenOptics().optics(run, one.file)
    planar = run.cropped(planar_per_range(optics, size))
    return values * planar if run.depth_kind == "z" else values / planar


def without_holes(depth: Float, /) -> Float:
    """Return depths with NaN in place of 0 and less: no surface is there, and many programs write 0 where they know no depth."""
    return np.where(depth <= 0.0, np.nan, depth)


@dataclass(frozen=True)
class Truth:
    """The true depths of a run's maps, of one layer.

    `given` is the file with the truth of all maps, or a folder with a file for each capture, in the same tree as the run.
    """

    given: Path
    run: Run
    layer: str = DIRECT_DEPTH

    def __post_init__(self) -> None:
        """Raise CaptureError if the truth does not exist."""
        require_truth(self.given)

    @cached_property
    def _read(self) -> Callable[[Path], _Known]:
        """The function that reads a file with truth. It keeps the last one, because the frames of a capture share it."""
        return lru_cache(maxsize=1)(partial(_read, self.run, self.layer))

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
        """Return the true depth of the pixels of a map, float64 (Y, X) in m, of the kind that the map holds.

        Raises:
            CadtofError: see `true_layer`; or the truth is in another unit.
        """
        depth, file = one.layer(self.layer).astype(np.float64), self.file(one.file)
        known = _of_map(self._read(file), one, self.layer, file)
        _require_metres(file, known, depth)
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
