"""Depth maps free of multi-path interference from CA-dToF cameras.

The Python interface is `from cadtof_cli import read_frames, resolve, read_maps, simulate_scene`; see docs/python.md. The module
behind each name is imported when the name is first used, so importing the package costs nothing.
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
"""The module of `cadtof_cli/api` that defines each name."""


def __getattr__(name: str) -> Any:
    """Import the function or class that a name of the Python interface stands for, and return it."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(f"cadtof_cli.api.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return all names of the package, including names that are not imported yet."""
    return sorted({*globals(), *__all__})
