"""Measure the scatter of `--scene room`: how far two renderings of a room differ, beside the MPI that they render.

`python scripts/room_scatter.py --seeds 0-5` prints a row per room: CPU seconds of one rendering without noise; the
median depth that MPI adds to the first phasor; median and 90 % of the scatter of the first phasor's depth (differences
over √2).
"""

import argparse
import time

import numpy as np
from with_truth import seed_range

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.units import metres_per_radian
from cadtof_cli.workflows.simulate.record import expose


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0-5", help="first and last seed")
    parser.add_argument("--light-paths", type=int, default=256, help="light paths from every fourth pixel")
    parser.add_argument("--width", type=int, default=320, help="columns; rows are three quarters of it")
    chosen = parser.parse_args()
    print("| seed | CPU s | MPI, median cm | scatter, median cm | 90 % cm |\n|---|---|---|---|---|")
    for seed in seed_range(chosen.seeds):
        start = time.process_time()
        (one, depth_m), (other, _) = (
            phasor(RandomRoom(seed=seed, light_paths=chosen.light_paths, tracing_seed=tracing), chosen.width)
            for tracing in (0, 1)
        )
        seconds = (time.process_time() - start) / 2.0
        seen = np.isfinite(depth_m)
        scale_cm = 100.0 * metres_per_radian(40.0)
        scatter_cm = np.abs(np.angle(one[seen] * np.conj(other[seen]))) * scale_cm / np.sqrt(2.0)
        direct = np.exp(1j * depth_m[seen] / metres_per_radian(40.0))
        mpi_cm = np.median(np.abs(np.angle(one[seen] * np.conj(direct)))) * scale_cm
        middle, most = np.percentile(scatter_cm, [50, 90])
        print(f"| {seed} | {seconds:.1f} | {mpi_cm:.1f} | {middle:.3f} | {most:.3f} |", flush=True)


def phasor(scene: RandomRoom, width: int) -> tuple[Complex, Float]:
    """Return the first phasor without noise, and the true ranges in m."""
    camera = Camera(width=width, height=width * 3 // 4)
    exposure = Exposure(scene=scene, camera=camera, metadata=CaptureMetadata(pixel=Pixel(integration_length=1e5)))
    whole = expose(exposure)
    first, second = whole.voltages.means_v[0]
    return first + 1j * second, whole.truth[DIRECT_DEPTH]


if __name__ == "__main__":
    main()
