"""Layers of maps for the commands after a run: by name, of one size, with the optics for points in space, and with truth."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float
from cadtof_cli.capture.discovery import TRUTH
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.errors import CadtofError, CaptureError, SettingsError
from cadtof_cli.files.formats import MAP_SUFFIXES
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import NotMapsError
from cadtof_cli.files.named_planes import is_of_a_plane
from cadtof_cli.files.reading import is_folder
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS
from cadtof_cli.records import setting
from cadtof_cli.units import size_text
from cadtof_cli.workflows.run_folder import Run

Layers = Mapping[str, NDArray[Any]]
"""Layers of a map by name, (Y, X) each, as they are stored."""

OTHER_UNIT = 30.0
"""True depths whose median is more than this many times that of the maps, and more than this many metres, are in another unit:
centimetres give a ratio of 100."""


@dataclass(frozen=True, kw_only=True)
class GivenOptics:
    """The optics that a user gives if the run's record lacks the optics of the camera or has them wrong."""

    focal_length_px: float | None = setting(
        None,
        "Focal length in pixels, for point clouds.  [default: from run.json]",
    )
    principal_point_px: tuple[float, float] | None = setting(
        None,
        "Column and row of the optical axis, counted from the corner of the maps.  [default: from run.json, else the centre]",
        metavar="X,Y",
    )

    def optics(self, run: Run, file: Path, /) -> Optics:
        """Return the optics of a map: those that the user gave, else those of the run. Pixels count from the map's own corner.

        If no principal point is given, it is the centre of the recorded frame. In maps of a part of the frame, nothing says
        where that centre is, so the optics are unknown.
        """
        known, focal, point = run.optics(file), self.focal_length_px, self.principal_point_px
        if point is None and known.principal_point_px is not None:
            left, top = (run.roi or (0, 0))[:2]
            point = known.principal_point_px[0] - left, known.principal_point_px[1] - top
        if point is None and run.roi:
            return Optics()
        return Optics(focal_length_px=known.focal_length_px if focal is None else focal, principal_point_px=point)


def first_sound_layers(files: Sequence[Path], /) -> Layers | None:
    """Return the layers of the first file that can be read. They tell what kind of files all of them are.

    Truth is read only if there are no other files: if these are damaged, truth does not tell whether they are recorded frames.

    Returns:
        None if the first file that can be read has no named layers, or if no file can be read.
    """
    for file in [path for path in files if path.stem != TRUTH] or files:
        try:
            return read_layers(file)
        except NotMapsError:
            return None
        except CadtofError:
            continue
    return None


def layer_of(layers: Layers, name: str, path: Path, /) -> NDArray[Any]:
    """Return one of the layers of a file; raises CaptureError if no layer has that name."""
    if name not in layers:
        hint = "; `cadtof resolve` makes maps of voltages" if all(map(is_of_a_plane, layers)) else ""
        raise CaptureError(f"{path}: found layers {', '.join(layers)}; expected {name}{hint}")
    return layers[name]


def true_layer(run: Run, layer: str, path: Path, /) -> Float:
    """Return a layer of the truth of a run's maps, float64 (Y, X): of whole frames, or of the part that the maps show.

    A depth of 0 or less is NaN, no truth: no surface is there, and many programs write 0 where they know no depth.

    Maps of another run may serve as truth. The header of such a map says what it holds; other truth says nothing.

    Raises:
        SettingsError: the truth holds z depth, or another part of the frames.
    """
    # without a record: a `run.json` beside the truth may be that of other maps
    said = Run(path, (path,), path.parent, None)
    if layer.endswith(".depth"):
        _require_range(said)
    if said.roi:
        _require_same_part(run, said)
    known = layer_of(read_layers(path), layer, path).astype(np.float64)
    if layer.endswith(".depth"):
        known[known <= 0.0] = np.nan
    return known


@dataclass(frozen=True)
class Truth:
    """The true depths of a run's maps.

    Attributes:
        given: the file with the truth of all maps; or a folder with a file for each capture, in the same tree as the run.
        run: the run whose maps are compared with it.
    """

    given: Path
    run: Run

    def __post_init__(self) -> None:
        """Raise CaptureError if the truth does not exist. Raise SettingsError if the maps hold z depth: truth is radial range."""
        require_truth(self.given)
        _require_range(self.run)

    @cached_property
    def _read(self) -> Callable[[Path], Float]:
        return lru_cache(maxsize=1)(partial(true_layer, self.run, DIRECT_DEPTH))

    def file(self, map_file: Path, /) -> Path:
        """Return the file with the truth of a map. In a folder, it is the `truth.*` in the place that the map has in its run.

        If there is no such file in that place, it is the one in the nearest folder above.

        Raises:
            CaptureError: there is no such file.
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

    def depth(self, map_file: Path, direct: NDArray[Any], /) -> Float:
        """Return the true depth of the pixels of a map, float64 (Y, X) in m.

        Args:
            map_file: the map.
            direct: its direct depth, (Y, X).

        Raises:
            CadtofError: the truth cannot be read, has another size, or is in another unit.
        """
        file = self.file(map_file)
        known = self.run.cropped(self._read(file))
        require_same_size(direct, known.shape, map_file, file)
        _require_metres(file, known, direct)
        return known

    def tell_of_captures(self, say: Callable[[str], None], /) -> None:
        """Say so if one file is the truth of the maps of several captures."""
        captures = self.run.captures_shown
        if captures > 1 and not is_folder(self.given):
            say(
                f"{self.given}: the frames of {captures} captures are compared with this one truth; a folder may hold a truth for"
                " each"
            )


def _require_metres(file: Path, known: Float, direct: NDArray[Any], /) -> None:
    """Make sure that true depths are not in millimetres or centimetres.

    Raises:
        CaptureError: their median is too large, see `OTHER_UNIT`.
    """
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


def require_same_depth(run: Run, other: Run, /) -> None:
    """Make sure that the maps of two runs hold the same kind of depth.

    Raises:
        SettingsError: one holds radial range and the other planar depth.
    """
    if run.depth_kind != other.depth_kind:
        raise SettingsError(
            f"{run.maps} holds {DEPTH_IN_WORDS[run.depth_kind]} and {other.maps} {DEPTH_IN_WORDS[other.depth_kind]}: "
            "resolve both with the same --depth"
        )


def require_same_pixels(run: Run, other: Run, /) -> None:
    """Make sure that maps of the same size of two runs show the same part of the recorded frames, if both have a record.

    Raises:
        SettingsError: they show different parts.
    """
    if run.record is not None and other.record is not None:
        _require_same_part(run, other)


def _require_same_part(run: Run, other: Run) -> None:
    """Raise SettingsError if maps of the same size of two runs show different parts of the recorded frames."""
    # maps without --roi begin at 0,0; where maps of the same size begin at the same pixel, they also end at the same
    first, second = (tuple(one.roi) if one.roi else (0, 0) for one in (run, other))
    if first[: len(second)] != second[: len(first)]:
        parts = [",".join(map(str, one.roi)) if one.roi else "of whole frames" for one in (run, other)]
        raise SettingsError(
            f"{run.maps} shows pixels {parts[0]} and {other.maps} {parts[1]}: resolve both with the same --roi"
        )


def require_same_size(plane: NDArray[Any], expected: tuple[int, ...], path: Path, other: Path, /) -> None:
    """Make sure that a plane read from `path` has the expected size, (Y, X), of the plane in the file `other`.

    Raises:
        CaptureError: it has another size.
    """
    if plane.shape != expected:
        raise CaptureError(
            f"{path}: found {size_text(plane.shape)} pixels, expected {size_text(expected)} as in {other}"
        )
