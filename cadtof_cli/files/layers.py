"""Files of named layers in every format that holds them: maps, truth and the maps of a calibration.

A file that cannot be read raises a FrameError, one that cannot be written an OutputError.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.files.atomic import PartialFile, atomic_write
from cadtof_cli.files.digests import Digest, file_digest
from cadtof_cli.files.formats import detect_format, format_by_suffix
from cadtof_cli.files.maps import STATUS, DamagedMapsError, DepthMaps, MapHeader, NotMapsError

STATUS_LIMIT = 2**13
"""All numbers below it are status bits: those of `StatusBit`, which this room may not import."""


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the layers of a map or truth file by name, (Y, X) each, as they are stored; the status becomes uint32.

    Layers are the channels of all parts of an EXR file, or the named channels of an OME-TIFF. An OME-TIFF holds the
    status bits as float numbers.

    Raises:
        NotMapsError: the layers have no names.
        FrameError: the file cannot be read, is damaged, has two layers of one name, or its status holds numbers that
            cannot be bits.
    """
    kind = detect_format(path)
    if kind.layers is None:
        raise NotMapsError(f"{path}: found {kind.title}, expected a format of named maps")
    layers = kind.layers().read_layers(path)
    for layer in layers.values():
        _make_nans_quiet(layer)
    status = layers.get(STATUS)
    if status is None:
        return layers
    # as float64, in which every number keeps its value
    numbers = status.astype(np.float64)
    are_bits = np.isfinite(numbers) & (numbers >= 0) & (numbers < STATUS_LIMIT) & (numbers == np.floor(numbers))
    # every pixel of a map has a bit, but numbers that were scaled to 0 … 1 may be too small for half floats
    if not are_bits.all() or (status.dtype.kind == "f" and not numbers.any()):
        raise DamagedMapsError(
            f"{path}: damaged maps: their status holds numbers that are no bits; a program that scales numbers may have"
            " written them"
        )
    return layers | {STATUS: status.astype(np.uint32, copy=False)}


def _make_nans_quiet(layer: NDArray[Any]) -> None:
    """Make all NaNs of a layer quiet: signalling NaNs would raise a warning at every conversion."""
    if layer.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            # multiplied by 1, because adding 0 would turn −0 into 0; in place, because a map is a lot of memory
            np.multiply(layer, layer.dtype.type(1), out=layer)


def read_facts(path: Path, /) -> dict[str, str]:
    """Return the facts in the header of a map file by name, such as the kind of depth; empty if there are none."""
    kind = detect_format(path)
    return kind.layers().read_facts(path) if kind.layers else {}


def stage_maps(path: Path, maps: DepthMaps, /, *, header: MapHeader, token: str) -> tuple[PartialFile, str]:
    """Write maps under a temporary name, in the format of `path`'s suffix; return the file and the digest of its bytes.

    The caller commits or discards the file. A commit waits for the disk, so the caller can do other work at the same
    time.
    """
    kind = format_by_suffix(path)
    assert kind is not None
    assert kind.layers is not None
    partial = PartialFile(path, token=token)
    with partial.filling(maps.pages.nbytes):
        parts = kind.layers().write_maps(partial.temporary, maps, header=header)
        if not parts:
            return partial, file_digest(partial.temporary)
        partial.parts, digest = parts, Digest()
        for part in parts:
            digest.update(part)
        return partial, digest.hexdigest()


def write_layers(path: Path, layers: Mapping[str, NDArray[Any]], /, *, lossy: bool = False) -> None:
    """Write (Y, X) layers, float16, float32 or uint32, as channels of one EXR file, which appears whole or not at all.

    If `lossy`, values are rounded to 16 bits of mantissa, by PXR24 compression: to 0.06 mm at 4 to 8 m. Smooth maps
    then take a quarter of the bytes that lossless compression needs.
    """
    from cadtof_cli.files.exr import write_exr

    if lossy:
        layers = {name: layer.astype(np.float32) for name, layer in layers.items()}
    with atomic_write(path) as temporary:
        write_exr(temporary, layers, compression="pxr24" if lossy else "zip")
