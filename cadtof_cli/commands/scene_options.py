"""The options of a simulated scene: its light, its camera and its capture."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import click

from cadtof_cli.commands.options import RecordOptions, plain_option, setting_option
from cadtof_cli.commands.simulation_options import further_option
from cadtof_cli.commands.values import ONE_OR_MORE_NUMBERS, NumberTuple, ParamType
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import SCENES
from cadtof_cli.workflows.simulate.record import RecordSettings

_MPI = {"card": "mpi_ratios", "inter-reflection": "mpi_ratio"}
"""The field of each scene that `--mpi` sets. Every other option has the name of the field that it sets."""

ASR, MPI_RATIO = 5.0, 0.3
"""Ambient light and MPI of a single pixel, each over its direct light, if the options are not given."""


@dataclass(frozen=True, kw_only=True)
class LightOptions:
    """The options of the light. A single pixel takes all of them; a scene takes only some."""

    asr: float | None
    mpi: float | None
    direct_ns: float | None
    second_ns: float
    further: tuple[tuple[float, float], ...]
    integration_length: float | list[float] | None

    def condition(self, fwhm_ns: float, /) -> Condition:
        """Return the light of a single pixel; raises SettingsError for impossible values."""
        return Condition(
            asr=ASR if self.asr is None else self.asr,
            mpi_ratio=MPI_RATIO if self.mpi is None else self.mpi,
            direct_ns=Condition.direct_ns if self.direct_ns is None else self.direct_ns,
            second_ns=self.second_ns,
            fwhm_ns=fwhm_ns,
            further=self.further,
        )


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """The options of a scene, its camera and its capture.

    `settings` holds values of fields of the scenes, by name; a value is None if the option is not given.
    """

    recording: RecordSettings
    settings: Mapping[str, Any]
    camera: Camera

    def made(self, name: str, light: LightOptions, /, *, seed: int) -> Scene:
        """Return the scene `name`, made from the options that it takes; the options of other scenes must be absent."""
        taken = {field.name for field in fields(SCENES[name])}
        given = {"asr": light.asr, "seed": seed if "seed" in taken else None, **self.settings}
        if name in _MPI and light.mpi is not None:
            given[_MPI[name]] = (light.mpi, light.mpi) if name == "card" else light.mpi
        return SCENES[name](**{option: value for option, value in given.items() if value is not None})


def not_of_scene(name: str, /) -> frozenset[str]:
    """Return those options of scenes that the scene `name` does not take. No scene takes `--direct`, which is of a pixel."""
    others = {"direct_ns", *_scene.names()} - {field.name for field in fields(SCENES[name])}
    return frozenset(others if name in _MPI else {"mpi", *others})


def _of_each_scene(option: str, about: str, kind: ParamType = click.FLOAT) -> Any:
    """Return an option whose help lists its default in each scene that takes it."""
    defaults: dict[str, Any] = {
        name: field.default for name, scene in SCENES.items() for field in fields(scene) if field.name == option
    }
    told = []
    for name, value in defaults.items():
        numbers = value if isinstance(value, tuple) else (value,)
        told.append(f"{name} {'random' if value is None else ','.join(f'{number:g}' for number in numbers)}")
    return plain_option(option, kind, f"{about}  [default: {'; '.join(told)}]")


light_options = RecordOptions(
    "light",
    LightOptions,
    plain_option(
        "asr",
        click.FLOAT,
        "Ambient-to-signal ratio: ambient photons over laser photons.  [default: 5; with --scene: 2]",
    ),
    plain_option(
        "mpi", click.FLOAT, "MPI photons over laser photons.  [default: 0.3; with --scene: as the scene gives it]"
    ),
    setting_option(
        Condition,
        "direct_ns",
        "Arrival time of the direct path.  [default: 5]",
        option="--direct",
        default=None,
        show_default=False,
    ),
    setting_option(Condition, "second_ns", "Arrival time of the MPI.", option="--second"),
    further_option,
    plain_option(
        "integration_length",
        ONE_OR_MORE_NUMBERS,
        "Integration length n_av of Eq. (1), per harmonic; with --scene, a list may give that of each.  [default: 1e5]",
    ),
)

_scene = RecordOptions(
    "settings",
    dict,
    _of_each_scene("distance_m", "Distance of the scene."),
    _of_each_scene("tilt_deg", "Tilt of the wall to the right and down.", NumberTuple(2)),
    _of_each_scene("albedo", "Albedo of the corner, or of all surfaces of a room."),
    _of_each_scene("opening_deg", "Angle between the walls of the corner."),
    plain_option("furniture", click.INT, "Pieces of furniture in the room.  [default: random, 0 to 8]"),
    _of_each_scene("lamp_offset_m", "Position of the lamp relative to the camera: right,down,forward.", NumberTuple(3)),
    click.option(
        *("--lamp-beam-deg", "--lamp-beam", "beam_deg"),
        type=float,
        metavar="DEG",
        help="Half angle of the lamp's beam (room).  [default: random]",
    ),
    plain_option(
        "light_paths", click.INT, "Light paths traced from every fourth pixel (room, cornell).  [default: 256]"
    ),
    plain_option(
        "net_fill", click.FLOAT, "Share of the light that a net in the room reflects (room).  [default: no net]"
    ),
    plain_option(
        "net_distance_m", click.FLOAT, "Distance of the net along the optical axis (room).  [default: random]"
    ),
)

scene_options = RecordOptions(
    "scenery",
    SceneOptions,
    RecordOptions("recording", RecordSettings),
    _scene,
    RecordOptions("camera", Camera),
)
