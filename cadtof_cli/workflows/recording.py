"""Recorded frames → the values that are resolved: those of one frame, or the mean of several."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import Capture, FrameSource, read_stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.capture.toml import FILE_NAME
from cadtof_cli.doubts.plausible import Copies, require_plausible
from cadtof_cli.errors import FrameError, SettingsError
from cadtof_cli.files.digests import Digest, content_digest
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.phasors.frame_mean import FrameMean, frame_mean
from cadtof_cli.records import dataclass

MOST_READS = 3
"""How many times a frame is read when its files keep changing while they are read."""


@contextmanager
def named(capture: Capture, /) -> Iterator[None]:
    """Name the capture, and the file that holds its settings, in the message of a SettingsError that is raised in the block."""
    try:
        yield
    except SettingsError as error:
        file = capture.source.file or FILE_NAME
        raise SettingsError(f"{capture.root}: {error}".replace(f" in {FILE_NAME}", f" in {file}")) from error


@dataclass(frozen=True)
class SourceFile:
    """A file that a frame was read from, with its size and modification time when it was read."""

    name: str
    bytes: int
    mtime_ns: int


@dataclass(frozen=True, eq=False)
class Recording:
    """A frame, or the mean of several frames, and how it was read.

    Attributes:
        frame: the stored values, (H, 2, Y, X), or the mean.
        began: when the reading began, as told by `time.monotonic`.
        digest: digest of the stored values.
        files: files of the frame, as they were before they were read; None: a file was missing.
        left_out: how many frames of a mean could not be read and why, in words; None: all were read.
    """

    frame: Stored | FrameMean
    began: float
    digest: str
    files: tuple[SourceFile, ...] | None
    left_out: str | None = None

    @property
    def stored(self) -> Stored | None:
        """The stored values of a single frame; None: a mean."""
        return None if isinstance(self.frame, FrameMean) else self.frame


@dataclass(frozen=True)
class FrameReader:
    """How the frames of a capture are read.

    Attributes:
        layout: how their files are laid out.
        metadata: how they were recorded.
        pixels: size (Y, X) of most of them; None: any size.
    """

    layout: FrameLayout
    metadata: CaptureMetadata
    pixels: tuple[int, int] | None = None

    @classmethod
    def of(cls, capture: Capture, /) -> "FrameReader":
        """Return how the frames of a capture are read."""
        typical = capture.typical
        return cls(capture.layout, capture.source.metadata, typical.pixels if typical else None)

    def read(self, sources: Sequence[FrameSource], /) -> Recording:
        """Return a frame, or the mean of all those of several frames that can be read.

        Files that change while they are read are read again, so that no frame is half old and half new.

        Raises:
            FrameError: no frame can be read, or none has the size of most frames; or the files keep changing.
        """
        began, before = time.monotonic(), None
        for _ in range(MOST_READS):
            files = files_of(sources)
            frame, digest, left_out = self._mean(sources) if len(sources) > 1 else (*self.one(sources[0]), None)
            # the file of a stack that grows changes, but this frame of it does not
            if files_of(sources) == files or digest == before:
                return Recording(frame, began, digest, files, left_out)
            before = digest
        raise FrameError(
            f"{sources[0]}: changed while it was read, {MOST_READS} times; expected a file that is complete"
        )

    def one(self, source: FrameSource, /) -> tuple[Stored, str]:
        """Return the stored values of a frame, and their digest; raises FrameError if it cannot be read or is no recording."""
        stored = read_stored(source, self.layout, size=self.pixels)
        require_plausible(stored, self.metadata, of=source)
        return stored, content_digest(stored)

    def _mean(self, sources: Sequence[FrameSource]) -> tuple[FrameMean, str, str | None]:
        """Return the mean of the frames that can be read and are no copies of others; its digest, and which frames were
        left out (see `Recording`)."""
        digests, errors, copies = list[str](), list[FrameError](), Copies()

        def readable() -> Iterator[Stored]:
            for source in sources:
                try:
                    stored, digest = self.one(source)
                except FrameError as error:
                    errors.append(error)
                    digests.append("")
                    continue
                if copies.original_of(stored, digest, source):
                    errors.append(FrameError(f"{source}: holds the same values as another of these frames"))
                else:
                    yield stored
                digests.append(digest)
            if len(errors) == len(sources):
                raise errors[0]

        mean = frame_mean(readable(), saturated_counts=self.metadata.voltage.saturated_counts)
        left_out = f"{len(errors)} of {len(sources)} frames left out of the mean: {errors[0]}" if errors else None
        return mean, Digest(",".join(digests).encode()).hexdigest(), left_out


def files_of(sources: Sequence[FrameSource], /) -> tuple[SourceFile, ...] | None:
    """Return the files that frames lie in, as they are now; None: a file is missing."""
    paths: dict[Path, None] = dict.fromkeys(path for source in sources for path in source.paths)
    try:
        found = [(path.name, path.stat()) for path in paths]
    except (OSError, ValueError):
        return None
    return tuple([SourceFile(name, now.st_size, now.st_mtime_ns) for name, now in found])
