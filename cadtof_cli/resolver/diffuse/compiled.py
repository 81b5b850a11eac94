"""The front of the compiled twin of `pixels`, `_tail.h`: a frame's model as it takes it, and pixels answered by it."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.resolver.diffuse.records import DiffuseBlock, DiffuseModel, DiffusePixels
from cadtof_cli.resolver.two_path.kernel import NUMPY, Buffers, chosen_kernel, extension

MOST_HARMONICS = 8
"""Harmonics that the compiled twin has room for; numpy has for any."""


def runs_compiled(model: DiffuseModel, kernel: str, /) -> bool:
    """Return whether the kernel of that name answers the pixels of a model."""
    return kernel != NUMPY and len(model.settings.harmonics) <= MOST_HARMONICS


def tail_buffers(tail: DiffuseBlock, /) -> Buffers:
    """Return the model of a frame for a stretch of its pixels as the compiled twin takes it."""
    compiled, model = extension(), tail.model
    up, settings = model.upsampler, model.settings
    height, width = up.grid.height, up.grid.width
    rows, columns = up.range_m.shape
    sizes = {"first": tail.pixels.start, "height": height, "width": width, "side": up.grid.side, "left": up.first}
    sizes |= {"rows": rows, "columns": columns, "harmonics": len(settings.harmonics)}
    constants = {"separate_variance": model.separate_variance, "metres": settings.m_per_rad}
    constants |= {"nearest_m": settings.nearest_m, "nearest_rad": settings.nearest_m / settings.m_per_rad}
    offset = model.range_offset_m
    return (
        np.array([sizes[name] for name in compiled.tail_sizes()], np.int64),
        np.array([constants[name] for name in compiled.tail_constants()]),
        np.array(settings.harmonics, np.int64),
        np.array(model.variances),
        np.ascontiguousarray(up.planes),
        np.ascontiguousarray(up.range_m),
        up.down,
        up.right,
        np.asarray(up.above(np.arange(height)), np.int64),
        np.ascontiguousarray(model.separate) if model.separate.any() else None,
        None if offset is None else np.ascontiguousarray(offset, np.float64),
    )


def compiled_pixels(
    phasors: Complex, /, *, tail: DiffuseBlock, usable: Bool, samples: Float | None = None, kernel: str | None = None
) -> DiffusePixels:
    """Return what `diffuse_pixels` does, with the same bits, by a kernel that `runs_compiled`; None: the chosen one."""
    count = usable.size
    answered, rows = np.empty(count, np.bool_), np.empty((7, count), np.float32)
    given = (phasors, usable, samples)
    extension().answer_tail(
        kernel or chosen_kernel(),
        0,
        count,
        *(None if array is None else np.ascontiguousarray(array) for array in given),
        answered,
        rows,
        *tail_buffers(tail),
    )
    return DiffusePixels(tail.model.separate_variance, answered, *rows)
