"""What can be said of a simulated scene: its light, its camera and its capture."""

from dataclasses import dataclass, fields
from typing import Any

import click

from cadtof_cli.capture.metadata import Pulse
from cadtof_cli.commands.options import RecordOptions, number_option, setting_option
from cadtof_cli.commands.simulation_options import TrialOptions, further_option, pair, triple
from cadtof_cli.commands.values import NUMBERS
from cadtof_cli.errors import SettingsError
from cadtof_cli.files.formats import FRAME_FORMATS, format_by_name
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import SCENES
from cadtof_cli.workflows.simulate.record import RecordSettings, scene_exposure

SCENE_SETTINGS = {
    "card": {"mpi": "mpi_ratios", "distance_m": "distance_m"},
    "wall": {"distance_m": "distance_m", "tilt_deg": "tilt_deg", "albedo": "albedo"},
    "corner": {"distance_m": "distance_m", "opening_deg": "opening_deg", "albedo": "albedo"},
    "inter-reflection": {"mpi": "mpi_ratio", "distance_m": "distance_m", "albedo": "albedo"},
    "room": {
        "seed": "seed",
        "furniture": "furniture",
        "albedo": "albedo",
        "lamp_offset_m": "lamp_offset_m",
        "lamp_beam_deg": "beam_deg",
        "light_paths": "light_paths",
        "net_fill": "net_fill",
        "net_distance_m": "net_distance_m",
    },
    "cornell": {"light_paths": "light_paths"},
}
"""Which options each scene takes besides --asr, and the attribute that each one sets."""

_OF_SOME_SCENE = {"direct_ns"}.union(*SCENE_SETTINGS.values())
"""Those that a scene may not take; none takes the arrival of a pixel's direct path."""

ASR, MPI_RATIO = 5.0, 0.3
"""Of a pixel, where they are not given."""


@dataclass(frozen=True, kw_only=True)
class LightOptions:
    """What is said of the light: of a pixel's, all of it; of a scene's, what the scene takes."""

    asr: float | None
    mpi: float | None
    direct_ns: float | None
    second_ns: float
    further: tuple[tuple[float, float], ...]
    integration_length: float | None

    def condition(self, fwhm_ns: float, /) -> Condition:
        """Return the light of a pixel; raises SettingsError for one that cannot be."""
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
    """What is said of a scene, its camera and its capture."""

    frames: int
    frame_format: str
    compress: bool
    distance_m: float | None
    tilt_deg: list[float] | None
    albedo: float | None
    opening_deg: float | None
    width: int
    height: int
    furniture: int | None
    lamp_offset_m: list[float] | None
    lamp_beam_deg: float | None
    light_paths: int | None
    net_fill: float | None
    net_distance_m: float | None
    petzval_m: list[float]
    dark_offset_v: float
    fixed_delay_ns: float

    def exposure(
        self,
        name: str,
        light: LightOptions,
        trial: TrialOptions,
        /,
        *,
        integration_length: float,
    ) -> Exposure:
        """Return what is recorded; raises SettingsError for what cannot be."""
        camera = Camera(
            width=self.width,
            height=self.height,
            petzval_m=pair("--petzval", self.petzval_m),
            dark_offset_v=self.dark_offset_v,
            fixed_delay_ns=self.fixed_delay_ns,
        )
        return scene_exposure(
            self.scene(name, light, seed=trial.seed),
            camera,
            modulation=trial.modulation.modulation(),
            pulse=Pulse(fwhm_ns=trial.modulation.fwhm_ns),
            integration_length=integration_length,
            counts=format_by_name(self.frame_format).counts,
            seed=trial.seed,
            motion=trial.motion,
        )

    def scene(self, name: str, light: LightOptions, /, *, seed: int) -> Scene:
        """Return the scene from the options that it takes; the others must be absent."""
        taken = SCENE_SETTINGS[name]
        settings: dict[str, Any] = {} if light.asr is None else {"asr": light.asr}
        for option, value in (vars(light) | vars(self)).items():
            if option in _OF_SOME_SCENE and value is not None:
                if option not in taken:
                    shown = "--" + option.removesuffix("_m").removesuffix("_deg").removesuffix("_ns").replace("_", "-")
                    raise SettingsError(f"{shown}: found with --scene {name}, which does not use it; leave it out")
                settings[taken[option]] = value
        if "seed" in taken:
            settings["seed"] = seed
        if "lamp_offset_m" in settings:
            settings["lamp_offset_m"] = triple("--lamp-offset", settings["lamp_offset_m"])
        if "tilt_deg" in settings:
            settings["tilt_deg"] = pair("--tilt", settings["tilt_deg"])
        if "mpi_ratios" in settings:
            settings["mpi_ratios"] = (settings["mpi_ratios"], settings["mpi_ratios"])
        return SCENES[name](**settings)


