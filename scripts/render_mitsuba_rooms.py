"""Render rooms as captures with truth by another program, Mitsuba with mitransient, to test the prediction of diffuse
MPI.

`python scripts/render_mitsuba_rooms.py OUT --seeds 0-2` renders 14 kinds of rooms. It writes OUT/ROOM_SEED_h2 (periods
40 and 20 ns) and OUT/ROOM_SEED_h3 (13.3 ns as well, with the same light for all harmonics together). The rooms are
kitchens and rooms with furniture that scene_synthesizer draws, stairs, a corridor, a bathroom, and rooms with curved
walls. Their surfaces are matt, glossy, metal, mirrors or glass; some rooms have windows. Existing folders are kept.

It needs `pip install mitsuba mitransient scene_synthesizer`, and a recent LLVM (19 is enough for Mitsuba 3.9, 16 is
not); DRJIT_LIBLLVM_PATH may name its library.
"""

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np
from mitsuba_rooms.rooms import ROOMS
from mitsuba_rooms.stage import Stage
from mitsuba_rooms.views import SAMPLES, View, drawn_view, moments, scene_of, seen
from with_truth import seed_range

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.capture.toml import FILE_NAME, toml_text
from cadtof_cli.files.atomic import new_folder
from cadtof_cli.files.formats import format_by_name
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.layers import write_layers
from cadtof_cli.simulation.pixel.averaging import averaging_gain
from cadtof_cli.simulation.pixel.statistics import (
    VoltageStatistics,
    draw_voltages,
    sample_covariance,
    sample_mean,
)
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.units import FWHM_PER_SIGMA

PERIODS_NS = (40.0, 20.0, 40.0 / 3)
HIGHEST = 6
"""Highest moment: twice the last harmonic, as the covariance of its voltages needs."""


def main() -> None:
    """Render the rooms that do not exist yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the captures")
    parser.add_argument("--rooms", default=",".join(ROOMS), help="names of the kinds of rooms")
    parser.add_argument("--seeds", default="0", help="first and last seed")
    parser.add_argument(
        "--even-lamp", action="store_true", help="a lamp that shines evenly all around instead of in a beam"
    )
    parser.add_argument("--samples", type=int, default=1024, help="number of light paths per pixel")
    parser.add_argument("--integration-length", type=float, default=1e5, help="n_av of a capture of two harmonics")
    parser.add_argument("--asr", type=float, default=3.0, help="ambient photons over the median of direct ones")
    parser.add_argument("--width", type=int, default=160, help="columns; rows are three quarters of it")
    chosen = parser.parse_args()
    for seed in seed_range(chosen.seeds):
        for name in chosen.rooms.split(","):
            folders = {n: chosen.out / f"{name}_{seed}_h{n}" for n in (2, 3)}
            if not all(folder.exists() for folder in folders.values()):
                _render(name, seed, folders, chosen)


def _render(name: str, seed: int, folders: dict[int, Path], chosen: argparse.Namespace) -> None:
    rng = np.random.default_rng([seed, list(ROOMS).index(name)])
    with tempfile.TemporaryDirectory() as scratch:
        stage = Stage(rng, Path(scratch))
        ROOMS[name](stage)
        view = drawn_view(stage, chosen.width, even=chosen.even_lamp)
        scene = scene_of(stage, view)
        light = moments(scene, period_ns=PERIODS_NS[0], highest=HIGHEST, samples=chosen.samples)
        direct = moments(scene, period_ns=PERIODS_NS[0], highest=0, samples=SAMPLES, bounces=2)[0].real
        range_m, scatters = seen(scene, view)
    ratio = np.divide(light[0].real - direct, direct, out=np.full_like(direct, np.nan), where=direct > 0)
    truth = {"direct.depth": np.where(scatters, range_m, np.nan), "mpi.ratio": ratio}
    ambient = chosen.asr * float(np.median(direct[direct > 0]))
    for harmonics, folder in folders.items():
        length = float(round(2 * chosen.integration_length / harmonics))
        if not folder.exists():
            _write(folder, light, ambient, truth, view, _metadata(view, harmonics, length), seed)
    print(
        f"{name}_{seed}: MPI over direct light {np.nanmedian(ratio):.2f}, {np.nanmax(range_m):.1f} m deep", flush=True
    )


def _camera(view: View) -> Camera:
    return Camera(width=view.width, height=view.shape[0], focal_length_px=round(view.focal_length_px, 2))


def _metadata(view: View, harmonics: int, length: float) -> CaptureMetadata:
    camera = _camera(view)
    return CaptureMetadata(
        modulation=Modulation(periods_ns=PERIODS_NS[:harmonics]),
        pixel=Pixel(integration_length=length),
        optics=camera.optics,
        voltage=camera.voltage,
    )


def _write(
    folder: Path,
    light: Complex,
    ambient: float,
    truth: dict[str, Float],
    view: View,
    metadata: CaptureMetadata,
    seed: int,
) -> None:
    """Write a capture of one frame, with the noise of its integration length."""
    voltages_v = draw_voltages(_statistics(light, ambient, metadata), np.random.default_rng(seed), draws=1)[0]
    modulation, files = metadata.modulation, format_by_name("tif").frames()
    with new_folder(folder) as scratch:
        (scratch / FILE_NAME).write_text(toml_text(metadata, comments=(f"{view!r}",)), encoding="utf-8")
        write_layers(scratch / "truth.exr", truth, lossy=True)
        counts = _camera(view).counts_from_voltages(voltages_v)
        files.write_frame(scratch / "frame_0000.tif", counts, layout=FrameLayout(modulation.harmonics), compress=True)


def _statistics(light: Complex, ambient: float, metadata: CaptureMetadata) -> VoltageStatistics:
    """Return the distribution of the voltages for light with these moments and even ambient light."""
    modulation = metadata.modulation
    spread_rad = 2 * math.pi * metadata.pulse.fwhm_ns / FWHM_PER_SIGMA / modulation.periods_ns[0]
    pulse = np.exp(-((np.arange(len(light)) * spread_rad) ** 2) / 2)
    shares = pulse[:, None, None] * light / (light[0].real + ambient)
    shares[0] = 1.0
    gain = averaging_gain(metadata.pixel.mean_length or 0.0)
    means, covariances = [], []
    for harmonic in modulation.harmonics:
        mean = sample_mean(shares, harmonic=harmonic, waveform=modulation.waveform)
        means.append(modulation.amplitude_v * np.stack([mean.real, mean.imag]))
        covariance = sample_covariance(shares, harmonic=harmonic, waveform=modulation.waveform)
        covariances.append(gain * modulation.amplitude_v**2 * covariance)
    return VoltageStatistics(np.stack(means), np.stack(covariances))


if __name__ == "__main__":
    main()
