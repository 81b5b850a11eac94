"""What a user can choose about a run of `cadtof resolve`. Its options are made from it, so nothing heavy is imported here."""

from dataclasses import field
from pathlib import Path

from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.formats import AS_INPUT, MAP_FORMATS
from cadtof_cli.frame_plan import MapSettings
from cadtof_cli.records import dataclass

FORMAT_CHOICES = (*MAP_FORMATS, AS_INPUT)


@dataclass(frozen=True, kw_only=True)
class ResolveSettings:
    """Everything that a user can choose about a run, besides the inputs and what overrides `capture.toml`.

    Attributes:
        out: folder of the run.
        maps: what the maps are.
        calibration: folder of the calibration that is applied.
        map_format: of the map files; `same` is that of the frames.
        workers: what the work is done by.
        overwrite: whether the files of an earlier run may be replaced.
        resume: whether the maps of an earlier run are kept, and only those that are missing made.
        recursive: whether captures are looked for below the folders that are given, too.
        settings_file: a `capture.toml` that holds for every capture, in place of any other.
        frames: which frames of each capture, by their place from 0; None for all.
        dry_run: whether all is only checked and told, and nothing written.
    """

    out: Path
    maps: MapSettings = field(default_factory=MapSettings)
    calibration: Path | None = None
    map_format: str = AS_INPUT
    workers: Workers = field(default_factory=Workers)
    overwrite: bool = False
    resume: bool = False
    recursive: bool = False
    settings_file: Path | None = None
    frames: slice | None = None
    dry_run: bool = False

    def __post_init__(self) -> None:
        if self.overwrite and self.resume:
            raise SettingsError("--overwrite and --resume exclude each other: replace the old maps, or keep them")
        if self.map_format not in FORMAT_CHOICES:
            raise SettingsError(f"--format: found {self.map_format!r}, expected one of {', '.join(FORMAT_CHOICES)}")
