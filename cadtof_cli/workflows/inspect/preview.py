"""`cadtof preview`: one picture of a frame's maps."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from cadtof_cli.errors import CaptureError
from cadtof_cli.figures.maps import MapPicture, draw_maps
from cadtof_cli.files.atomic import whole_file
from cadtof_cli.files.layers import read_layers
from cadtof_cli.maps.layers import CONFIDENCE, DIRECT_DEPTH, DIRECT_SIGMA, MPI_DEPTH
from cadtof_cli.workflows.inspect.evaluate import (
    direct_depth,
    find_source,
    first_phasor_depth,
    map_files,
    require_range_depth,
    same_size,
)


def preview_maps(maps: Path, /, *, out: Path, truth: Path | None, on_note: Callable[[str], None]) -> None:
    """Draw the first map of a folder, or a map file, into the PNG `out`; with truth also the errors.

    Raises:
        CadtofError: the maps or the truth cannot be read or lack layers, or the PNG cannot be written.
    """
    path = next(map_files(maps), None)
    if path is None:
        raise CaptureError(f"{maps}: found no maps (.exr, .tif), expected those of `cadtof resolve`")
    layers = read_layers(path)
    missing = [name for name in (DIRECT_DEPTH, MPI_DEPTH, CONFIDENCE, DIRECT_SIGMA) if name not in layers]
    if missing:
        raise CaptureError(f"{path}: found layers {', '.join(layers)}; expected {', '.join(missing)} too")
    direct = layers[DIRECT_DEPTH].astype(np.float64)
    known, found = None, None
    if truth is not None:
        require_range_depth(path)
        known = direct_depth(truth)
        same_size(direct, known, path, truth)
        found = find_source(path, on_note)
    picture = MapPicture(
        f"{path.parent.name}/{path.name}",
        direct,
        layers[MPI_DEPTH].astype(np.float64),
        layers[CONFIDENCE].astype(np.float64),
        layers[DIRECT_SIGMA].astype(np.float64),
        known,
        None if found is None else first_phasor_depth(*found),
    )
    with whole_file(out) as temporary:
        draw_maps(picture, temporary)
