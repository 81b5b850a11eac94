"""What can be known to go wrong with a capture before any of its frames is resolved."""

from collections.abc import Iterable

import numpy as np

from cadtof_cli.capture.discovery import Capture
from cadtof_cli.errors import CadtofError
from cadtof_cli.phasors.voltages import phasor_scale
from cadtof_cli.pipeline import FramePlan
from cadtof_cli.resolver.settings import ResolverSettings


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
