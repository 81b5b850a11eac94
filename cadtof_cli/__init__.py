"""Depth maps free of multi-path interference from CA-dToF cameras.

From Python: `from cadtof_cli import read_frames, resolve, read_maps, simulate_scene`, see docs/python.md. What they need is
imported when one of them is first asked for, so importing the package costs nothing.
"""

from typing import TYPE_CHECKING, Any

from cadtof_cli.version import __version__ as __version__

if TYPE_CHECKING:
    from cadtof_cli.api.frames import Frame, read_frames
    from cadtof_cli.api.maps import Maps, read_maps
    from cadtof_cli.api.resolve import resolve
    from cadtof_cli.api.scenes import SimulatedCapture, simulate_scene

__all__ = ["Frame", "Maps", "SimulatedCapture", "read_frames", "read_maps", "resolve", "simulate_scene"]

_MODULES = {
    "Frame": "frames",
    "read_frames": "frames",
    "Maps": "maps",
    "read_maps": "maps",
    "resolve": "resolve",
    "SimulatedCapture": "scenes",
    "simulate_scene": "scenes",
}
"""Which module of `cadtof_cli/api` each name comes from."""


def __getattr__(name: str) -> Any:
    """Import what a name of the Python interface stands for."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(f"cadtof_cli.api.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return what the package offers, whether it has been asked for yet or not."""
    return sorted({*globals(), *__all__})
