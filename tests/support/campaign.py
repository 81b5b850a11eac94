"""A small camera with every defect at once, and the captures that calibrate it, made by `tests.support.defects`."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Optics, Pixel, Target, Waveform
from cadtof_cli.capture.toml import toml_text
from tests.support.defects import DefectiveCamera, Defects, qvga_metadata
from tests.support.run_cadtof import cadtof

PIXELS = (60, 80)
C_M_PER_NS = 0.299792458

ALL_DEFECTS = Defects(
    offset_v=0.02,
    hot_share=0.002,
    phase_rad=(0.1, 0.3, -0.2),
    gain=(1.0, 0.8, 0.9),
    sc2_gain=1.05,
    pixel_phase_rad=0.05,
    pixel_gain=0.02,
    petzval_m=(0.06, -0.02),
    seed=7,
)

TARGETS_M = (0.5, 1.0, 1.7, 2.4, 3.0)

CARD_M = 0.75


def camera(
    defects: Defects = ALL_DEFECTS,
    *,
    waveform: Waveform = "sine",
    harmonics: int = 2,
    pixels: tuple[int, int] = PIXELS,
    n_av: float = 1e5,
) -> DefectiveCamera:
    """Return a camera of any size that has the field of view of a QVGA camera."""
    metadata = CaptureMetadata(
        modulation=Modulation(periods_ns=tuple(40.0 / h for h in range(1, harmonics + 1)), waveform=waveform),
        pixel=Pixel(integration_length=n_av),
        optics=Optics(focal_length_px=0.875 * pixels[1], principal_point_px=((pixels[1] - 1) / 2, (pixels[0] - 1) / 2)),
    )
    return DefectiveCamera(metadata=qvga_metadata(metadata), pixels=pixels, defects=defects)


def write(
    folder: Path, camera: DefectiveCamera, frames: list[NDArray[np.uint16]], *, distance_m: float | None = None
) -> Path:
    """Write frames as a capture folder."""
    folder.mkdir(parents=True)
    metadata = replace(camera.metadata, target=Target(distance_m=distance_m))
    (folder / "capture.toml").write_text(toml_text(metadata))
    for index, frame in enumerate(frames):
        tifffile.imwrite(folder / f"frame_{index:04}.tif", frame, photometric="minisblack", metadata={"axes": "HCYX"})
    return folder


def covered(camera: DefectiveCamera, *, count: int, seed: int = 1) -> list[NDArray[np.uint16]]:
    """Return frames recorded with the lens covered."""
    nothing = np.zeros((1, *camera.pixels))
    return camera.frames(nothing, nothing, count=count, seed=seed)


def wall(
    camera: DefectiveCamera, distance_m: float, *, tilt_deg: tuple[float, float] = (0.0, 0.0), count: int, seed: int
) -> list[NDArray[np.uint16]]:
    """Return frames of a wall at ASR 2."""
    ranges = camera.wall_range_m(distance_m, tilt_deg)[np.newaxis]
    return camera.frames(ranges, np.full_like(ranges, 1.0 / 3.0), count=count, seed=seed)


def card(
    camera: DefectiveCamera,
    *,
    count: int,
    seed: int,
    separations_ns: tuple[float, float] = (6.0, 20.0),
    clean: float = 1 / 6,
    weakest: float = 0.1,
) -> list[NDArray[np.uint16]]:
    """Return frames of the two-path card: direct path at `CARD_M`, ASR 2, MPI from the ratio `weakest` at the top to 0.6
    at the bottom; the first rows have no MPI."""
    height, width = camera.pixels
    separation = np.broadcast_to(np.linspace(*separations_ns, width), (height, width))
    ratio = np.broadcast_to(np.linspace(weakest, 0.6, height)[:, np.newaxis], (height, width)).copy()
    ratio[: round(clean * height)] = 0.0
    total = 3.0 + ratio
    ranges = np.stack([np.full((height, width), CARD_M), CARD_M + 0.5 * C_M_PER_NS * separation])
    return camera.frames(ranges, np.stack([1.0 / total, ratio / total]), count=count, seed=seed)


@dataclass(frozen=True)
class Campaign:
    """A camera, and folders of its calibration captures."""

    seen: DefectiveCamera
    dark: Path
    targets: tuple[Path, ...]
    walls: tuple[Path, Path]


def record_campaign(folder: Path, camera: DefectiveCamera) -> Campaign:
    """Record 20 covered frames, 10 of a target at each of five distances, and 10 of each of two tilted walls."""
    dark = write(folder / "dark", camera, covered(camera, count=20))
    targets = tuple(
        write(folder / f"target_{index}", camera, wall(camera, d, count=10, seed=10 + index), distance_m=d)
        for index, d in enumerate(TARGETS_M)
    )
    near = write(folder / "wall_1m", camera, wall(camera, 1.0, tilt_deg=(3.0, -2.0), count=10, seed=20))
    far = write(folder / "wall_3m", camera, wall(camera, 3.0, tilt_deg=(-2.0, 4.0), count=10, seed=21))
    return Campaign(camera, dark, targets, (near, far))


def calibrate(campaign: Campaign, out: Path) -> None:
    """Measure all parts of a calibration from a campaign."""
    for step in (("dark", campaign.dark), ("response", *campaign.targets), ("petzval", *campaign.walls)):
        done = cadtof("calibrate", *step, "-o", out)
        assert done.status == 0, done.err
