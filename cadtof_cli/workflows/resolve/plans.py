"""What a run is going to do with each capture: made before anything is written."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cadtof_cli.capture.discovery import Capture, base_of, find_captures, placed_below
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.capture.frames import file_size, first_frames, single_frames
from cadtof_cli.errors import SettingsError
from cadtof_cli.files.formats import format_named, map_suffix_like
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.phasors.voltages import volts_per_count
from cadtof_cli.workflows.resolve.settings import AS_INPUT, ResolveSettings
from cadtof_cli.workflows.resolve.use_calibration import AppliedCalibration


@dataclass(frozen=True)
class CapturePlan:
    """A capture, what to do with its frames, their (Y, X), None where no file can be opened, and how many the first file has."""

    capture: Capture
    plan: FramePlan
    pixels: tuple[int, int] | None
    in_first_file: int = 1

    def expected_maps(self, settings: ResolveSettings, /) -> int:
        """Return how many maps there will be, as far as it can be told from the first file and the sizes of the others."""
        frames = self._expected_frames()
        if settings.frames is not None:
            frames = len(range(*settings.frames.indices(frames)))
        return -(-frames // self.plan.settings.average)

    def _expected_frames(self) -> int:
        sources = self.capture.frames
        if self.in_first_file == 1:
            return len(sources)
        sizes = [file_size(source.paths[0]) for source in sources]
        of_one = max(sizes[0] / self.in_first_file, 1.0)
        return sum(max(round(size / of_one), 1) for size in sizes)

    def frames(self, settings: ResolveSettings, /) -> Iterator[FrameSource]:
        """Yield the frames that are to be resolved, a stack's one by one."""
        chosen = settings.frames or slice(None)
        return itertools.islice(single_frames(self.capture), chosen.start, chosen.stop, chosen.step)

    def output(self, source: FrameSource, settings: ResolveSettings, /) -> Path:
        """Return the file that the maps of a frame are written into."""
        same = settings.map_format == AS_INPUT
        suffix = map_suffix_like(source.paths[0]) if same else format_named(settings.map_format).suffix
        return settings.out / f"{source.name}{suffix}"

    def notes(self) -> Iterator[str]:
        """Yield what is taken for granted about the capture."""
        source, root = self.capture.source, self.capture.root
        if source.file is not None and source.file.parent != root:
            yield f"{root}: settings of {source.file}"
        taken = [f"{key} = {value}" for key, value in source.defaulted.items()]
        if taken:
            yield f"{root}: not given, so taken from the paper: {', '.join(taken)}"
        if source.metadata.pixel.integration_length is None:
            yield f"{root}: pixel.integration_length is not given, so the noise is estimated from each frame"
        resolver, harmonics = self.plan.settings.resolver, source.metadata.modulation.harmonics
        if resolver.may_be_diffuse(harmonics) and source.metadata.optics.focal_length_px is None:
            yield f"{root}: optics.focal_length_px is not given, so diffuse MPI is predicted for a view of 60° across"


def found_captures(
    inputs: Sequence[Path], settings: ResolveSettings, overrides: Mapping[str, Any], /, *, base: Path | None = None
) -> tuple[tuple[Capture, ...], Path]:
    """Return the captures among the inputs, named by where they lie below a folder, and that folder.

    Args:
        inputs: folders and files.
        settings: say how to look for them.
        overrides: metadata by dotted key that goes before any `capture.toml`.
        base: the folder; None: the deepest that all inputs lie in.
    """
    captures = find_captures(
        inputs, overrides=overrides, settings_file=settings.settings_file, recursive=settings.recursive
    )
    base = base or base_of(inputs, captures)
    return placed_below(captures, base), base


def planned(
    captures: Sequence[Capture], settings: ResolveSettings, calibration: AppliedCalibration | None, /
) -> list[CapturePlan]:
    """Return what to do with each capture.

    Raises:
        SettingsError: its settings do not allow it; or its values are integers and nothing says how many volts a count is.
    """
    use = calibration.use if calibration else None
    plans: list[CapturePlan] = []
    for capture in captures:
        metadata, first = capture.source.metadata, first_frames(capture)
        plan = FramePlan(metadata=metadata, settings=settings.maps, calibration=use)
        if first is None:
            plans.append(CapturePlan(capture, plan, None))
            continue
        plans.append(CapturePlan(capture, plan, (first.shape[2], first.shape[3]), first.count))
        try:
            volts_per_count(metadata.voltage, first.dtype)
        except SettingsError as error:
            raise SettingsError(f"{capture.root}: {error}") from error
    return plans
