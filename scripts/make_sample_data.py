"""Make the captures in sample_data/ from a seed: card, corner, wall and inter-reflection, each with its truth.

`sample_data/room` is not made here and stays as it is: it was rendered elsewhere, as its capture.toml says.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from cadtof_cli.capture.metadata import CaptureMetadata, Pixel, Target
from cadtof_cli.execution.workers import Workers
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import Card, Corner, InterReflection, Wall
from cadtof_cli.workflows.simulate.record import RecordSettings, record_scene

ROOT = Path(__file__).resolve().parent.parent
SEED = 2024
WALL_M = 3.35


def main() -> None:
    """Write the captures, and replace those that exist."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "sample_data", help="folder of the captures")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for name, (exposure, settings) in captures().items():
        with tempfile.TemporaryDirectory(dir=out) as scratch:
            record_scene(exposure, Path(scratch) / name, settings=settings, workers=Workers(jobs=2))
            shutil.rmtree(out / name, ignore_errors=True)
            (Path(scratch) / name).rename(out / name)
        size = sum(file.stat().st_size for file in (out / name).iterdir())
        print(f"{out / name}: {size / 1e6:.2f} MB")


def captures() -> dict[str, tuple[Exposure, RecordSettings]]:
    """Return every recording, and how it is stored, by the name of its folder."""
    petzval = Camera(petzval_m=(-0.06, 0.015))
    return {
        "card": _capture(Card(), frame_format="exr"),
        "corner": _capture(Corner(asr=1.0)),
        "wall": _capture(Wall(distance_m=WALL_M), camera=petzval, target_m=WALL_M),
        "inter-reflection": _capture(InterReflection()),
    }


def _capture(
    scene: Scene, *, frame_format: str = "tif", camera: Camera | None = None, target_m: float | None = None
) -> tuple[Exposure, RecordSettings]:
    camera = camera or Camera()
    metadata = CaptureMetadata(
        pixel=Pixel(integration_length=100_000.0),
        optics=camera.optics,
        target=Target(distance_m=target_m),
        voltage=camera.voltage,
    )
    exposure = Exposure(scene=scene, camera=camera, metadata=metadata, seed=SEED)
    return exposure, RecordSettings(frame_format=frame_format, compress=not isinstance(scene, Corner))


if __name__ == "__main__":
    main()
