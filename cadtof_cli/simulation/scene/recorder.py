"""Voltages written as a camera would: a capture folder with frames, `capture.toml`, and the truth beside them."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenEXR
import tifffile

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.capture.toml import FILE_NAME, toml_text
from cadtof_cli.simulation.scene.camera import Camera

FrameFormat = Literal["tif", "exr"]

FRAME_FORMATS: tuple[FrameFormat, ...] = ("tif", "exr")

TRUTH_NAME = "truth.exr"


def write_capture(
    folder: Path,
    frames: Iterable[Float],
    /,
    *,
    truth: Mapping[str, Float],
    metadata: CaptureMetadata,
    camera: Camera,
    frame_format: FrameFormat,
    compress: bool = False,
    comments: tuple[str, ...] = (),
) -> None:
    """Write frames, `capture.toml` and `truth.exr` into a folder that exists.

    Args:
        folder: where to write.
        frames: voltages in V, (H, 2, Y, X) each.
        truth: (Y, X) layers by name, NaN where there is no answer.
        metadata: of the modulation, pixel and pulse; voltage and optics are the camera's.
        camera: converts volts to the counts of a TIFF; EXR frames hold volts.
        frame_format: tif, uint16 with axes H C Y X, or exr, float32 channels H1.SC1, H1.SC2, H2.SC1, …
        compress: deflate in TIFF, ZIP in EXR.
        comments: lines on top of `capture.toml`.
    """
    (folder / FILE_NAME).write_text(toml_text(metadata, comments=comments), encoding="utf-8")
    write_layers(folder / TRUTH_NAME, truth)
    for index, voltages_v in enumerate(frames):
        path = folder / f"frame_{index:04d}.{frame_format}"
        if frame_format == "tif":
            _write_tiff(path, camera, voltages_v, compress=compress)
        else:
            _write_exr(path, metadata.modulation.harmonics, voltages_v, compress=compress)


def write_layers(path: Path, layers: Mapping[str, Float], /) -> None:
    """Write (Y, X) layers as float32 channels of one EXR file, rounded by its PXR24 compression to 2^-17 of each value.

    That is 0.05 mm at 6 m, and a quarter of the bytes that lossless compression needs for smooth maps.
    """
    channels = {name: np.ascontiguousarray(layer, dtype=np.float32) for name, layer in layers.items()}
    _exr(path, channels, OpenEXR.PXR24_COMPRESSION)


def _write_tiff(path: Path, camera: Camera, voltages_v: Float, *, compress: bool) -> None:
    tifffile.imwrite(
        path,
        camera.counts_from_voltages(voltages_v),
        photometric="minisblack",
        metadata={"axes": "HCYX"},
        compression="zlib" if compress else None,
    )


def _write_exr(path: Path, harmonics: tuple[int, ...], voltages_v: Float, *, compress: bool) -> None:
    planes = {
        f"H{harmonic}.SC{channel + 1}": np.ascontiguousarray(voltages_v[row, channel], dtype=np.float32)
        for row, harmonic in enumerate(harmonics)
        for channel in range(2)
    }
    _exr(path, planes, OpenEXR.ZIP_COMPRESSION if compress else OpenEXR.NO_COMPRESSION)


def _exr(path: Path, channels: dict[str, Any], compression: Any) -> None:
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels, num_threads=0).write(str(path))
