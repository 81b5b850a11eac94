"""Simulate and resolve a box like Cornell's: `python scripts/cornell.py` prints its rows of docs/diffuse.md."""

import argparse
import tempfile
from pathlib import Path

from diffuse_accuracy import Row, measured

from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.metadata import Modulation, Pulse
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.rooms.cornell import CornellBox
from cadtof_cli.workflows.simulate.record import RecordSettings, record_scene, scene_exposure

PERIODS_NS = {
    "`simulate --scene cornell`": (40.0, 20.0),
    "the same box, three harmonics, the same light in all": (40.0, 20.0, 40.0 / 3),
}
"""Modulation periods by the name of the row."""

INTEGRATION_LENGTH = 2e5
"""n_av of all harmonics together."""


def main() -> None:
    """Record the scene of `cadtof simulate --scene cornell` with two and with three harmonics, and print the errors."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name, periods_ns in PERIODS_NS.items():
        print(recorded(periods_ns).line().replace("| cornell |", f"| {name} |", 1), flush=True)


def recorded(periods_ns: tuple[float, ...]) -> Row:
    """Record the box and return the errors of its one frame."""
    exposure = scene_exposure(
        CornellBox(),
        Camera(),
        modulation=Modulation(periods_ns=periods_ns),
        pulse=Pulse(),
        integration_length=float(round(INTEGRATION_LENGTH / len(periods_ns))),
        seed=0,
    )
    with tempfile.TemporaryDirectory() as place:
        record_scene(exposure, Path(place) / "cornell", settings=RecordSettings())
        (capture,) = find_captures([Path(place) / "cornell"])
        return measured(capture, "auto")


if __name__ == "__main__":
    main()
