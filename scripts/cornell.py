"""A box in the manner of Cornell's, simulated and resolved: `python scripts/cornell.py` prints its row of docs/diffuse.md."""

import tempfile
from pathlib import Path

from diffuse_accuracy import measured

from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.metadata import Modulation, Pulse
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.rooms.cornell import CornellBox
from cadtof_cli.workflows.simulate.record import RecordSettings, record_scene, scene_exposure


def main() -> None:
    """Record what `cadtof simulate --scene cornell` does, and print the errors."""
    exposure = scene_exposure(
        CornellBox(), Camera(), modulation=Modulation(), pulse=Pulse(), integration_length=1e5, counts=True, seed=0
    )
    with tempfile.TemporaryDirectory() as place:
        record_scene(RecordSettings(exposure=exposure), Path(place) / "cornell")
        (capture,) = find_captures([Path(place) / "cornell"])
        row = measured(capture, "auto")
    print(row.line().replace("| cornell |", "| `simulate --scene cornell` |", 1))


if __name__ == "__main__":
    main()
