"""The metadata of a capture: one record for each table of `capture.toml`."""

import itertools
import math
from dataclasses import field, fields
from functools import cached_property
from typing import Any, Literal, cast, get_args

from cadtof_cli.capture.checks import (
    COUNT,
    LENGTH,
    PERIOD,
    PLANE_PATTERN,
    POSITIVE,
    SAMPLE_TYPE,
    SCALE,
    VOLTS,
    Check,
    InvalidValueError,
    Kind,
    above,
    each,
    one_or_each,
)
from cadtof_cli.records import dataclass
from cadtof_cli.units import FWHM_PER_SIGMA, unambiguous_range_m

Waveform = Literal["sine", "triangle"]

WAVEFORMS: tuple[Waveform, ...] = get_args(Waveform)

HIGHEST_HARMONIC = 1000

LEAST_MODULATION = 1e-6
"""Smallest share of the highest harmonic's modulation that a pulse may leave; with less, nothing can be resolved."""

SHORTEST_PULSE_NS = 1e-6
"""A femtosecond. No laser pulse is shorter; a smaller number was probably meant in seconds."""

MOST_RANGES = 10
"""Largest distance of a target in unambiguous ranges; a larger number was probably meant in millimetres."""

HARMONIC_TOLERANCE = 5e-4
"""Largest relative distance of periods_ns[0] / period from a whole number; given periods are rounded decimals."""


def _key(kind: Kind, about: str, *checks: Check, default: Any = None) -> Any:
    """Declare a key of a table: kind of its value, meaning, checks and default (the paper's value, or None)."""
    return field(default=default, metadata={"kind": kind, "about": about, "checks": checks})


def mean_length(lengths: float | tuple[float, ...], /) -> float:
    """Return the integration length whose variance, which is proportional to 1/(2·n_av − 1), is the mean of those of some
    lengths; a single one stays as it is."""
    if not isinstance(lengths, tuple):
        return lengths
    return 0.5 * (1.0 + len(lengths) / sum(1.0 / (2.0 * length - 1.0) for length in lengths))


def _are_harmonics(periods: tuple[float, ...]) -> bool:
    ratios = [periods[0] / period for period in periods]
    whole = all(abs(ratio - round(ratio)) <= HARMONIC_TOLERANCE * ratio for ratio in ratios)
    return whole and all(a < b for a, b in itertools.pairwise(ratios)) and ratios[-1] <= HIGHEST_HARMONIC


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of `capture.toml`. Its fields are the keys; their values pass the checks of the key, or are None."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            for holds, expected, found in item.metadata["checks"] if value is not None else ():
                if not holds(value):
                    raise InvalidValueError(f"{type(self).__name__.lower()}.{item.name}", found(value), expected)


@dataclass(frozen=True, kw_only=True)
class Modulation(Table):
    """The voltages that the pixel samples."""

    periods_ns: tuple[float, ...] = _key(
        "numbers",
        "modulation periods in ns, the fundamental first",
        each(POSITIVE),
        each(PERIOD),
        Check(
            _are_harmonics,
            "the longest period first, then shorter ones, each the longest divided by a whole number, such as [40.0, 20.0]",
            list,
        ),
        default=(40.0, 20.0),
    )
    waveform: Waveform = _key(
        "text",
        "waveform of the modulation, sine or triangle",
        Check(lambda waveform: waveform in WAVEFORMS, " or ".join(map(repr, WAVEFORMS))),
        default="sine",
    )
    amplitude_v: float = _key("number", "amplitude of the modulation in V", POSITIVE, VOLTS, default=0.2746)

    @cached_property
    def harmonics(self) -> tuple[int, ...]:
        """Harmonic numbers h, where period h is periods_ns[0] / h."""
        return tuple(round(self.periods_ns[0] / period) for period in self.periods_ns)


@dataclass(frozen=True, kw_only=True)
class Pixel(Table):
    """The averaging of the photons' samples in each pixel."""

    integration_length: float | tuple[float, ...] | None = _key(
        "number or numbers",
        "integration length n_av of Eq. (1) of every harmonic, or a list with that of each; without it the noise is estimated",
        one_or_each(above(1)),
        one_or_each(COUNT),
    )

    @property
    def mean_length(self) -> float | None:
        """The integration length that gives the mean noise of the harmonics; None if it is unknown."""
        return None if self.integration_length is None else mean_length(self.integration_length)


