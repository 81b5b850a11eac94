"""A calibration folder: for each part a TOML file, readable by people, and an EXR file with its maps beside it."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.parts import PART_KINDS, FieldCurvature, Origin, PartKind
from cadtof_cli.calibration.petzval import PetzvalCalibration
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError, MetadataError, SettingsError
from cadtof_cli.files.atomic import make_folder, require_new, write_text
from cadtof_cli.files.layers import read_layers, write_layers
from cadtof_cli.files.reading import is_folder
from cadtof_cli.files.toml import read_toml, toml_from_tables

DIGEST_LENGTH = 16

ZERO_LIMIT = 1e-3
"""Difference between the zeros of the dark frames and of a capture, as a share of the modulation amplitude, that is
doubted. It moves phases by up to a milliradian: 1 mm at 40 ns."""

FOCAL_LIMIT = 0.02
"""Difference between the focal lengths of a capture and of the Petzval walls, as a share, that is doubted. Focal lengths
that are fitted to the walls may differ by a per cent."""

NO_NOISE = (
    "the dark calibration holds no noise, so sigma leaves out that of the offsets: repeat `cadtof calibrate dark`"
)

Part = DarkCalibration | ResponseCalibration | PetzvalCalibration
"""One part. Its `origin`, its `tables` and its `maps` hold everything in it, and `from_stored` builds it from these."""

_TYPES: Mapping[PartKind, type[Part]] = {part.kind: part for part in get_args(Part)}


@dataclass(frozen=True, eq=False)
class Calibration:
    """The parts of a calibration folder; None for a part that is missing."""

    dark: DarkCalibration | None = None
    response: ResponseCalibration | None = None
    petzval: PetzvalCalibration | None = None

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts that the folder has, in the order in which they are applied."""
        return tuple(part for kind in PART_KINDS if (part := getattr(self, kind)) is not None)

    @cached_property
    def digests(self) -> dict[str, str]:
        """The digest of every part, by kind."""
        return {part.kind: digest_of(part) for part in self.parts}

    @property
    def digest(self) -> str:
        """A digest of all parts together."""
        return hashlib.sha256(json.dumps(self.digests).encode()).hexdigest()[:DIGEST_LENGTH]

    @property
    def sine(self) -> bool:
        """Whether no response was measured, or one that is a pure sine but for the imbalance of SC1 and SC2."""
        return self.response is None or all(one.linear for one in self.response.responses)

    @property
    def curvature(self) -> FieldCurvature | None:
        """The field curvature that counts: that of petzval; without it, what the response took out of its maps, if any."""
        if self.petzval is not None:
            return self.petzval.curvature
        found = self.response.curvature if self.response is not None else None
        return found if found and (found.k2_m or found.k4_m) else None

    @property
    def summary(self) -> str:
        """The parts, with a few words about each, and whether the field curvature is that of the response."""
        said = {part.kind: part.summary for part in self.parts}
        if self.petzval is None and self.curvature is not None:
            said["response"] += "; with the field curvature it found"
        return ", ".join(f"{kind} ({words})" for kind, words in said.items())

    def require_match(self, metadata: CaptureMetadata, pixels: tuple[int, int] | None, /) -> None:
        """Make sure that every part belongs to a capture (see `Origin.require_match`), and that it has the same lamp."""
        for part in self.parts:
            part.origin.require_match(metadata, pixels, kind=part.kind)
        lamp = metadata.optics.lamp_offset_m or (0.0, 0.0, 0.0)
        if self.response is not None and lamp != self.response.lamp_offset_m:
            found, expected = list(lamp), list(self.response.lamp_offset_m)
            raise SettingsError(
                f"the response calibration does not belong to this capture: lamp_offset_m is {found} in the capture and "
                f"{expected} in the calibration, made {self.response.origin.created} from "
                f"{', '.join(self.response.origin.captures)}; its maps would be wrong by the way of the lamp's light; give both "
                "the same lamp_offset_m under [optics], or --lamp-offset-m"
            )

    def doubts(self, metadata: CaptureMetadata, /) -> tuple[str, ...]:
        """Return in words what of a capture's metadata probably differs from that of the calibration's frames.

        A zero of 0 says nothing: the program that wrote the frames may have subtracted it.
        """
        return tuple(filter(None, (self._other_zero(metadata), self._other_lens(metadata.optics.focal_length_px))))

    def _other_zero(self, metadata: CaptureMetadata) -> str | None:
        before, now = self.dark.zero_v if self.dark else 0.0, metadata.voltage.zero_v
        if not before or not now or abs(now - before) <= ZERO_LIMIT * metadata.modulation.amplitude_v:
            return None
        return (
            f"zero_counts is {now:.6g} V in the capture and was {before:.6g} V in the dark frames (zero_counts × "
            f"volts_per_count), so all voltages are {abs(now - before) * 1e3:.3g} mV off if the camera is the same: give both "
            "the same values under [voltage], or repeat `cadtof calibrate dark`"
        )

    def _other_lens(self, focal_length_px: float | None) -> str | None:
        walls_px = self.petzval.quality.focal_length_px if self.petzval else None
        if walls_px is None or focal_length_px is None or abs(focal_length_px - walls_px) <= FOCAL_LIMIT * walls_px:
            return None
        return (
            f"focal_length_px is {focal_length_px:.6g} in the capture and {walls_px:.6g} in the petzval calibration, whose "
            "field curvature is that of its own lens: correct focal_length_px under [optics], or repeat `cadtof calibrate "
            "petzval`"
        )

    def stale(self) -> tuple[str, ...]:
        """Return a sentence for each part that should be measured again.

        Such a part was measured with another version of an earlier part than the folder has, or only one of them has such a
        part. Or it is a dark part of 0.1.0 from one frame: 0.1.0 recorded no noise for it.
        """
        found = [NO_NOISE] if self.dark is not None and not any(self.dark.offset_stderr_v()) else []
        for part in self.parts:
            for kind in PART_KINDS[: PART_KINDS.index(part.kind)]:
                then, now = part.origin.used.get(kind), self.digests.get(kind)
                if then == now:
                    continue
                again = f"repeat `cadtof calibrate {part.kind}`"
                if now is None:
                    how = f"with a {kind} calibration, which is missing here: bring back {kind}.toml and {kind}.exr, or {again}"
                else:
                    how = f"{'without a' if then is None else 'with another'} {kind} calibration: {again}"
                found.append(f"the {part.kind} calibration was measured {how}")
        return tuple(found)


