"""Voltages written as a camera would: a capture folder with frames, `capture.toml`, and the truth beside them."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.capture.toml import FILE_NAME, toml_text
from cadtof_cli.files.formats import format_by_name
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.maps import write_layers
from cadtof_cli.simulation.scene.camera import Camera

TRUTH_NAME = "truth.exr"


def write_capture(
    folder: Path,
    frames: Iterable[Float],
    /,
    *,
    truth: Mapping[str, Float],
    metadata: CaptureMetadata,
    camera: Camera,
    frame_format: str,
    compress: bool = False,
    comments: tuple[str, ...] = (),
) -> None:
    """Write frames, `capture.toml` and `truth.exr` into a folder that exists.

    Args:
        folder: where to write.
        frames: voltages in V, (H, 2, Y, X) each.
        truth: (Y, X) layers by name, NaN where there is no answer.
        metadata: of the modulation, pixel and pulse; voltage and optics are the camera's.
        camera: converts volts to counts, where the format holds counts.
        frame_format: name of a format that frames are recorded in, such as tif for counts or exr for volts.
        compress: smaller files, losslessly.
        comments: lines on top of `capture.toml`.
    """
    kind = format_by_name(frame_format)
    if kind.recording is None:
        raise ValueError(f"format {frame_format}: frames are not recorded in it")
    (folder / FILE_NAME).write_text(toml_text(metadata, comments=comments), encoding="utf-8")
    write_layers(folder / TRUTH_NAME, truth, lossy=True)
    files, layout = kind.recording(), FrameLayout(metadata.modulation.harmonics)
    for index, voltages_v in enumerate(frames):
        stored = camera.counts_from_voltages(voltages_v) if kind.counts else voltages_v
        files.write_frame(folder / f"frame_{index:04d}.{kind.name}", stored, layout=layout, compress=compress)
