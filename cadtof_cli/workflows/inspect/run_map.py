"""A map of a run, as the commands after a run read it; what maps must have in common; the optics that a user gives."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float
from cadtof_cli.capture.frames import TRUTH
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import CadtofError, CaptureError, SettingsError, UnlistedError
from cadtof_cli.files.formats import FRAME_SUFFIXES, MAP_SUFFIXES, RAW
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import STATUS, DamagedMapsError, NotMapsError, is_map_layer
from cadtof_cli.files.named_planes import channel_in_words, is_of_a_plane
from cadtof_cli.files.reading import is_folder
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS, DepthKind
from cadtof_cli.records import setting
from cadtof_cli.units import size_text
from cadtof_cli.workflows.map_files import each_map_file
from cadtof_cli.workflows.run_folder import Run, is_run_folder

Layers = Mapping[str, NDArray[Any]]
"""Layers of a map by name, (Y, X) each, as they are stored."""


@dataclass(frozen=True, eq=False)
class RunMap:
    """A map of a run: its file, and the layers that the file holds."""

    run: Run
    file: Path
    layers: Layers

    @classmethod
    def read(cls, run: Run, file: Path, /) -> "RunMap":
        """Return a map of a run; raises FrameError if its file cannot be read."""
        return cls(run, file, read_layers(file))

    def layer(self, name: str, /) -> NDArray[Any]:
        """Return one of the layers; raises CaptureError if none has that name."""
        if name not in self.layers:
            hint = "; `cadtof resolve` makes maps of voltages" if all(map(is_of_a_plane, self.layers)) else ""
            raise CaptureError(f"{self.file}: found layers {', '.join(self.layers)}; expected {name}{hint}")
        return self.layers[name]

    def sigma(self, depth: str, /) -> NDArray[Any] | None:
        """Return the standard deviations of a layer of depths; None if the map has none, or the layer holds no depths."""
        return self.layers.get(depth.removesuffix(".depth") + ".sigma") if depth.endswith(".depth") else None


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


def holds_maps(path: Path, /, *, or_other_layers: bool = False) -> bool:
    """Return whether a folder or file holds maps, as truth does too, and no recorded frames. Its first sound file tells.

    A folder with a `capture.toml`, in it or beside images below it, holds recorded frames. `or_other_layers`: layers of other
    names count as maps, although each may be a plane of a frame, unless a name gives a channel.
    """
    if is_run_folder(path):
        return True
    if os.path.lexists(path / CAPTURE_FILE):
        # asked first, because a capture may have very many files
        return False
    files, in_folder = list[Path](), is_folder(path)
    try:
        # one by one: below an archive there may be very many
        for file in each_map_file(path, on_unlisted=lambda *_: None):
            # False also where a folder lets nobody in, unlike `Path.exists`
            if in_folder and os.path.lexists(file.parent / CAPTURE_FILE):
                return False
            files.append(file)
    except UnlistedError:
        return False
    of_frames = in_folder and all(map(_is_truth_of_frames, files))
    layers = None if of_frames else _first_sound_layers(files)
    if layers is None:
        return False
    return any(map(is_map_layer, layers)) or (or_other_layers and not any(map(channel_in_words, layers)))


def _is_truth_of_frames(file: Path, /) -> bool:
    """Return whether a file is a truth beside files that may be frames, but not maps, such as NPY."""
    suffixes = {*FRAME_SUFFIXES, *RAW.suffixes}.difference(MAP_SUFFIXES)
    return file.stem == TRUTH and any(path.suffix.lower() in suffixes for path in file.parent.iterdir())


def _first_sound_layers(files: Sequence[Path], /) -> Layers | None:
    """Return the layers of the first file that can be read; None if it has no named layers, or if no file can be read.

    They tell what kind of files all of them are. Truth is read only if there are no other files: if these are damaged, truth does
    not tell whether they are recorded frames.
    """
    for file in [path for path in files if path.stem != TRUTH] or files:
        try:
            return read_layers(file)
        except NotMapsError:
            return None
        except DamagedMapsError:
            # they are maps all the same: who reads them is told what is wrong with them
            return {STATUS: np.empty((0, 0))}
        except CadtofError:
            continue
    return None


def in_kind(layers: Layers, kind: DepthKind, planar: Float, /) -> Layers:
    """Return the layers of a map, (Y, X), with depths and their standard deviations of the given kind instead of the other.

    `planar`, (Y, X), is the ratio of z depth to range.
    """
    factor = planar if kind == "z" else 1.0 / planar
    return {
        name: (plane * factor).astype(plane.dtype) if name.endswith((".depth", ".sigma")) else plane
        for name, plane in layers.items()
    }


def require_same_depth(run: Run, other: Run, /) -> None:
    """Raise SettingsError if the maps of one run hold radial range, and those of the other planar depth."""
    if run.depth_kind != other.depth_kind:
        raise SettingsError(
            f"{run.maps} holds {DEPTH_IN_WORDS[run.depth_kind]} and {other.maps} {DEPTH_IN_WORDS[other.depth_kind]}: "
            "resolve both with the same --depth"
        )


def require_same_part(run: Run, other: Run, /) -> None:
    """Raise SettingsError if maps of the same size of two runs show different parts of the recorded frames."""
    # maps without --roi begin at 0,0; where maps of the same size begin at the same pixel, they also end at the same
    first, second = (tuple(one.roi) if one.roi else (0, 0) for one in (run, other))
    if first[: len(second)] != second[: len(first)]:
        parts = [",".join(map(str, one.roi)) if one.roi else "of whole frames" for one in (run, other)]
        raise SettingsError(
            f"{run.maps} shows pixels {parts[0]} and {other.maps} {parts[1]}: resolve both with the same --roi"
        )


def require_same_size(plane: NDArray[Any], expected: tuple[int, ...], path: Path, other: Path, /) -> None:
    """Raise CaptureError if a plane read from `path` has not the expected size, (Y, X), that of the file `other`."""
    if plane.shape != expected:
        raise CaptureError(
            f"{path}: found {size_text(plane.shape)} pixels, expected {size_text(expected)} as in {other}"
        )
