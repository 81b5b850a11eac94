"""Render random rooms as captures with truth: the rooms on which diffuse MPI is measured.

`python scripts/render_rooms.py OUT --seeds 0-11` writes OUT/room_0000_h2 (periods 40 and 20 ns), OUT/room_0000_h3 (13.3
ns as well, with the same light for all harmonics together) and so on. Existing folders are kept, so that an interrupted
run can go on. The light of a room is traced once, which takes some 8 s on one core.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from with_truth import at_length, seed_range

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.files.atomic import new_folder
from cadtof_cli.simulation.pixel.statistics import VoltageStatistics
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Band, Exposure, frame_voltages
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.workflows.simulate.record import RecordSettings, expose, write_capture

FOCAL_PER_WIDTH = (0.72, 1.05)
"""Limits of the focal length as a multiple of the width: lenses from 70° to 51° across. The seed draws the lens."""


def main() -> None:
    """Render the rooms that do not exist yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the captures")
    parser.add_argument("--seeds", default="0-11", help="first and last seed")
    parser.add_argument(
        "--periods-ns", default="40,20,13.333333333333334", help="modulation periods, the fundamental first"
    )
    parser.add_argument("--fewest", type=int, default=2, help="number of harmonics of each room's smallest capture")
    parser.add_argument("--integration-length", type=float, default=1e5, help="n_av of a capture of two harmonics")
    parser.add_argument("--asr", type=float, default=2.0, help="ambient photons over direct photons")
    parser.add_argument("--light-paths", type=int, default=128, help="light paths from every fourth pixel")
    parser.add_argument("--tracing-seed", type=int, default=0, help="seed of the light paths alone")
    parser.add_argument("--lamp-offset-m", default="0,0,0", help="from camera to lamp: right, down, forward")
    parser.add_argument("--waveform", default="sine", choices=("sine", "triangle"), help="waveform of the modulation")
    parser.add_argument("--net-fill", type=float, help="share of light that a net in the middle of the view sends back")
    parser.add_argument("--width", type=int, default=320, help="columns; rows are three quarters of it")
    chosen = parser.parse_args()
    periods = tuple(float(period) for period in chosen.periods_ns.split(","))
    modulation = Modulation(periods_ns=periods, waveform=chosen.waveform)
    right, down, forward = (float(part) for part in chosen.lamp_offset_m.split(","))
    for seed in seed_range(chosen.seeds):
        folders = {n: chosen.out / f"room_{seed:04d}_h{n}" for n in range(chosen.fewest, len(periods) + 1)}
        if not all(folder.exists() for folder in folders.values()):
            scene = RandomRoom(
                seed=seed,
                lamp_offset_m=(right, down, forward),
                asr=chosen.asr,
                light_paths=chosen.light_paths,
                tracing_seed=chosen.tracing_seed,
                net_fill=chosen.net_fill,
            )
            _render(_exposure(scene, modulation, chosen.integration_length, chosen.width), folders)


def _exposure(scene: RandomRoom, modulation: Modulation, integration_length: float, width: int) -> Exposure:
    share = np.random.default_rng(np.random.SeedSequence(scene.seed, spawn_key=(9,))).uniform(*FOCAL_PER_WIDTH)
    camera = Camera(width=width, height=width * 3 // 4, focal_length_px=round(share * width, 1))
    metadata = CaptureMetadata(
        modulation=modulation,
        pixel=Pixel(integration_length=float(round(integration_length * 2 / len(modulation.periods_ns)))),
        optics=replace(camera.optics, lamp_offset_m=scene.lamp_offset_m if any(scene.lamp_offset_m) else None),
        voltage=camera.voltage,
    )
    return Exposure(scene=scene, camera=camera, metadata=metadata, seed=scene.seed)


def _render(exposure: Exposure, folders: dict[int, Path]) -> None:
    """Trace a room once, and write a capture per folder, with as many harmonics as the folder asks for."""
    traced = expose(exposure)
    for harmonics, folder in folders.items():
        if not folder.exists():
            _write(*_first_harmonics(exposure, traced, harmonics), folder)
            print(f"{folder}: {exposure.scene.summary}", flush=True)


def _first_harmonics(exposure: Exposure, traced: Band, harmonics: int) -> tuple[Exposure, Band]:
    """Return the exposure and the light of fewer harmonics, each with a larger share of the same light."""
    modulation = exposure.metadata.modulation
    length = float(round(exposure.integration_length * len(modulation.periods_ns) / harmonics))
    longer, whole = at_length(exposure, traced, length)
    fewer = replace(longer.metadata, modulation=replace(modulation, periods_ns=modulation.periods_ns[:harmonics]))
    voltages = whole.voltages
    statistics = VoltageStatistics(voltages.means_v[:harmonics], voltages.covariances_v2[:harmonics])
    return replace(longer, metadata=fewer), Band(statistics, traced.truth)


def _write(exposure: Exposure, whole: Band, folder: Path) -> None:
    with new_folder(folder) as scratch:
        write_capture(
            scratch,
            [frame_voltages(exposure, whole, 0)],
            exposure=exposure,
            settings=RecordSettings(),
            truth=whole.truth,
            comments=(f"random room: {exposure.scene.summary}", f"scene: {exposure.scene!r}"),
        )


if __name__ == "__main__":
    main()
