"""Harmonics whose noise is not that of the integration lengths."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Voltage, Waveform
from cadtof_cli.doubts.frame import camera_doubts
from cadtof_cli.doubts.other_noise import other_noise
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, expose_band, frame_voltages
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import Card, Wall

CAMERA = Camera(width=64, height=48)
MODULATION = Modulation(periods_ns=(40.0, 20.0, 13.3333))


def frame(
    lengths: tuple[float, ...], scene: Scene, *, waveform: Waveform = "sine", camera: Camera = CAMERA
) -> tuple[Stored, CaptureMetadata]:
    """Return the counts of a frame, and its metadata with the lengths."""
    modulation = replace(MODULATION, waveform=waveform)
    metadata = CaptureMetadata(
        modulation=modulation, pixel=Pixel(integration_length=lengths), voltage=camera.voltage, optics=camera.optics
    )
    shown = Exposure(scene=scene, camera=camera, metadata=metadata, seed=2)
    return camera.counts_from_voltages(frame_voltages(shown, expose_band(shown, slice(0, camera.height)), 0)), metadata


def with_length(metadata: CaptureMetadata, length: float | tuple[float, ...] | None) -> CaptureMetadata:
    return replace(metadata, pixel=Pixel(integration_length=length))


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
@pytest.mark.parametrize("lengths", [(3e4, 1e5, 1e5), (1e5, 1e4, 1e5), (1e5, 1e5, 3e3)])
def test_one_length_for_harmonics_with_other_noise_is_doubted(lengths: tuple[float, ...], waveform: Waveform) -> None:
    stored, metadata = frame(lengths, Wall(distance_m=2.0, asr=5.0), waveform=waveform)
    assert other_noise(stored, metadata) is None
    doubt = str(other_noise(stored, with_length(metadata, 5e4)))
    seen = re.fullmatch(r"the harmonics scatter as with integration_length = \[(.*)\], not as given: .*", doubt)
    assert seen is not None
    assert [float(length) for length in seen[1].split(", ")] == pytest.approx(lengths, rel=0.2)
    assert doubt in camera_doubts(stored, with_length(metadata, 5e4))


@pytest.mark.parametrize("scene", [Wall(distance_m=1.0, tilt_deg=(40.0, 0.0), asr=2.0), Card()])
@pytest.mark.parametrize("length", [1e3, 1e5, 1e7])
def test_equal_noise_is_not_doubted_nor_what_cannot_be_told(scene: Scene, length: float) -> None:
    stored, metadata = frame((length,) * 3, scene)
    assert other_noise(stored, with_length(metadata, length)) is None
    unequal, _ = frame((1e5, 1e4, 1e5), scene)
    assert other_noise(unequal, with_length(metadata, None)) is None
    # counts hide the noise
    coarse = np.rint((unequal.astype(float) - 8192) / 50).astype(np.int16)
    coarse_voltage = Voltage(volts_per_count=50 * CAMERA.volts_per_count)
    assert other_noise(coarse, replace(with_length(metadata, 1e5), voltage=coarse_voltage)) is None
    # too few pixels
    assert other_noise(unequal[:, :, :8], with_length(metadata, 1e5)) is None
