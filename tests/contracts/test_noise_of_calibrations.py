"""The noise of a calibration's own frames is part of sigma, and of the noise that tests of the MPI model assume."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.calibration.apply import frame_correction
from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.calibration.store import Calibration, Part, load_calibration, save_part
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Waveform
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.phasors.voltages import phasors_from_stored
from cadtof_cli.pipeline.frame import ResolvedFrame, resolve_frame
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, frame_voltages
from cadtof_cli.simulation.scene.scenes import Card
from cadtof_cli.workflows.simulate.record import expose
from tests.support.calibrations import curved, response_quality

CAMERA = Camera(width=96, height=72)
PERIODS_NS = (40.0, 20.0, 40 / 3)
FRAMES = 16
SCENE = Card(distance_m=1.5, separations_ns=(8.0, 8.0), mpi_ratios=(0.1, 0.1), clean_share=0.0)
METADATA = CaptureMetadata(
    modulation=Modulation(periods_ns=PERIODS_NS), pixel=Pixel(integration_length=1e5), optics=CAMERA.optics
)
ORIGIN = Origin(
    captures=("made up",),
    frames=20,
    pixels=(CAMERA.height, CAMERA.width),
    periods_ns=PERIODS_NS,
    waveform="sine",
)


@cache
def recorded() -> tuple[list[Float], Float]:
    """Return the voltages of FRAMES frames, and the true range."""
    shown = Exposure(scene=SCENE, camera=CAMERA, metadata=METADATA, seed=61310)
    band = expose(shown)
    return [np.asarray(frame_voltages(shown, band, index)) for index in range(FRAMES)], band.truth["direct.depth"]


def dark() -> DarkCalibration:
    """Return the dark part of a camera without offsets, measured from twenty frames with the noise of ambient light."""
    shape = (len(PERIODS_NS), 2, *ORIGIN.pixels)
    noise_v = METADATA.modulation.amplitude_v * np.sqrt(0.5 / (2e5 - 1.0))
    offset = np.random.default_rng(61311).normal(0.0, noise_v / np.sqrt(20), shape)
    noise = np.full(shape, noise_v, np.float32)
    return DarkCalibration(ORIGIN, offset.astype(np.float32), noise, np.zeros(ORIGIN.pixels, np.uint32))


def response(origin: Origin = ORIGIN) -> ResponseCalibration:
    """Return the response of a camera whose pixels have no phases; each phase is known to 1.5 mrad."""
    shape = (len(PERIODS_NS), *origin.pixels)
    phase = np.random.default_rng(61312).normal(0.0, 0.0015, shape).astype(np.float32)
    quality = response_quality(3, phase_stderr_rad=0.0015)
    gain, straight = np.ones(shape, np.float32), curved(0.0, 0.0, (0.0, 0.0))
    return ResponseCalibration(origin, ideal_response(METADATA), phase, gain, straight, quality)


def resolved(folder: Path, parts: tuple[Part, ...], frames: int, metadata: CaptureMetadata = METADATA) -> ResolvedFrame:
    """Resolve the mean of the first `frames` frames with the parts of a calibration."""
    for part in parts:
        save_part(folder, part)
    calibration: Calibration | None = load_calibration(folder) if parts else None
    use = CalibrationUse(folder, calibration.digest) if calibration else None
    volts, truth = recorded()
    mean = FrameMean(np.mean(volts[:frames], axis=0), np.full(truth.shape, float(frames)), volts[0].dtype)
    return resolve_frame(mean, plan=FramePlan(metadata=metadata, calibration=use), calibration=calibration)


@pytest.mark.parametrize("frames", [1, 4, FRAMES])
@pytest.mark.parametrize("parts", [(), (dark(),), (response(),), (dark(), response())], ids=len)
def test_sigma_includes_the_noise_of_the_calibration(tmp_path: Path, parts: tuple[Part, ...], frames: int) -> None:
    """This holds for any number of frames. Without the noise of the calibration, only .4 of the errors of a mean of
    sixteen frames were within one sigma.
    """
    assert_sigma_is_true(resolved(tmp_path, parts, frames))


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_offsets_that_are_wrong_by_their_standard_error_move_phasors_by_their_noise(waveform: Waveform) -> None:
    """The amplitude of a triangle's phasors is 8/π² of the modulation amplitude."""
    metadata = replace(METADATA, modulation=Modulation(periods_ns=PERIODS_NS, waveform=waveform))
    measured = replace(dark(), origin=replace(ORIGIN, waveform=waveform))
    found = frame_correction(Calibration(dark=measured), metadata, np.dtype(np.float64), ORIGIN.pixels)
    frame = np.zeros((len(PERIODS_NS), 2, CAMERA.height * CAMERA.width))
    wrong = frame + np.array(measured.offset_stderr_v())[:, np.newaxis, np.newaxis]
    moved = phasors_from_stored(wrong, found.phasor_map) - phasors_from_stored(frame, found.phasor_map)
    assert found.noise is not None
    for part in (moved.real, moved.imag):
        np.testing.assert_allclose(
            part**2, np.broadcast_to(np.array(found.noise.dark)[:, np.newaxis], part.shape), rtol=1e-9
        )


