"""The options that decide what maps are: those of `cadtof resolve` that other commands take too."""

from typing import Any

from cadtof_cli.commands.options import Decorator, gathered, setting_option
from cadtof_cli.frame_plan import DepthKind, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.workflows.resolve.settings import ResolveSettings

PATH_OPTIONS = (
    setting_option(
        "--solver",
        ResolverSettings,
        help="How paths are found: two-path in closed form (with more than two periods, or --paths, by maximum likelihood), "
        "one-path, or lm, the paper's Levenberg–Marquardt from random starts.",
    ),
    setting_option(
        "--paths",
        ResolverSettings,
        metavar="K",
        help="Most paths a pixel; more than 2 need as many periods, and give layers path3.depth and so on.",
    ),
    setting_option(
        "--order",
        ResolverSettings,
        metavar="auto|1|…|K",
        help="Paths a pixel, whatever the solver: auto tests each pixel, a number is taken as it is "
        "(--solver lm --order 2 is the paper's method as published).",
    ),
    setting_option("--starts", ResolverSettings, metavar="N", help="Random starts of --solver lm."),
    setting_option(
        "--false-alarm",
        ResolverSettings,
        metavar="P",
        help="Probability that noise alone passes for a signal, or leaves more than one path does; about a third of the latter "
        "end as two paths.",
    ),
    setting_option("--return", ResolverSettings, "returns", help="Which of two paths is called direct."),
    setting_option(
        "--min-return-ratio",
        ResolverSettings,
        metavar="R",
        help="Least amplitude of a direct path, as a share of the strongest.",
    ),
)
"""How the phasors of a pixel become its paths: of recorded pixels and of simulated ones."""

_RESOLVER = (
    setting_option(
        "--mpi-model",
        ResolverSettings,
        help="What MPI is: separate paths (discrete), the tail that the room's geometry predicts (diffuse), or what each frame "
        "says. Another --solver, --order, more --paths or --return last mean discrete.",
    ),
    *PATH_OPTIONS,
    setting_option(
        "--seed",
        ResolverSettings,
        metavar="S",
        help="Seed of the random starts of --solver lm, drawn for each pixel by its place in the frame.",
    ),
)

_MAPS = (
    setting_option(
        "--min-confidence",
        MapSettings,
        "min_confidence_v",
        metavar="V",
        help="Least confidence of a pixel with an answer, in volts.  [default: what noise alone reaches with --false-alarm]",
    ),
    setting_option("--depth", MapSettings, help="Radial range, or planar depth (needs the optics)."),
    setting_option(
        "--pool",
        MapSettings,
        metavar="N",
        help="Pool the noise of N × N neighbours that show the same light, N odd; adds the layer effective_pixels.",
    ),
    setting_option(
        "--average",
        MapSettings,
        metavar="N",
        help="Average every N consecutive frames of a capture into one, named after the first; the last one takes those left.",
    ),
)


def map_options() -> Decorator[Any]:
    """Return a decorator that adds the options that decide what maps are; they arrive as one record, `maps`."""

    def settings(
        *, depth: DepthKind, pool: int, average: int, min_confidence_v: float | None, **resolver: Any
    ) -> MapSettings:
        return MapSettings(
            resolver=ResolverSettings(**resolver),
            depth=depth,
            pool=pool,
            average=average,
            min_confidence_v=min_confidence_v,
        )

    return gathered("maps", settings, *_RESOLVER, *_MAPS)


def calibration_option() -> Decorator[Any]:
    """Return the option that names a calibration."""
    return setting_option(
        "--calibration",
        ResolveSettings,
        metavar="DIR",
        help="Folder made by `cadtof calibrate`; what is in it is applied.",
    )
