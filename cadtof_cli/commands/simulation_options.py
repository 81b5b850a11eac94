"""Options that `cadtof simulate` and `cadtof sweep` share: the pixel, how it is recorded, and how it is resolved."""

from dataclasses import dataclass
from typing import Any

import click
from click.core import ParameterSource

from cadtof_cli.capture.metadata import InvalidValueError, Modulation, Pulse
from cadtof_cli.commands.map_options import PATH_OPTIONS
from cadtof_cli.commands.options import RecordOptions, jobs_option, setting_option
from cadtof_cli.commands.values import NUMBERS, FurtherPath
from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.workers import Workers
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.averaging import Averaging, Capacitors, Stages
from cadtof_cli.simulation.pixel.mix import Condition, Motion
from cadtof_cli.simulation.pixel.pixel import PixelModel
from cadtof_cli.workflows.simulate.trials import Trials

INTEGRATION_LENGTH = 1e5
"""n_av where neither it nor the capacitors are given."""


@dataclass(frozen=True, kw_only=True)
class ModulationOptions:
    """What is said of modulation and laser pulse."""

    periods_ns: list[float]
    waveform: Any
    amplitude_v: float
    fwhm_ns: float

    def modulation(self) -> Modulation:
        """Return the modulation; raises SettingsError for one that cannot be."""
        try:
            return Modulation(periods_ns=tuple(self.periods_ns), waveform=self.waveform, amplitude_v=self.amplitude_v)
        except InvalidValueError as error:
            raise SettingsError(str(error)) from error


@dataclass(frozen=True, kw_only=True)
class PixelOptions:
    """What is said of the pixel."""

    photon_by_photon: bool
    photons_per_cycle: int
    cycles: int | None
    dead_time_ns: float
    jitter_ns: float
    temperature: float | None
    sample_noise_v: float
    gain_mismatch: float
    offsets_v: list[float]
    capacitors: list[float] | None
    drive: Any
    f1_hz: float
    f2_hz: float

    def averaging(self, integration_length: float | None, /) -> Averaging:
        """Return the averaging from n_av or, in its place, from capacitors."""
        stages = Stages(drive=self.drive, f1_hz=self.f1_hz, f2_hz=self.f2_hz)
        if self.capacitors is None:
            length = INTEGRATION_LENGTH if integration_length is None else integration_length
            return Averaging(integration_length=length, stages=stages)
        if integration_length is not None:
            raise SettingsError("--integration-length: found with --capacitors, expected one of the two")
        capacitors = Capacitors(values_ff=tuple(self.capacitors))
        return Averaging(integration_length=capacitors.integration_length, capacitors=capacitors, stages=stages)

    def model(self, modulation: Modulation, averaging: Averaging, motion: Motion, /) -> PixelModel:
        """Return the pixel; raises SettingsError for one that cannot be."""
        return PixelModel(
            modulation=modulation,
            averaging=averaging,
            photons_per_cycle=self.photons_per_cycle,
            cycles=self.cycles,
            dead_time_ns=self.dead_time_ns,
            jitter_ns=self.jitter_ns,
            sample_noise_v=self._sample_noise_v(averaging),
            gain_mismatch=self.gain_mismatch,
            offsets_v=pair("--offsets", self.offsets_v, ", of SC1 and SC2"),
            motion=motion,
        )

    def _sample_noise_v(self, averaging: Averaging) -> float:
        if self.temperature is None:
            return self.sample_noise_v
        if averaging.capacitors is None:
            raise SettingsError("--temperature: found without --capacitors, expected C1, whose kTC noise it is")
        if not self.temperature >= 0:
            raise SettingsError(f"--temperature: found {self.temperature:g} K, expected 0 K or more")
        return float((self.sample_noise_v**2 + averaging.capacitors.ktc_noise_v(self.temperature) ** 2) ** 0.5)


_MODULATION = RecordOptions(
    "modulation",
    ModulationOptions,
    setting_option("--periods-ns --periods", Modulation, help="Modulation periods in ns, the fundamental first."),
    setting_option("--waveform", Modulation, help="Waveform of the modulation."),
    setting_option("--amplitude-v --amplitude", Modulation, help="Amplitude of the modulation."),
    setting_option("--fwhm-ns --fwhm", Pulse, help="Length of the laser pulse, full width at half maximum."),
)

