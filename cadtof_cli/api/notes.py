"""What is assumed about arrays from Python and what is likely wrong with them, logged once for each kind of frame.

`cadtof resolve` and `read_frames` say this once per capture. A camera's own driver has no capture, but makes one frame after
the other, so the first frame with the same settings, size and type stands for all of them.
"""

import logging

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.mistaken_units import mistaken_unit
from cadtof_cli.capture.toml import MetadataSource
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.doubts import doubts
from cadtof_cli.phasors.plausible import implausible

MOST_KINDS = 64
"""Largest number of kinds of frames that are looked at: a program that changes its settings for each frame pays no more."""

_log = logging.getLogger("cadtof_cli")
_kinds: set[object] = set()


def log_notes(stored: Stored, source: MetadataSource, /, *, of: str) -> None:
    """Log what is assumed about a frame `of` a name, (H, 2, Y, X), and what is likely wrong with it.

    A frame that `resolve` refuses is left to it, and does not count as the first of its kind.
    """
    known = source.metadata
    kind = (known.modulation, known.voltage, known.optics, stored.shape, stored.dtype)
    if kind in _kinds or len(_kinds) >= MOST_KINDS:
        return
    try:
        if implausible(stored, known):
            return
        doubtful = doubts(stored, known)
    except SettingsError:
        return
    _kinds.add(kind)
    if taken := source.defaults_in_words():
        _log.warning(f"{of}: {taken}")
    for doubt in (*doubtful, *filter(None, [mistaken_unit(known, (stored.shape[2], stored.shape[3]))])):
        _log.warning(f"warning: {of}: {doubt}")
