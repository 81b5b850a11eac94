"""`cadtof preview`: one picture of a frame's maps."""

from pathlib import Path

import numpy as np

from cadtof_cli.errors import CaptureError
from cadtof_cli.figures.kinds import require_picture
from cadtof_cli.figures.maps import MapPicture, draw_maps
from cadtof_cli.files.atomic import whole_file
from cadtof_cli.files.maps import STATUS, read_layers
from cadtof_cli.maps.layers import CONFIDENCE, DIRECT_DEPTH, DIRECT_SIGMA, MPI_DEPTH
from cadtof_cli.workflows.inspect.evaluate import direct_depth, same_size
from cadtof_cli.workflows.inspect.first_phasors import first_phasors
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import read_run


def preview_maps(maps: Path, /, *, out: Path, truth: Path | None, overwrite: bool, progress: Progress) -> None:
    """Draw the first map of a folder, or a map file, into the picture `out`; with truth also the errors.

    Raises:
        CadtofError: the maps or the truth cannot be read or lack layers, or the PNG cannot be written.
    """
    kind = require_picture(out, overwrite=overwrite)
    run = read_run(maps)
    path = run.require_maps()[0]
    layers = read_layers(path)
    missing = [name for name in (DIRECT_DEPTH, MPI_DEPTH, CONFIDENCE, DIRECT_SIGMA) if name not in layers]
    if missing:
        raise CaptureError(f"{path}: found layers {', '.join(layers)}; expected {', '.join(missing)} too")
    direct = layers[DIRECT_DEPTH].astype(np.float64)
    known, first_phasor = None, None
    if truth is not None:
        run.require_range_depth()
        known = run.cropped(direct_depth(truth))
        same_size(direct, known, path, truth)
        first_phasor = first_phasors(run, progress.say).depth(path, direct)
    mpi, confidence, sigma = (layers[name].astype(np.float64) for name in (MPI_DEPTH, CONFIDENCE, DIRECT_SIGMA))
    picture = MapPicture(
        title=f"{path.parent.name}/{path.name}",
        direct_m=direct,
        mpi_m=mpi,
        confidence_v=confidence,
        sigma_m=sigma,
        status=layers.get(STATUS, np.zeros(direct.shape)).astype(np.uint32),
        truth_m=known,
        first_phasor_m=first_phasor,
        depth="planar depth z" if run.depth_kind == "z" else "radial range",
    )
    with whole_file(out) as temporary:
        draw_maps(picture, temporary, kind=kind)
