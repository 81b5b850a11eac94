"""What is known of a capture besides its pixels: the records that `capture.toml` describes, one a table."""

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

from cadtof_cli.errors import MetadataError

if TYPE_CHECKING:
    from cadtof_cli.files.frames import RawLayout

Waveform = Literal["sine", "triangle"]

Kind = Literal["number", "whole number", "numbers", "whole numbers", "pair", "text", "names", "numbers by name"]

WAVEFORMS: tuple[Waveform, ...] = ("sine", "triangle")

HARMONIC_TOLERANCE = 5e-4
"""How far periods_ns[0] / period may be from a whole number, relative; recorded periods are rounded decimals."""


class InvalidValueError(MetadataError):
    """A value that a key cannot have. `where` is filled in by whoever knows the file or option it came from."""

    def __init__(self, key: str, found: object, expected: str, where: str = "") -> None:
        super().__init__(key, found, expected, where)
        self.key, self.found, self.expected, self.where = key, found, expected, where

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return f"{place}{self.key}: found {self.found!r}, expected {self.expected}"


def _key(kind: Kind, about: str, default: Any = None) -> Any:
    """Declare one key of a table: its kind of value, what it means, and the paper's value if it has one."""
    return field(default=default, metadata={"kind": kind, "about": about})


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError("a number")
    return float(value)