@dataclass(frozen=True, kw_only=True)
class Pulse(Table):
    """The laser pulse, which is treated as a Gaussian."""

    fwhm_ns: float = _key(
        "number",
        "length of the laser pulse in ns, full width at half maximum",
        Check(
            lambda width: width == 0 or SHORTEST_PULSE_NS <= width < math.inf,
            f"0, or {SHORTEST_PULSE_NS:g} or more, in ns",
        ),
        default=1.7,
    )


@dataclass(frozen=True, kw_only=True)
class Voltage(Table):
    """The map from stored values to volts: (stored − zero_counts) · volts_per_count."""

    zero_counts: float | None = _key(
        "number",
        "stored value that means 0 V; needed for unsigned integers, 0 for other types",
        Check(math.isfinite, "a finite number"),
        COUNT,
    )
    volts_per_count: float | None = _key(
        "number",
        "volts per count; needed for integers; floats without it are volts",
        Check(lambda scale: math.isfinite(scale) and scale != 0, "a finite number other than 0"),
        SCALE,
    )
    saturated_counts: tuple[float, float] | None = _key(
        "pair",
        "lower and upper limit; stored values at or beyond them are saturated",
        Check(lambda limits: limits[0] < limits[1], "the lower limit, then a higher one", list),
    )

    @property
    def zero(self) -> float:
        """The stored value that means 0 V; 0 if it is not given."""
        return self.zero_counts or 0.0

    @property
    def zero_v(self) -> float:
        """The stored value that means 0 V, times the volts per count: it depends on the camera, not on the bits of its files."""
        return self.zero * (self.volts_per_count or 1.0)


@dataclass(frozen=True, kw_only=True)
class Optics(Table):
    """The lens, treated as a pinhole (needed for z depth, Petzval walls and point clouds), and the lamp."""

    focal_length_px: float | None = _key("number", "focal length in pixels", POSITIVE, LENGTH)
    principal_point_px: tuple[float, float] | None = _key(
        "pair",
        "column and row of the principal point in pixels, where the optical axis meets the array",
        Check(lambda point: all(map(math.isfinite, point)), "two finite numbers"),
        each(COUNT),
    )
    lamp_offset_m: tuple[float, ...] | None = _key(
        "numbers",
        "position of the lamp relative to the camera in m: right, down, forward",
        Check(lambda offset: len(offset) == 3 and max(map(abs, offset)) <= 10.0, "three numbers from -10 to 10"),
    )

    def principal_point(self, pixels: tuple[int, int], /) -> tuple[float, float]:
        """Return the principal point, column and row, of an array (Y, X); it is the middle if none is given."""
        return self.principal_point_px or ((pixels[1] - 1) / 2.0, (pixels[0] - 1) / 2.0)


@dataclass(frozen=True, kw_only=True)
class Target(Table):
    """A known object that a calibration capture looks at."""

    distance_m: float | None = _key("number", "distance of a flat target along the optical axis in m", POSITIVE, LENGTH)


@dataclass(frozen=True, kw_only=True)
class Layout(Table):
    """How frames are spread over files, if the files do not say it themselves."""

    pattern: str | None = _key(
        "text", "file name of one plane, such as {frame}_h{harmonic}_sc{channel}.tif", PLANE_PATTERN
    )
    channel: tuple[str, str] | None = _key(
        "names",
        "text of {channel} in the pattern for SC1 and SC2, if not 1 and 2",
        Check(lambda names: len(set(names)) == 2 and all(names), "two different names", list),
    )
    harmonic: tuple[tuple[str, int], ...] | None = _key(
        "numbers by name",
        "text of {harmonic} in the pattern for each harmonic h, if not 1, 2, …",
        Check(
            lambda pairs: len({number for _, number in pairs}) == len(pairs), "a different number for each name", dict
        ),
    )
    frames: int | None = _key(
        "whole number",
        "number of frames in each stack, if its file does not say it",
        Check(lambda n: n >= 1, "1 or more"),
    )
    raw_dtype: str | None = _key("text", "data type of raw dumps, such as uint16 or >u2", SAMPLE_TYPE)
    raw_shape: tuple[int, ...] | None = _key(
        "whole numbers",
        "shape of a raw dump, such as 2,2,240,320 for H C Y X",
        Check(
            lambda shape: len(shape) >= 2 and all(0 < length < 2**31 for length in shape),
            "two lengths or more, the last Y and X, each above 0",
        ),
    )
    raw_offset_bytes: int | None = _key(
        "whole number", "bytes before the first value of a raw dump", Check(lambda n: n >= 0, "0 or more")
    )

    @property
    def depth(self) -> int:
        """The number of folders in the pattern: how far below the folder of the capture its planes lie."""
        return (self.pattern or "").count("/")


