"""Options that `cadtof simulate` and `cadtof sweep` share: the pixel, how it is recorded, and how it is resolved."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from cadtof_cli.capture.metadata import WAVEFORMS, InvalidValueError, Modulation
from cadtof_cli.commands.options import NumberList
from cadtof_cli.errors import SettingsError
from cadtof_cli.resolver.settings import ORDERS, ResolverSettings

if TYPE_CHECKING:
    from cadtof_cli.simulation.pixel.averaging import Averaging
    from cadtof_cli.simulation.pixel.pixel import PixelModel

Function = TypeVar("Function", bound=Callable[..., Any])

NUMBERS = NumberList()

MODULATION_OPTIONS = (
    click.option("--periods-ns", "--periods", type=NUMBERS, default="40,20", show_default=True, help="Periods in ns."),
    click.option("--waveform", type=click.Choice(WAVEFORMS), default="sine", show_default=True, help="Modulation."),
    click.option("--amplitude-v", "--amplitude", type=float, default=0.2746, show_default=True, help="Amplitude, V."),
    click.option("--fwhm-ns", "--fwhm", type=float, default=1.7, show_default=True, help="Width of the laser pulse."),
)

PIXEL_OPTIONS = (
    click.option("--photons", is_flag=True, help="Photon by photon, instead of from exact mean and covariance."),
    click.option("--photons-per-cycle", type=int, default=5, show_default=True, help="Photons in a laser cycle."),
    click.option("--cycles", type=int, help="Laser cycles a harmonic.  [default: 12.5 n_av photons]"),
    click.option("--dead-time-ns", "--dead-time", type=float, default=0.0, help="Dead time of the SPAD (--photons)."),
    click.option("--jitter-ns", "--jitter", type=float, default=0.0, help="Timing jitter of the SPAD, one sigma."),
    click.option("--temperature", type=float, help="Temperature in K: adds kTC noise of C1 (--capacitors)."),
    click.option("--sample-noise-v", "--sample-noise", type=float, default=0.0, help="Noise of every sample, V."),
    click.option("--gain-mismatch", type=float, default=0.0, help="Gain of SC2 over SC1, less 1."),
    click.option("--offsets-v", "--offsets", type=NUMBERS, default="0,0", help="Offsets of SC1 and SC2, V."),
    click.option("--capacitors", type=NUMBERS, help="C1,…,C12 of Fig. 1 in fF; they set n_av."),
    click.option(
        "--stages", type=click.Choice(["dc", "switched"]), default="dc", show_default=True, help="ST1 and ST2."
    ),
    click.option("--f1-hz", "--f1", type=float, default=1e6, show_default=True, help="Switching rate of ST1."),
    click.option("--f2-hz", "--f2", type=float, default=1e4, show_default=True, help="Switching rate of ST2."),
)

RUN_OPTIONS = (
    click.option("--runs", type=int, default=400, show_default=True, help="Recordings of each condition."),
    click.option("--order", type=click.Choice(ORDERS), default="auto", show_default=True, help="Paths to resolve."),
    click.option("--false-alarm", type=float, default=0.01, show_default=True, help="Of the order test."),
)

PROCESS_OPTIONS = (
    click.option("--seed", type=int, default=0, show_default=True, help="Same seed, same bytes."),
    click.option("-j", "--jobs", type=int, metavar="N", help="Worker processes.  [default: all cores]"),
    click.option("-q", "--quiet", is_flag=True, help="No progress bar."),
)


def with_options(*options: Callable[[Any], Any]) -> Callable[[Function], Function]:
    """Return a decorator that adds options in the order given."""

    def add(function: Function) -> Function:
        for option in reversed(options):
            function = option(function)
        return function

    return add


def modulation_from_options(options: dict[str, Any], /) -> Modulation:
    """Return the modulation; raises SettingsError for one that cannot be."""
    try:
        return Modulation(
            periods_ns=tuple(options["periods_ns"]),
            waveform=options["waveform"],
            amplitude_v=options["amplitude_v"],
        )
    except InvalidValueError as error:
        raise SettingsError(str(error)) from error


def averaging_from_options(options: dict[str, Any], integration_length: float | None, /) -> "Averaging":
    """Return the averaging from n_av or, in its place, from capacitors."""
    from cadtof_cli.simulation.pixel.averaging import Averaging, Capacitors, Stages

    stages = Stages(drive=options["stages"], f1_hz=options["f1_hz"], f2_hz=options["f2_hz"])
    if options["capacitors"] is None:
        return Averaging(integration_length=1e5 if integration_length is None else integration_length, stages=stages)
    if integration_length is not None:
        raise SettingsError("--integration-length: found with --capacitors, expected one of the two")
    capacitors = Capacitors(values_ff=tuple(options["capacitors"]))
    return Averaging(integration_length=capacitors.integration_length, capacitors=capacitors, stages=stages)


def model_from_options(options: dict[str, Any], averaging: "Averaging", /) -> "PixelModel":
    """Return the pixel; raises SettingsError for one that cannot be."""
    from cadtof_cli.simulation.pixel.pixel import PixelModel

    offsets = options["offsets_v"]
    if len(offsets) != 2:
        raise SettingsError(f"--offsets: found {len(offsets)} values, expected 2, of SC1 and SC2")
    return PixelModel(
        modulation=modulation_from_options(options),
        averaging=averaging,
        photons_per_cycle=options["photons_per_cycle"],
        cycles=options["cycles"],
        dead_time_ns=options["dead_time_ns"],
        jitter_ns=options["jitter_ns"],
        sample_noise_v=_sample_noise_v(options, averaging),
        gain_mismatch=options["gain_mismatch"],
        offsets_v=(offsets[0], offsets[1]),
    )


def resolver_from_options(options: dict[str, Any], /) -> ResolverSettings:
    """Return how runs are resolved."""
    return ResolverSettings(order=options["order"], false_alarm=options["false_alarm"])


def job_count(jobs: int | None, /) -> int:
    """Return the number of worker processes; raises SettingsError for less than one."""
    from cadtof_cli.execution.workers import available_cores

    if jobs is not None and jobs < 1:
        raise SettingsError(f"--jobs: found {jobs}, expected 1 or more")
    return jobs or available_cores()


def refuse_options(context: click.Context, names: tuple[str, ...], where: str, /) -> None:
    """Raise SettingsError if any of these options was given on the command line, where it has no effect."""
    for param in context.command.params:
        if param.name in names and context.get_parameter_source(param.name) == ParameterSource.COMMANDLINE:
            raise SettingsError(f"{param.opts[0]}: found {where}, where it has no effect; leave it out")


def _sample_noise_v(options: dict[str, Any], averaging: "Averaging") -> float:
    noise: float = options["sample_noise_v"]
    temperature = options["temperature"]
    if temperature is None:
        return noise
    if averaging.capacitors is None:
        raise SettingsError("--temperature: found without --capacitors, expected C1, whose kTC noise it is")
    if not temperature >= 0:
        raise SettingsError(f"--temperature: found {temperature:g} K, expected 0 K or more")
    return float((noise**2 + averaging.capacitors.ktc_noise_v(temperature) ** 2) ** 0.5)