def _whole_number(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError("a whole number")
    return value


def _numbers(value: Any) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise TypeError("a list of numbers")
    return tuple(_number(item) for item in value)


def _whole_numbers(value: Any) -> tuple[int, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise TypeError("a list of whole numbers")
    return tuple(_whole_number(int(item) if isinstance(item, float) and item.is_integer() else item) for item in value)


def _pair(value: Any) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise TypeError("a list of two numbers")
    return _numbers(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("a string")
    return value


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise TypeError("a list of two names")
    return tuple(map(_text, value))


def _numbers_by_name(value: Any) -> tuple[tuple[str, int], ...]:
    if not isinstance(value, Mapping) or not value:
        raise TypeError('whole numbers by name, such as { "25" = 1, "50" = 2 }')
    return tuple((str(name), _whole_number(number)) for name, number in value.items())


_CONVERTERS: dict[Kind, Callable[[Any], Any]] = {
    "number": _number,
    "whole number": _whole_number,
    "numbers": _numbers,
    "whole numbers": _whole_numbers,
    "pair": _pair,
    "text": _text,
    "names": _names,
    "numbers by name": _numbers_by_name,
}


def _is_sample_type(dtype: str) -> bool:
    # numpy, which options that are only printed need not load
    from cadtof_cli.files.frames import is_sample_type

    return is_sample_type(dtype)


def _require(holds: bool, key: str, found: object, expected: str) -> None:
    if not holds:
        raise InvalidValueError(key, found, expected)


def _require_finite(key: str, value: float | None, *, above: float | None = None, expected: str = "") -> None:
    holds = value is None or (math.isfinite(value) and (above is None or value > above))
    _require(holds, key, value, expected or f"a finite number above {above}")


@dataclass(frozen=True, kw_only=True)
class Modulation:
    """The voltages that the pixel samples."""

    periods_ns: tuple[float, ...] = _key("numbers", "modulation periods, the fundamental first", (40.0, 20.0))
    waveform: Waveform = _key("text", "shape of the modulation, sine or triangle", "sine")
    amplitude_v: float = _key("number", "modulation amplitude", 0.2746)

    def __post_init__(self) -> None:
        for period in self.periods_ns:
            _require_finite("modulation.periods_ns", period, above=0)
        ratios = [self.periods_ns[0] / period for period in self.periods_ns]
        harmonic = all(abs(ratio - round(ratio)) <= HARMONIC_TOLERANCE * ratio for ratio in ratios)
        rising = all(a < b for a, b in itertools.pairwise(ratios))
        _require(
            harmonic and rising,
            "modulation.periods_ns",
            list(self.periods_ns),
            "the fundamental first, then falling periods that divide it by whole numbers, such as [40.0, 20.0]",
        )
        allowed = " or ".join(map(repr, WAVEFORMS))
        _require(self.waveform in WAVEFORMS, "modulation.waveform", self.waveform, allowed)
        _require_finite("modulation.amplitude_v", self.amplitude_v, above=0)

    @cached_property
    def harmonics(self) -> tuple[int, ...]:
        """Harmonic numbers h, where period h is periods_ns[0] / h."""
        return tuple(round(self.periods_ns[0] / period) for period in self.periods_ns)


@dataclass(frozen=True, kw_only=True)
class Pixel:
    """The averaging that each photon's sample goes through."""

    integration_length: float | None = _key("number", "n_av of Eq. (1), per harmonic")

    def __post_init__(self) -> None:
        _require_finite("pixel.integration_length", self.integration_length, above=1)


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """The laser pulse, taken as a Gaussian."""

    fwhm_ns: float = _key("number", "laser pulse, full width at half maximum", 1.7)

    def __post_init__(self) -> None:
        holds = math.isfinite(self.fwhm_ns) and self.fwhm_ns >= 0
        _require(holds, "pulse.fwhm_ns", self.fwhm_ns, "a finite number, 0 or more")


@dataclass(frozen=True, kw_only=True)
class Voltage:
    """How stored values stand for volts: (stored − zero_counts) · volts_per_count."""

    zero_counts: float | None = _key("number", "stored value of 0 V; unsigned values need it, others have 0")
    volts_per_count: float | None = _key("number", "volts a count; float files without it hold volts")
    saturated_counts: tuple[float, float] | None = _key("pair", "stored values at or beyond these are saturated")

    def __post_init__(self) -> None:
        _require_finite("voltage.zero_counts", self.zero_counts, expected="a finite number")
        scale, limits = self.volts_per_count, self.saturated_counts
        holds = scale is None or (math.isfinite(scale) and scale != 0)
        _require(holds, "voltage.volts_per_count", scale, "a finite number other than 0")
        holds = limits is None or limits[0] < limits[1]
        _require(holds, "voltage.saturated_counts", limits and list(limits), "the lower limit, then a higher one")

    @property
    def zero(self) -> float:
        """Stored value of 0 V: 0 where nothing else is said."""
        return self.zero_counts or 0.0


@dataclass(frozen=True, kw_only=True)
class Optics:
    """The lens as a pinhole; needed for z depth, Petzval walls and point clouds."""

    focal_length_px: float | None = _key("number", "focal length in pixels")
    principal_point_px: tuple[float, float] | None = _key(
        "pair", "column and row where the optical axis meets the array"
    )

    def __post_init__(self) -> None:
        _require_finite("optics.focal_length_px", self.focal_length_px, above=0)
        point = self.principal_point_px
        holds = point is None or all(map(math.isfinite, point))
        _require(holds, "optics.principal_point_px", point, "two finite numbers")


@dataclass(frozen=True, kw_only=True)
class Target:
    """A known object that a calibration capture looks at."""

    distance_m: float | None = _key("number", "perpendicular distance of a flat target")

    def __post_init__(self) -> None:
        _require_finite("target.distance_m", self.distance_m, above=0)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How frames are spread over files, where the files do not say it themselves."""

    pattern: str | None = _key("text", "file name of one plane, such as {frame}_h{harmonic}_sc{channel}.tif")
    channel: tuple[str, str] | None = _key("names", "what {channel} is for SC1 and SC2 in the pattern, if not 1 and 2")
    harmonic: tuple[tuple[str, int], ...] | None = _key(
        "numbers by name", "what {harmonic} is in the pattern, and which harmonic that stands for"
    )
    frames: int | None = _key("whole number", "frames in each TIFF stack")
    raw_dtype: str | None = _key(
        "text", "type of the values in raw dumps, such as uint16 or >u2 (in TOML: [layout.raw] dtype)"
    )
    raw_shape: tuple[int, ...] | None = _key("whole numbers", "shape of a raw dump, such as 2,2,240,320 for H C Y X")
    raw_offset_bytes: int | None = _key("whole number", "bytes before the first value of a raw dump")

    def __post_init__(self) -> None:
        if self.pattern is not None:
            counts = [self.pattern.count(part) for part in ("{harmonic}", "{channel}", "{frame}")]
            _require(
                counts in ([1, 1, 0], [1, 1, 1]) and not self.pattern.startswith("/"),
                "layout.pattern",
                self.pattern,
                "a file name with {frame}, {harmonic} and {channel} once each; a lone frame needs no {frame}",
            )
        names = self.channel or ("1", "2")
        _require(len(set(names)) == 2 and all(names), "layout.channel", list(names), "two different names")
        numbers = [number for _, number in self.harmonic or ()]
        _require(
            len(set(numbers)) == len(numbers),
            "layout.harmonic",
            dict(self.harmonic or ()),
            "a number of its own for each name",
        )
        _require(self.frames is None or self.frames >= 1, "layout.frames", self.frames, "1 or more")
        given = self.raw_dtype is not None, self.raw_shape is not None
        _require(given[0] == given[1], "layout.raw_dtype", self.raw_dtype, "dtype and shape of raw dumps, both or none")
        kind = self.raw_dtype
        _require(
            kind is None or _is_sample_type(kind), "layout.raw_dtype", kind, "a type such as uint16, >u2 or float32"
        )
        shape = self.raw_shape or (1, 1)
        sound = len(shape) >= 2 and all(0 < length < 2**31 for length in shape)
        _require(sound, "layout.raw_shape", self.raw_shape, "two lengths or more, the last Y and X, each above 0")
        _require((self.raw_offset_bytes or 0) >= 0, "layout.raw_offset_bytes", self.raw_offset_bytes, "0 or more")

    @property
    def raw(self) -> "RawLayout | None":
        """What raw dumps hold, where that is said."""
        from cadtof_cli.files.frames import RawLayout

        if self.raw_dtype is None or self.raw_shape is None:
            return None
        return RawLayout(self.raw_dtype, self.raw_shape, self.raw_offset_bytes or 0)


@dataclass(frozen=True, kw_only=True)
class CaptureMetadata:
    """All that is known of a capture; the tables and keys are those of `capture.toml`."""

    modulation: Modulation = field(default_factory=Modulation)
    pixel: Pixel = field(default_factory=Pixel)
    pulse: Pulse = field(default_factory=Pulse)
    voltage: Voltage = field(default_factory=Voltage)
    optics: Optics = field(default_factory=Optics)
    target: Target = field(default_factory=Target)
    layout: Layout = field(default_factory=Layout)


OPTIONS_OF_OTHER_NAME = {"layout.frames": "--stack-frames"}
"""--frames chooses among a capture's frames."""


@dataclass(frozen=True)
class Key:
    """One key of `capture.toml`, as the reader, the command-line options and the documentation need it."""

    table: str
    name: str
    about: str
    default: Any
    kind: Kind

    def convert(self, value: Any) -> Any:
        """Return a value from TOML or the command line as the records hold it; TypeError says what was expected."""
        return _CONVERTERS[self.kind](value)

    @property
    def path(self) -> str:
        """Dotted name, such as `pixel.integration_length`."""
        return f"{self.table}.{self.name}"

    @property
    def option(self) -> str:
        """The command-line option that overrides the key."""
        return OPTIONS_OF_OTHER_NAME.get(self.path, "--" + self.name.replace("_", "-"))


TABLES: dict[str, type] = {table.name: cast(type, table.default_factory) for table in fields(CaptureMetadata)}

KEYS: tuple[Key, ...] = tuple(
    Key(table, item.name, item.metadata["about"], item.default, item.metadata["kind"])
    for table, record in TABLES.items()
    for item in fields(record)
)
"""The registry of keys: `capture.toml`, the options that override it, `cadtof info` and the README follow it."""
