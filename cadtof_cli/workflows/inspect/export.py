"""`cadtof export`: maps as other software reads them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.files.atomic import atomic_write, require_new
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import STATUS
from cadtof_cli.files.png import write_grey_png
from cadtof_cli.files.point_cloud import write_points
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.optics import planar_per_range, ray_slopes
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS, DepthKind
from cadtof_cli.records import setting
from cadtof_cli.workflows.inspect.run_map import GivenOptics, Layers, RunMap, in_kind
from cadtof_cli.workflows.inspect.truth import without_holes
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import Run, read_run

MOST_MM = 65535
"""Largest depth in mm that 16 bits hold."""


@dataclass(frozen=True, kw_only=True)
class ExportSettings(GivenOptics):
    """What a user can choose about an export, besides the optics."""

    layer: str = setting(DIRECT_DEPTH, "Layer of the depths for point clouds and images.", metavar="NAME")
    depth: DepthKind | None = setting(
        None,
        "Kind of the depths in the file: maps of the other kind are converted, which needs the focal length. Maps that do not "
        "say which kind they hold are taken to hold this one.  [default: as the maps, else range]",
    )
    overwrite: bool = setting(False, "Replace the files if they exist.")

    def __post_init__(self) -> None:
        is_depth = self.layer.endswith(".depth")
        require(is_depth, "--layer", repr(self.layer), "a layer of depths such as direct.depth")


@dataclass(frozen=True, eq=False)
class _Exported(RunMap):
    """A map to be exported, with its optics. `name` is the layer of depths to be exported, and `kind` their kind."""

    name: str
    kind: DepthKind
    optics: Optics

    @property
    def depth(self) -> Float:
        """The depths, float64 (Y, X); raises CaptureError if the map has no such layer."""
        return self.layer(self.name).astype(np.float64)


def export_maps(
    maps: Sequence[Path], out: Path, /, *, settings: ExportSettings, progress: Progress
) -> tuple[Path, ...]:
    """Write each map into a file of the format that the suffix of `out` names, and return the files.

    If there are several maps, each gets a file of its own. Its name is that of `out`, followed by the name of the map.

    Raises:
        CadtofError: the maps cannot be read or lack layers, points need optics that are unknown, a file cannot be written, or
            a file is there already and may not be replaced.
    """
    format = EXPORTS.get(out.suffix.lower())
    if format is None:
        raise SettingsError(f"-o: found {out.name!r}, expected a name that ends with {', '.join(EXPORTS)}")
    runs = [read_run(path) for path in maps]
    for run in runs:
        run.tell_if_unfinished(progress.say)
        if settings.depth is not None and run.said_depth is None:
            progress.say(
                f"{run.maps}: does not say which kind of depth it holds: taken for {DEPTH_IN_WORDS[settings.depth]}"
            )
    found = [(run, file) for run in runs for file in run.require_maps()]
    by_output: dict[Path, tuple[Run, Path]] = {}
    for run, file in found:
        several = f"{out.stem}_{run.name(file).replace('/', '_')}{out.suffix}"
        output = out.with_name(several) if len(found) > 1 else out
        if output in by_output:
            other = by_output[output][1]
            raise SettingsError(
                f"{other} and {file} would both be written as {output}; export each with a command of its own"
            )
        require_new(output, overwrite=settings.overwrite)
        by_output[output] = run, file
    progress.advance(0, total=len(found))
    for output, (run, file) in by_output.items():
        kind = settings.depth or run.depth_kind
        layers: Layers = read_layers(file)
        optics = settings.optics(run, file)
        if run.said_depth not in {None, kind}:
            height, width = next(iter(layers.values())).shape
            layers = in_kind(layers, kind, planar_per_range(_known(optics, file), (height, width)))
        format.write(_Exported(run, file, layers, settings.layer, kind, optics), output)
        progress.advance()
    return tuple(by_output)


def _known(optics: Optics, file: Path) -> Optics:
    """Return the optics of a map; raises SettingsError if its focal length is unknown."""
    if optics.focal_length_px is None:
        raise SettingsError(
            f"{file}: its optics are unknown: give --focal-length-px, and for maps of a --roi also --principal-point-px, "
            "counted from the corner of the maps"
        )
    return optics


def _write_points(one: _Exported, output: Path) -> None:
    """Write the points of the pixels that have a depth: x right, y down, z forward from the camera, in m.

    Amplitude, sigma and status are written as far as the map has them: truth has no sigma and no status.
    """
    depth, path = one.depth, one.name.removesuffix(".depth")
    depth = depth if STATUS in one.layers else without_holes(depth)
    optics, known = _known(one.optics, one.file), np.isfinite(depth)
    depth = np.where(known, depth, np.nan)
    size = depth.shape[0], depth.shape[1]
    right, down = ray_slopes(optics, size)
    forward = depth if one.kind == "z" else depth * planar_per_range(optics, size)
    planes = {"x": forward * right, "y": forward * down, "z": forward}
    planes |= {name: one.layers[f"{path}.{name}"] for name in ("amplitude", "sigma") if f"{path}.{name}" in one.layers}
    points = {name: plane[known].astype(np.float32) for name, plane in planes.items()}
    of_status = {STATUS: one.layers[STATUS][known]} if STATUS in one.layers else {}
    comment = f"cadtof: {one.name} of {one.file.name}, metres; amplitude V, sigma m"
    write_points(output, points | of_status, comment=comment)


def _write_png(one: _Exported, output: Path) -> None:
    """Write the depths in mm; 0: there is no answer, or it does not fit into 16 bits."""
    mm = np.rint(1000.0 * np.nan_to_num(one.depth, nan=0.0, posinf=0.0, neginf=0.0))
    plane = np.where((mm > 0) & (mm <= MOST_MM), mm, 0).astype(np.uint16)
    about = f"{one.name} in mm, {DEPTH_IN_WORDS[one.kind]}; 0: no answer"
    write_grey_png(output, plane, texts={"Description": about})


def _write_npz(one: _Exported, output: Path) -> None:
    """Write all layers by name."""
    arrays: dict[str, Any] = dict(one.layers)
    with atomic_write(output) as temporary, temporary.open("wb") as file:
        # no `allow_pickle` here: until numpy 2.2 this keyword would be saved as one more array
        np.savez_compressed(file, **arrays)


def _write_csv(one: _Exported, output: Path) -> None:
    """Write a line for each pixel: column, row, and the value of every layer; empty if there is no answer."""
    rows, columns = next(iter(one.layers.values())).shape
    x = [str(column) for column in range(columns)]
    with atomic_write(output) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(("x", "y", *one.layers)) + "\n")
        # row by row, because texts take fifty times the memory of numbers
        for row in range(rows):
            texts = [x, [str(row)] * columns, *(_texts(plane[row]) for plane in one.layers.values())]
            file.writelines(f"{line}\n" for line in map(",".join, zip(*texts, strict=True)))


def _texts(values: NDArray[Any]) -> list[str]:
    """Return each value as the shortest text that is read as the same value; NaN is an empty text."""
    texts = values.astype(str)
    if values.dtype.kind == "f":
        texts[np.isnan(values)] = ""
    found: list[str] = texts.tolist()
    return found


@dataclass(frozen=True)
class ExportFormat:
    """A format: the function that writes a map, and the names of the settings that have no effect on its files.

    `needs_rays`: points need the optics also if no depth is converted.
    """

    write: Callable[[_Exported, Path], None]
    needs_rays: bool = False
    unused: tuple[str, ...] = ()

    def without_effect(self, settings: ExportSettings, /) -> tuple[str, ...]:
        """Return the names of the settings that have no effect beside the others."""
        optics = () if self.needs_rays or settings.depth else tuple(one.name for one in fields(GivenOptics))
        return self.unused + optics


EXPORTS = {
    ".ply": ExportFormat(_write_points, needs_rays=True),
    ".pcd": ExportFormat(_write_points, needs_rays=True),
    ".png": ExportFormat(_write_png),
    ".npz": ExportFormat(_write_npz, unused=("layer",)),
    ".csv": ExportFormat(_write_csv, unused=("layer",)),
}
"""The registry of the formats of other software, by the suffix of the file."""