def digest_of(part: Part, /) -> str:
    """Return a digest of everything in a part: origin, tables and maps."""
    text = json.dumps(_document(part), sort_keys=True, default=np.generic.item)
    digest = hashlib.sha256(text.encode())
    for name, plane in sorted(part.maps().items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(plane).tobytes())
    return digest.hexdigest()[:DIGEST_LENGTH]


def save_part(folder: Path, part: Part, /, *, overwrite: bool = False) -> tuple[Path, ...]:
    """Write a part into a calibration folder, and return the files that were written; the other parts stay.

    An OutputError is raised if the part exists already and `overwrite` is not set.
    """
    path, maps = folder / f"{part.kind}.toml", part.maps()
    require_new(path, overwrite=overwrite)
    make_folder(folder)
    written = [path]
    if maps:
        written.append(folder / f"{part.kind}.exr")
        write_layers(written[1], maps)
    document = _document(part)
    document["part"]["digest"] = digest_of(part)
    made = f"cadtof {part.kind} calibration; made by a program and checked by its digest, so not to be changed by hand"
    comments = [made, f"its maps are in {part.kind}.exr"] if maps else [made]
    write_text(path, toml_from_tables(document, comments=comments))
    return tuple(written)


def is_calibration_folder(path: Path, /) -> bool:
    """Return whether a path is a folder that `cadtof calibrate` wrote."""
    return is_folder(path) and any(os.path.lexists(path / f"{kind}.toml") for kind in PART_KINDS)


def load_calibration(folder: Path, /, *, kinds: Sequence[PartKind] = PART_KINDS) -> Calibration:
    """Read the parts of these kinds that a calibration folder holds.

    Raises:
        MetadataError: there is no such folder, it holds no part, or a part is damaged or was changed by hand.
    """
    if not is_folder(folder):
        if os.path.lexists(folder):
            raise MetadataError(
                f"{folder}: found a file, expected the folder of a calibration, such as {folder.parent}"
            )
        raise MetadataError(f"{folder}: no such folder; expected one that `cadtof calibrate … -o {folder}` made")
    found: dict[str, Any] = {
        kind: _load_part(folder, kind) for kind in kinds if os.path.lexists(folder / f"{kind}.toml")
    }
    if not found:
        expected = ", ".join(f"{kind}.toml" for kind in PART_KINDS)
        raise MetadataError(f"{folder}: no calibration in it; expected {expected}, or some of them")
    return Calibration(**found)


