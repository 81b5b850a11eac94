"""The options that decide what maps are: those of `cadtof resolve` that other commands take too."""

from functools import partial
from typing import Any

from cadtof_cli.commands.options import Decorator, RecordOptions, setting_option
from cadtof_cli.frame_plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.workflows.resolve.settings import ResolveSettings

_path = partial(setting_option, ResolverSettings)
_map = partial(setting_option, MapSettings)

PATH_OPTIONS = (
    _path(
        "solver",
        "How to find the paths. two-path: closed form with two periods, maximum likelihood with more periods or --paths. "
        "one-path: maximum likelihood. lm: the paper's Levenberg–Marquardt from random starts.",
    ),
    _path(
        "paths",
        "Largest number of paths per pixel. More than 2 need as many periods, and add the layers path3.depth and so on.",
        metavar="K",
    ),
    _path(
        "order",
        "Number of paths per pixel, for every solver. auto: tested in each pixel. A number: always that many "
        "(--solver lm --order 2 is the method as the paper published it).",
        metavar="auto|1|…|K",
    ),
    _path("starts", "Number of random starts of --solver lm."),
    _path(
        "false_alarm",
        "False-alarm probability of two tests: noise alone is taken for a signal; noise makes one path fail the test for "
        "one path (about a third of those pixels are then resolved as two paths).",
        metavar="P",
    ),
    _path("returns", "Which path to report as the direct one.", option="--return"),
    _path("min_return_ratio", "Smallest amplitude of a direct path, relative to the strongest path.", metavar="R"),
)
"""How the phasors of a pixel become its paths: of recorded pixels and of simulated ones."""

_RESOLVER = (
    _path(
        "mpi_model",
        "Model of the MPI. discrete: separate paths. diffuse: a tail of light, predicted from the geometry of the scene. "
        "auto: chosen for each frame. Another --solver or --order, --paths above 2 and --return last imply discrete.",
    ),
    *PATH_OPTIONS,
    _path(
        "seed",
        "Seed of the random starts of --solver lm. A pixel's starts depend on the seed and its position only.",
        metavar="S",
    ),
)

_MAPS = (
    _map(
        "min_confidence_v",
        "Smallest confidence, in volts, at which a pixel is resolved.  [default: from the noise and --false-alarm]",
        option="--min-confidence",
    ),
    _map("depth", "range: distance along the ray. z: planar depth; needs the focal length."),
    _map(
        "pool",
        "Average N × N neighbouring pixels that see the same light, to reduce noise; N is odd. Adds the layer "
        "effective_pixels.",
    ),
    _map(
        "average",
        "Average every N consecutive frames of a capture into one, named after the first. The last group may be smaller.",
    ),
)


def map_options(*first: Decorator[Any]) -> Decorator[Any]:
    """Return a decorator that adds the options that decide what maps are, and some before them; they arrive as `maps`."""
    return RecordOptions("maps", MapSettings, *first, RecordOptions("resolver", ResolverSettings, *_RESOLVER), *_MAPS)


def calibration_option() -> Decorator[Any]:
    """Return the option that names a calibration."""
    about = "Calibration folder made by `cadtof calibrate`; all parts in it are applied."
    return setting_option(ResolveSettings, "calibration", about, metavar="DIR")
