"""The settings of a run of `cadtof resolve`. The command's options are made from them, so nothing heavy is imported here."""

from collections.abc import Mapping
from dataclasses import MISSING, field
from pathlib import Path
from typing import Any

from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.formats import AS_INPUT, MAP_FORMATS
from cadtof_cli.pipeline.plan import MapSettings
from cadtof_cli.records import dataclass, setting


@dataclass(frozen=True, kw_only=True)
class ResolveSettings:
    """Everything that a user can choose about a run, besides the inputs.

    `settings_file` is a `capture.toml` that is used for every capture, in place of any other. `overrides` are values by dotted
    key that replace those of any `capture.toml`.
    """

    out: Path = setting(MISSING, "Folder for the maps.", option="-o --out")
    recursive: bool = setting(
        False,
        "Also search all folders below each INPUT; OUT gets the same tree of folders.",
        option="-r --recursive",
    )
    settings_file: Path | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)
    frames: slice | None = setting(
        None,
        "Resolve only frames A to B − 1 of each capture, counted from 0, such as 10:20 (ten frames), 10: (the eleventh "
        "and all after it) or 7 (one frame).",
    )
    maps: MapSettings = field(default_factory=MapSettings)
    calibration: Path | None = setting(
        None, "Calibration folder made by `cadtof calibrate`; all parts in it are applied.", metavar="DIR"
    )
    map_format: str = setting(
        AS_INPUT,
        "File format of the maps. same: EXR for frames in EXR, TIFF for all others.",
        option="--format",
        choices=(*MAP_FORMATS, AS_INPUT),
    )
    workers: Workers = field(default_factory=Workers)
    overwrite: bool = setting(False, "Replace an earlier run in OUT and all of its maps.")
    resume: bool = setting(
        False, "Continue an earlier run with the same options: keep its maps, make the missing and changed ones."
    )
    dry_run: bool = setting(
        False,
        "Check options and settings and list the maps that would be written, but write nothing. Damage of frames is not "
        "looked for; `cadtof info` does that.",
    )

    def __post_init__(self) -> None:
        if self.overwrite and self.resume:
            raise SettingsError("--overwrite and --resume exclude each other: replace the old maps, or keep them")