_NEEDED_BESIDE = (
    ("channel", "pattern"),
    ("harmonic", "pattern"),
    ("raw_dtype", "raw_shape"),
    ("raw_shape", "raw_dtype"),
    ("raw_offset_bytes", "raw_dtype"),
)
"""Keys of `[layout]`, and for each the other key without which it means nothing."""


@dataclass(frozen=True, kw_only=True)
class CaptureMetadata:
    """The metadata of a capture; its fields are the tables of `capture.toml`."""

    modulation: Modulation = field(default_factory=Modulation)
    pixel: Pixel = field(default_factory=Pixel)
    pulse: Pulse = field(default_factory=Pulse)
    voltage: Voltage = field(default_factory=Voltage)
    optics: Optics = field(default_factory=Optics)
    target: Target = field(default_factory=Target)
    layout: Layout = field(default_factory=Layout)

    def __post_init__(self) -> None:
        width, shortest = self.pulse.fwhm_ns, self.modulation.periods_ns[-1]
        # a Gaussian pulse with standard deviation s leaves the share exp(−(2π·s/T)²/2) of a sine with period T
        widest = math.sqrt(-2.0 * math.log(LEAST_MODULATION)) / (2.0 * math.pi) * FWHM_PER_SIGMA * shortest
        if width > widest:
            expected = f"{widest:.4g} or less: a longer pulse leaves nothing of a modulation of {shortest:g} ns"
            raise InvalidValueError("pulse.fwhm_ns", width, expected)
        distance, period = self.target.distance_m, self.modulation.periods_ns[0]
        if distance is not None and distance > (farthest := MOST_RANGES * unambiguous_range_m(period)):
            expected = f"at most {MOST_RANGES} unambiguous ranges, which are {farthest:.4g} m; is it in mm?"
            raise InvalidValueError("target.distance_m", distance, expected)
        lengths, periods = self.pixel.integration_length, self.modulation.periods_ns
        if isinstance(lengths, tuple) and len(lengths) != len(periods):
            expected = f"one number, or {len(periods)}: one for each of modulation.periods_ns"
            raise InvalidValueError("pixel.integration_length", lengths, expected)
        for name, needs in _NEEDED_BESIDE:
            found = getattr(self.layout, name)
            if found is not None and getattr(self.layout, needs) is None:
                raise InvalidValueError(f"layout.{name}", found, f"layout.{needs} beside it")


OPTIONS_OF_OTHER_NAME = {"layout.frames": "--stack-frames"}
"""Options that are not named after their key: --frames chooses among the frames of a capture."""


@dataclass(frozen=True)
class Key:
    """One key of `capture.toml`, as the reader, the command-line options and the documentation need it.

    `about` is the meaning of the key, in words. It has no default if `default` is None.
    """

    table: str
    name: str
    about: str
    default: Any
    kind: Kind

    @property
    def path(self) -> str:
        """The dotted name, such as `pixel.integration_length`."""
        return f"{self.table}.{self.name}"

    def value_in(self, metadata: CaptureMetadata, /) -> Any:
        """Return the value that the key has in these metadata."""
        return getattr(getattr(metadata, self.table), self.name)

    @property
    def option(self) -> str:
        """The command-line option that overrides the key."""
        return OPTIONS_OF_OTHER_NAME.get(self.path, "--" + self.name.replace("_", "-"))


TABLES: dict[str, type] = {table.name: cast(type, table.default_factory) for table in fields(CaptureMetadata)}

KEYS: dict[str, Key] = {
    f"{table}.{item.name}": Key(table, item.name, item.metadata["about"], item.default, item.metadata["kind"])
    for table, record in TABLES.items()
    for item in fields(record)
}
"""The registry of keys by dotted name.

`capture.toml`, the options that override it, `cadtof info` and the README follow this registry.
"""
