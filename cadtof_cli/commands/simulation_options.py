"""Options that `cadtof simulate` and `cadtof sweep` share: the pixel, how it is recorded, and how it is resolved."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import click

from cadtof_cli.capture.metadata import Modulation, Pulse
from cadtof_cli.commands.map_options import path_options
from cadtof_cli.commands.options import (
    RecordOptions,
    declared_options,
    jobs_option,
    note_given,
    setting_option,
)
from cadtof_cli.commands.values import FURTHER_PATH, NumberTuple
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.execution.workers import Workers
from cadtof_cli.simulation.pixel.averaging import Averaging, Capacitors, Stages
from cadtof_cli.simulation.pixel.mix import Condition, Motion
from cadtof_cli.simulation.pixel.pixel import PixelDefects, PixelModel
from cadtof_cli.workflows.simulate.trials import Trials

INTEGRATION_LENGTH = 1e5
"""n_av, if neither the integration length nor the capacitors are given."""


@dataclass(frozen=True, kw_only=True)
class TrialOptions:
    """The options of a pixel, of how often it is recorded, and of how its recordings are resolved.

    `trials` and `pixel` are values of fields of `Trials` and of `PixelModel`, by name. `temperature_k` adds kTC noise;
    `capacitors`, in fF, replace an integration length.
    """

    motion: Motion
    trials: Mapping[str, Any]
    modulation: Modulation
    fwhm_ns: float
    pixel: Mapping[str, Any]
    temperature_k: float | None
    capacitors: tuple[float, ...] | None
    stages: Stages

    def averaging(self, integration_length: float | list[float] | None, /) -> Averaging:
        """Return the averaging, from the capacitors or the integration length n_av; raises SettingsError if both are given, or
        if there are several lengths."""
        if isinstance(integration_length, list):
            found = ",".join(f"{length:g}" for length in integration_length)
            raise SettingsError(
                f"--integration-length: found {found}, expected one number; only a scene takes one for each period"
            )
        if self.capacitors is None:
            length = INTEGRATION_LENGTH if integration_length is None else integration_length
            return Averaging(integration_length=length, stages=self.stages)
        if integration_length is not None:
            raise SettingsError(
                "--integration-length: found with --capacitors, expected one of the two: the capacitors determine n_av"
            )
        capacitors = Capacitors(values_ff=self.capacitors)
        return Averaging(integration_length=capacitors.integration_length, capacitors=capacitors, stages=self.stages)

    def of(self, condition: Condition, averaging: Averaging, /) -> Trials:
        """Return the trials of a pixel in the light of `condition`; raises SettingsError for impossible values."""
        pixel = {**self.pixel, "sample_noise_v": self._sample_noise_v(averaging)}
        model = PixelModel(modulation=self.modulation, averaging=averaging, motion=self.motion, **pixel)
        return Trials(condition=condition, model=model, **self.trials)

    def defects(self, averaging: Averaging, /) -> PixelDefects:
        """Return the defects of a scene's pixels; raises SettingsError for impossible values."""
        given = {field.name: self.pixel[field.name] for field in fields(PixelDefects)}
        return PixelDefects(**{**given, "sample_noise_v": self._sample_noise_v(averaging)})

    def _sample_noise_v(self, averaging: Averaging) -> float:
        noise_v = float(self.pixel["sample_noise_v"])
        if self.temperature_k is not None:
            if averaging.capacitors is None:
                both = "both: the temperature gives the kTC noise of C1"
                raise SettingsError(f"--temperature: found without --capacitors, expected {both}")
            require(self.temperature_k >= 0, "--temperature", f"{self.temperature_k:g} K", "0 K or more")
            noise_v = float((noise_v**2 + averaging.capacitors.ktc_noise_v(self.temperature_k) ** 2) ** 0.5)
        return noise_v


further_option = click.option(
    "--path",
    "further",
    type=FURTHER_PATH,
    multiple=True,
    help="Add a path of MPI: its photons over the laser photons, and its arrival time. Can be given several times. "
    "--paths 3, which needs three periods, resolves this path too.",
)

quiet_option = click.option(
    "-q",
    "--quiet",
    is_flag=True,
    # `--jobs` asks for it, wherever it stands
    is_eager=True,
    help="Print only errors on stderr: no progress bar, notes or summary.",
)

workers_option = RecordOptions("workers", Workers, jobs_option("Worker processes"))

_path_options = path_options("mpi_model", "seed")

RESOLVING = (*_path_options.names(), "pulse_correction", "wrapped")
"""Options that decide how the recordings of a pixel are resolved."""

trial_options = RecordOptions(
    "trial",
    TrialOptions,
    RecordOptions("motion", Motion),
    RecordOptions("trials", dict, _path_options, *declared_options(Trials).values()),
    RecordOptions(
        "modulation",
        Modulation,
        setting_option(Modulation, "periods_ns", "Modulation periods in ns, the fundamental first."),
        setting_option(Modulation, "waveform", "Waveform of the modulation."),
        setting_option(Modulation, "amplitude_v", "Amplitude of the modulation."),
    ),
    setting_option(Pulse, "fwhm_ns", "Length of the laser pulse, full width at half maximum."),
    RecordOptions("pixel", dict, *declared_options(PixelModel).values()),
    click.option(
        "--temperature",
        "temperature_k",
        type=float,
        metavar="K",
        help="Temperature, which adds the kTC noise of C1; needs --capacitors.",
    ),
    click.option(
        "--capacitors",
        type=NumberTuple(),
        metavar="FF,FF…",
        help="Capacitors C1 to C12 of Fig. 1 in fF; they determine n_av.",
    ),
    RecordOptions("stages", Stages),
)


def note_unused(trial: TrialOptions, /, *, followed: bool = False) -> None:
    """Say on stderr which options were typed that have no effect.

    `followed`: whether one recording is simulated photon by photon, for the pictures of its evolution.
    """
    if trial.stages.drive == "dc":
        note_given({"f1_hz", "f2_hz"}, "with --stages dc")
        if not (followed or trial.trials["photon_by_photon"]):
            note_given({"cycles", "photons_per_cycle"}, "without --photons")
    if not trial.motion.speed_m_s:
        note_given({"frame_rate_hz"}, "without --speed")
