"""What can be known to go wrong with a capture before any of its frames is resolved."""

from collections.abc import Iterable

import numpy as np

from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.stacks import first_dtype
from cadtof_cli.errors import CadtofError, SettingsError
from cadtof_cli.phasors.voltages import phasor_scale
from cadtof_cli.pipeline import FramePlan
from cadtof_cli.resolver.settings import ResolverSettings


def require_known_volts(capture: Capture, /) -> None:
    """Make sure that the stored values can be turned into volts, by the type of the first frame that can be opened.

    Raises:
        SettingsError: the values are integers and nothing says how many volts a count stands for.
    """
    dtype = first_dtype(capture)
    if dtype is None:
        return
    try:
        phasor_scale(capture.source.metadata, dtype)
    except SettingsError as error:
        raise SettingsError(f"{capture.root}: {error}") from error


def capture_problems(capture: Capture, types: Iterable[str]) -> list[str]:
    """Return why frames of these types could not be resolved with the capture's metadata; empty where they can."""
    problems = []
    try:
        FramePlan(metadata=capture.source.metadata, resolver=ResolverSettings())
        for dtype in types:
            phasor_scale(capture.source.metadata, np.dtype(dtype))
    except CadtofError as error:
        problems.append(str(error))
    return problems