@pytest.mark.parametrize("parts", [(dark(),), (response(),)], ids=len)
def test_an_estimated_noise_already_includes_the_noise_of_the_calibration(
    tmp_path: Path, parts: tuple[Part, ...]
) -> None:
    """The differences between pixels of a mean come from the noise of the frames and of the calibration together."""
    unknown = replace(METADATA, pixel=Pixel())
    assert unknown.pixel.integration_length is None
    assert_sigma_is_true(resolved(tmp_path, parts, FRAMES, unknown))


@pytest.mark.parametrize("dead", [np.s_[..., 0], np.s_[..., 6:]])
def test_dead_pixels_do_not_change_sigma_of_the_others(tmp_path: Path, dead: tuple[slice, ...]) -> None:
    """The noise of the response grows with the typical light of a frame, which 256 pixels show. With 256 rows, these were
    the first column."""
    size = (256, 24)
    save_part(tmp_path, response(replace(ORIGIN, pixels=size)))
    calibration = load_calibration(tmp_path)
    settings = MapSettings(resolver=ResolverSettings(order="1", mpi_model="discrete"))
    plan = FramePlan(metadata=METADATA, settings=settings, calibration=CalibrationUse(tmp_path, calibration.digest))
    whole = np.tile(np.mean(recorded()[0], axis=0)[..., :64, :24], (4, 1))
    part = whole.copy()
    part[dead] = np.nan
    sigmas = [
        resolve_frame(
            FrameMean(mean, np.full(size, float(FRAMES)), mean.dtype), plan=plan, calibration=calibration
        ).maps.layer(DIRECT_SIGMA)
        for mean in (whole, part)
    ]
    alive = np.isfinite(sigmas[1])
    assert alive.sum() > 1000
    np.testing.assert_allclose(sigmas[1][alive], sigmas[0][alive], rtol=0.03)


def assert_sigma_is_true(found: ResolvedFrame) -> None:
    maps = found.maps
    error = np.abs(maps.layer(DIRECT_DEPTH) - recorded()[1])
    known = np.isfinite(error)
    assert known.mean() > 0.99
    sigma = maps.layer(DIRECT_SIGMA)[known]
    assert 0.6 < (error[known] < sigma).mean() < 0.77
    assert 0.9 < (error[known] < 2.0 * sigma).mean() < 0.985


@pytest.mark.parametrize("parts", [(dark(),), (response(),), (dark(), response())], ids=len)
def test_two_paths_are_not_taken_for_a_tail_because_of_a_noisy_calibration(
    tmp_path: Path, parts: tuple[Part, ...]
) -> None:
    """The noise of the calibration was once taken for the residual of two paths fitted to a tail.

    The errors were then 2 cm instead of .5 mm.
    """
    found = resolved(tmp_path, parts, FRAMES)
    assert found.mpi is not None
    assert found.mpi.taken == "discrete"
    assert np.nanmedian(np.abs(found.maps.layer(DIRECT_DEPTH) - recorded()[1])) < 0.001
