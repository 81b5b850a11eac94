"""Measure what a tail costs on a wall without MPI: `python scripts/flat_walls.py` prints the rows of docs/diffuse.md."""

import argparse

import numpy as np
from with_truth import resolved, with_length

from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.resolver.settings import MpiModel, SolverName
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Band, Exposure
from cadtof_cli.simulation.scene.scenes import Wall
from cadtof_cli.workflows.simulate.record import expose

INTEGRATION_LENGTHS = (2e3, 1e4, 1e5, 1e6)

DISTANCES_M = (1.0, 2.0, 3.5)


def main() -> None:
    """Print a row per integration length: errors of one path, and of a tail that is forced on the wall."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("| wall without MPI, n_av | one path, cm | `--mpi-model diffuse`, cm | ratio |")
    print("|---|---|---|---|")
    walls = [(wall, expose(wall)) for wall in map(exposure, DISTANCES_M)]
    for length in INTEGRATION_LENGTHS:
        errors = np.array([[error_cm(*wall, length, *way) for way in WAYS] for wall in walls])
        one, forced = np.exp(np.mean(np.log(errors), axis=0))
        print(f"| {length:.0f} | {one:.3f} | {forced:.3f} | {forced / one:.2f} |", flush=True)


WAYS: tuple[tuple[SolverName, MpiModel], ...] = (("one-path", "discrete"), ("two-path", "diffuse"))


def exposure(distance_m: float) -> Exposure:
    """Return a wall before a QVGA camera."""
    camera = Camera()
    metadata = CaptureMetadata(pixel=Pixel(integration_length=1e5), optics=camera.optics)
    return Exposure(scene=Wall(distance_m=distance_m), camera=camera, metadata=metadata, seed=11)


def error_cm(wall: Exposure, whole: Band, length: float, solver: SolverName, model: MpiModel) -> float:
    """Return the median error of a wall's range at an integration length, in cm."""
    found = resolved(*with_length(wall, whole, length), model=model, solver=solver).maps.layer(DIRECT_DEPTH)
    return 100.0 * float(np.nanmedian(np.abs(found - whole.truth[DIRECT_DEPTH])))


if __name__ == "__main__":
    main()
