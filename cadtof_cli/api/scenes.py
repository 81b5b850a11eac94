"""Simulated captures for Python: the captures of `cadtof simulate --scene`, in memory instead of files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_type_hints

import numpy as np

from cadtof_cli.api.frames import Frame
from cadtof_cli.api.maps import Maps
from cadtof_cli.api.values import as_declared
from cadtof_cli.capture.checks import InvalidValueError
from cadtof_cli.capture.metadata import Modulation, Pulse
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.simulation.pixel.pixel import PixelDefects
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.scenes import SCENES
from cadtof_cli.workflows.simulate.record import RecordSettings, expose, frames_of, scene_exposure


@dataclass(frozen=True, eq=False)
class SimulatedCapture:
    """Frames as a camera would record them, and the truth about the scene.

    Attributes:
        frames: frames of counts, from the camera's converter.
        truth: layers `direct.depth`, `mpi.depth`, their amplitudes, `mpi.ratio` and `mpi.delay`; float64 (Y, X), NaN where the
            pixel sees nothing.
    """

    frames: tuple[Frame, ...]
    truth: Maps


def simulate_scene(
    name: str,
    /,
    *,
    frames: int = 1,
    seed: int = 0,
    integration_length: float | Sequence[float] = 1e5,
    modulation: Mapping[str, Any] | None = None,
    fwhm_ns: float = Pulse.fwhm_ns,
    camera: Mapping[str, Any] | None = None,
    pixel: Mapping[str, Any] | None = None,
    **scene: Any,
) -> SimulatedCapture:
    """Return frames of a simulated scene with its truth: the counts that `cadtof simulate --scene NAME` writes.

    Args:
        name: name of the scene, a key of `SCENES` in `simulation/scene/scenes.py`, such as "corner".
        frames: number of frames.
        seed: seed of all random numbers.
        integration_length: n_av of Eq. (1), per harmonic, or one number for each.
        modulation: fields of `Modulation`, such as `{"periods_ns": (40.0, 20.0, 40 / 3)}`.
        fwhm_ns: width of the laser pulse.
        camera: fields of `Camera`, such as `{"width": 160, "height": 120}`.
        pixel: fields of `PixelDefects`, such as `{"gain_mismatch": 0.05}`.
        scene: fields of the scene's record, such as `distance_m=2.0`, `asr=2.0`.

    Raises:
        SettingsError: the scene or a field does not exist, or a value is not allowed.
    """
    require(name in SCENES, "simulate_scene", repr(name), f"one of {', '.join(SCENES)}")
    numbers = {"frames": frames, "seed": seed, "integration_length": integration_length}
    length = tuple[float, ...] if isinstance(integration_length, list | tuple | np.ndarray) else float
    own = as_declared(numbers, {"frames": int, "seed": int, "integration_length": length}, of="simulate_scene")
    given = {"seed": own["seed"], **scene} if "seed" in SCENES[name].__dataclass_fields__ else scene
    try:
        exposure = scene_exposure(
            _record(SCENES[name], given),
            _record(Camera, camera or {}),
            modulation=_record(Modulation, modulation or {}),
            pulse=_record(Pulse, {"fwhm_ns": fwhm_ns}),
            integration_length=own["integration_length"],
            seed=own["seed"],
            defects=_record(PixelDefects, pixel or {}),
        )
    except InvalidValueError as error:
        raise SettingsError(str(error)) from error
    settings = RecordSettings(frames=own["frames"])
    whole = expose(exposure)
    recorded = tuple(
        Frame(exposure.camera.counts_from_voltages(volts), exposure.told, f"frame_{index:04d}")
        for index, volts in enumerate(frames_of(exposure, whole, settings.frames))
    )
    truth = {layer: np.asarray(plane) for layer, plane in whole.truth.items()}
    return SimulatedCapture(recorded, Maps(truth, {"depth": "radial range", "scene": exposure.scene.summary}))


def _record(kind: Any, given: Mapping[str, Any]) -> Any:
    """Return a settings record with some of its fields given."""
    unknown = given.keys() - kind.__dataclass_fields__.keys()
    require(not unknown, kind.__name__, ", ".join(sorted(unknown)), f"some of {', '.join(kind.__dataclass_fields__)}")
    return kind(**as_declared(given, get_type_hints(kind), of=kind.__name__))