_PIXEL = RecordOptions(
    "pixel",
    PixelOptions,
    setting_option(
        "--photons",
        Trials,
        "photon_by_photon",
        help="Simulate every photon, instead of drawing voltages from their exact mean and covariance.",
    ),
    setting_option("--photons-per-cycle", PixelModel, help="Photons per laser cycle."),
    setting_option("--cycles", PixelModel, help="Laser cycles per harmonic.  [default: those of 12.5 n_av photons]"),
    setting_option(
        "--dead-time-ns --dead-time", PixelModel, show_default=False, help="Dead time of the SPAD; with --photons."
    ),
    setting_option(
        "--jitter-ns --jitter",
        PixelModel,
        show_default=False,
        help="Timing jitter of the SPAD, one standard deviation.",
    ),
    click.option(
        "--temperature", type=float, metavar="K", help="Temperature: adds the kTC noise of C1; with --capacitors."
    ),
    setting_option(
        "--sample-noise-v --sample-noise",
        PixelModel,
        show_default=False,
        help="Noise of every sample, one standard deviation.",
    ),
    setting_option(
        "--gain-mismatch",
        PixelModel,
        show_default=False,
        help="Relative gain error of SC2: gain of SC2 over gain of SC1, minus 1.",
    ),
    setting_option("--offsets-v --offsets", PixelModel, show_default=False, help="Offsets of SC1 and SC2 in V."),
    click.option("--capacitors", type=NUMBERS, help="Capacitors C1 to C12 of Fig. 1 in fF; they determine n_av."),
    setting_option("--stages", Stages, "drive", help="How the stages ST1 and ST2 are driven."),
    setting_option("--f1-hz --f1", Stages, show_default=False, help="Switching rate of ST1.  [default: 1e6]"),
    setting_option("--f2-hz --f2", Stages, show_default=False, help="Switching rate of ST2.  [default: 1e4]"),
)

further_option = click.option(
    "--path",
    "further",
    type=FurtherPath(),
    multiple=True,
    help="Add a path of MPI: its photons over the laser photons, and its arrival time. Can be given several times.",
)

quiet_option = click.option("-q", "--quiet", is_flag=True, help="Do not show a progress bar.")

workers_option = RecordOptions("workers", Workers, jobs_option("Worker processes"))


@dataclass(frozen=True, kw_only=True)
class TrialOptions:
    """What is said of a pixel, of how often it is recorded, and of how its recordings are resolved."""

    motion: Motion
    runs: int
    resolver: ResolverSettings
    pulse_correction: bool
    wrapped: bool
    seed: int
    modulation: ModulationOptions
    pixel: PixelOptions

    def trials(self, condition: Condition, averaging: Averaging, /) -> Trials:
        """Return the trials of some light; raises SettingsError for some that cannot be."""
        return Trials(
            condition=condition,
            model=self.pixel.model(self.modulation.modulation(), averaging, self.motion),
            resolver=self.resolver,
            runs=self.runs,
            photon_by_photon=self.pixel.photon_by_photon,
            pulse_correction=self.pulse_correction,
            wrapped=self.wrapped,
            seed=self.seed,
        )


trial_options = RecordOptions(
    "trial",
    TrialOptions,
    RecordOptions(
        "motion",
        Motion,
        setting_option(
            "--speed",
            Motion,
            "speed_m_s",
            metavar="M_PER_S",
            help="Speed of the scene away from the camera; the harmonics are recorded one after the other.",
        ),
        setting_option(
            "--frame-rate",
            Motion,
            "frame_rate_hz",
            metavar="HZ",
            help="Frames per second; a frame's time is shared equally by its harmonics.",
        ),
    ),
    setting_option("--runs", Trials, help="Number of recordings per condition."),
    RecordOptions("resolver", ResolverSettings, *PATH_OPTIONS),
    # what the paper does with its answers, and cadtof does not; with `--solver lm --order 2` its method as published
    click.option(
        "--pulse-correction/--no-pulse-correction",
        default=Trials.pulse_correction,
        help="Whether to correct the phasors for the length of the pulse; the paper does not.  [default: correct]",
    ),
    setting_option(
        "--wrapped",
        Trials,
        show_default=False,
        help="Report times within ± half the period and do not wrap their errors, as the paper does.",
    ),
    setting_option("--seed", Trials, help="Seed of the random numbers; the same seed gives the same bytes."),
    _MODULATION,
    _PIXEL,
)


def refuse_options(context: click.Context, names: tuple[str, ...], where: str, /) -> None:
    """Raise SettingsError if any of these options was given on the command line, where it has no effect."""
    for param in context.command.params:
        if param.name in names and context.get_parameter_source(param.name) == ParameterSource.COMMANDLINE:
            raise SettingsError(f"{param.opts[0]}: found {where}, where it has no effect; leave it out")


def pair(option: str, values: list[float], of: str = "", /) -> tuple[float, float]:
    """Return the two values of an option; raises SettingsError for any other number of them."""
    if len(values) != 2:
        raise SettingsError(f"{option}: found {len(values)} values, expected 2{of}")
    return values[0], values[1]


def triple(option: str, values: list[float], /) -> tuple[float, float, float]:
    """Return the three values of an option; raises SettingsError for any other number of them."""
    if len(values) != 3:
        raise SettingsError(f"{option}: found {len(values)} values, expected 3")
    return values[0], values[1], values[2]