def _of_each_scene(option: str, of: str) -> str:
    """Return the help of an option, with its default in each scene that takes it."""
    defaults = []
    for name, taken in SCENE_SETTINGS.items():
        if option in taken:
            value = next(item.default for item in fields(SCENES[name]) if item.name == taken[option])
            numbers = value if isinstance(value, tuple) else (value,)
            defaults.append(f"{name} {'random' if value is None else ','.join(f'{number:g}' for number in numbers)}")
    return f"{of}  [default: {'; '.join(defaults)}]"


SCENE_ONLY = tuple(item.name for item in fields(SceneOptions))
"""What a pixel does not take."""

light_options = RecordOptions(
    "light",
    LightOptions,
    number_option(
        "--asr",
        click.FLOAT,
        help="Ambient-to-signal ratio: ambient photons over laser photons.  [default: 5; with --scene: 2]",
    ),
    number_option(
        "--mpi",
        click.FLOAT,
        help="MPI photons over laser photons.  [default: 0.3; with --scene: as the scene gives it]",
    ),
    setting_option(
        "--direct",
        Condition,
        "direct_ns",
        default=None,
        show_default=False,
        help="Arrival time of the direct path.  [default: 5]",
    ),
    setting_option("--second", Condition, "second_ns", help="Arrival time of the MPI."),
    further_option,
    number_option(
        "--integration-length",
        click.FLOAT,
        help="Integration length n_av of Eq. (1), per harmonic.  [default: 1e5]",
    ),
)

scene_options = RecordOptions(
    "scenery",
    SceneOptions,
    setting_option("--frames", RecordSettings, help="Number of frames of the capture."),
    setting_option(
        "--format", RecordSettings, "frame_format", type=click.Choice(FRAME_FORMATS), help="File format of the frames."
    ),
    setting_option("--compress", RecordSettings, help="Compress the frames: Deflate in TIFF, ZIP in EXR."),
    number_option("--distance-m --distance", click.FLOAT, help=_of_each_scene("distance_m", "Distance of the scene.")),
    number_option(
        "--tilt-deg --tilt",
        NUMBERS,
        metavar="DEG,DEG",
        help=_of_each_scene("tilt_deg", "Tilt of the wall to the right and down."),
    ),
    number_option(
        "--albedo",
        click.FLOAT,
        help=_of_each_scene("albedo", "Albedo of the wall, corner or panel, or of all surfaces of a room."),
    ),
    number_option(
        "--opening-deg --opening",
        click.FLOAT,
        help=_of_each_scene("opening_deg", "Angle between the walls of the corner."),
    ),
    number_option("--furniture", click.INT, help="Pieces of furniture in the room.  [default: random, 0 to 8]"),
    number_option(
        "--lamp-offset-m --lamp-offset",
        NUMBERS,
        metavar="M,M,M",
        help=_of_each_scene("lamp_offset_m", "Position of the lamp relative to the camera: right,down,forward."),
    ),
    number_option(
        "--lamp-beam-deg --lamp-beam", click.FLOAT, help="Half angle of the lamp's beam (room).  [default: random]"
    ),
    number_option(
        "--light-paths", click.INT, help="Light paths traced from every fourth pixel (room).  [default: 256]"
    ),
    number_option(
        "--net-fill",
        click.FLOAT,
        help="Share of the light that a net in the room reflects (room).  [default: no net]",
    ),
    number_option(
        "--net-distance-m --net-distance",
        click.FLOAT,
        help="Distance of the net along the optical axis (room).  [default: random]",
    ),
    setting_option("--width", Camera, help="Columns of the frames."),
    setting_option("--height", Camera, help="Rows of the frames."),
    setting_option(
        "--petzval-m --petzval",
        Camera,
        show_default=False,
        metavar="M,M",
        help="Field curvature k2,k4 of the lens.  [default: 0,0]",
    ),
    setting_option(
        "--dark-offset-v --dark-offset",
        Camera,
        show_default=False,
        help="Standard deviation of the offset from pixel to pixel.  [default: 0]",
    ),
    setting_option(
        "--fixed-delay-ns --fixed-delay",
        Camera,
        show_default=False,
        help="Standard deviation of the delay from pixel to pixel.  [default: 0]",
    ),
)