def current_calibration(folder: Path, /) -> Calibration:
    """Return the calibration in a folder; it is read again only when one of its files has changed. See `load_calibration`."""
    return _read_at(folder, _stamp(folder))


def _stamp(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Return name, size and modification time of each file of a calibration; a change of one of them changes these."""
    stamp = list[tuple[str, int, int]]()
    for name in (f"{kind}.{suffix}" for kind in PART_KINDS for suffix in ("toml", "exr")):
        # whatever cannot be reached is left to `load_calibration`
        with suppress(OSError, ValueError):
            now = (folder / name).stat()
            stamp.append((name, now.st_size, now.st_mtime_ns))
    return tuple(stamp)


@lru_cache(maxsize=4)
def _read_at(folder: Path, _stamp: tuple[tuple[str, int, int], ...], /) -> Calibration:
    return load_calibration(folder)


@lru_cache(maxsize=4)
def cached_calibration(folder: Path, digest: str, /) -> Calibration:
    """Return a calibration without a look at its folder after the first; raise MetadataError unless it has this digest.

    It may have changed since the start of the run that recorded the digest. That run may still go on, or may have ended
    long ago.
    """
    calibration = current_calibration(folder)
    if calibration.digest != digest:
        raise MetadataError(
            f"{folder}: holds another calibration (digest {calibration.digest}) than when the run began (digest {digest});"
            " resolve again to apply it"
        )
    return calibration


def _load_part(folder: Path, kind: PartKind) -> Part:
    path, maps_path = folder / f"{kind}.toml", folder / f"{kind}.exr"
    document = read_toml(path)
    try:
        maps: dict[str, NDArray[Any]] = read_layers(maps_path) if _TYPES[kind].has_maps else {}
        part: Part = _TYPES[kind].from_stored(_origin(document), document, maps)
        recorded, digest = document["part"]["digest"], digest_of(part)
    except FrameError as error:
        # its message names the file of the maps
        raise MetadataError(str(error)) from error
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MetadataError) as error:
        # the text of a TypeError is about Python code; the cause is an unknown key, or a value of another kind
        what = f"key {error} is missing" if isinstance(error, KeyError) else str(error)
        what = "a key is unknown, or its value is of another kind" if isinstance(error, TypeError) else what
        raise MetadataError(
            f"{path}: not a {kind} calibration: {what}; if another version of cadtof made it, repeat "
            f"`cadtof calibrate {kind}` with --overwrite"
        ) from error
    if digest != recorded:
        raise MetadataError(
            f"{path}: does not match its digest {recorded}: it, or the maps beside it, were changed or belong to another "
            f"calibration; repeat `cadtof calibrate {kind}`"
        )
    if unknown := _unknown_keys(document, _document(part)):
        raise MetadataError(
            f"{path}: has the unknown key {unknown[0]}, which has no effect; take it out, or repeat `cadtof calibrate {kind}`"
        )
    return part


def _unknown_keys(document: Mapping[str, Any], known: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the dotted keys of a file's tables that are not among those of the part that was read from it."""
    tables = {name: keys if isinstance(keys, dict) else {} for name, keys in document.items()}
    found = [name for name in tables if name not in known]
    found += [f"{name}.{key}" for name in known for key in tables.get(name, ()) if key not in known[name]]
    return [name for name in found if name != "part.digest"]


def _origin(document: Mapping[str, Any]) -> Origin:
    part, origin = document["part"], document["origin"]
    width, height = origin["pixels"]
    return Origin(
        captures=tuple(origin["captures"]),
        frames=origin["frames"],
        pixels=(height, width),
        periods_ns=tuple(origin["periods_ns"]),
        waveform=origin["waveform"],
        used=dict(document.get("used", {})),
        created=part["created"],
        version=part["version"],
    )


def _document(part: Part) -> dict[str, dict[str, Any]]:
    origin = asdict(part.origin)
    height, width = origin.pop("pixels")
    used = origin.pop("used")
    head = {"kind": part.kind, "version": origin.pop("version"), "created": origin.pop("created")}
    tables = {"part": head, "origin": origin | {"pixels": [width, height]}} | ({"used": dict(used)} if used else {})
    return tables | part.tables()
