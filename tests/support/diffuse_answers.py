"""The prediction run on a frame, as tests ask for it."""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.resolver.diffuse.grid import View, assumed_view, patch_grid, sampled_pixels
from cadtof_cli.resolver.diffuse.light import sampled_light
from cadtof_cli.resolver.diffuse.pixels import diffuse_pixels
from cadtof_cli.resolver.diffuse.predict import diffuse_model
from cadtof_cli.resolver.diffuse.records import DiffuseChoice, DiffuseModel, DiffusePixels
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.settings import MpiModel
from tests.support.diffuse_frames import T1_NS, F, Z, variance

B = NDArray[np.bool_]


def model_of(
    phasors: Z,
    *,
    focal_px: float | None = 60.0,
    usable: B | None = None,
    model: MpiModel = "auto",
    harmonics: tuple[int, ...] | None = None,
    n_av: float = 1e5,
    samples: F | None = None,
    range_offset_m: F | None = None,
) -> DiffuseModel | DiffuseChoice:
    """The model of a frame (H, Y, X), or the choice against it."""
    height, width = phasors.shape[1:]
    view = None if focal_px is None else View(focal_px, ((width - 1) / 2, (height - 1) / 2))
    harmonics = harmonics or tuple(range(1, len(phasors) + 1))
    sampled = sampled_pixels(height, width)
    use = (np.ones((height, width), bool) if usable is None else usable)[sampled]
    grid = patch_grid(height, width, view or assumed_view(height, width))
    return diffuse_model(
        sampled_light(phasors[:, *sampled], use, grid, harmonics=harmonics),
        grid=grid,
        variances=(variance(n_av),) * len(phasors),
        settings=DiffuseSettings(model=model, period_ns=T1_NS, harmonics=harmonics),
        samples=samples,
        range_offset_m=range_offset_m,
    )


def predicted(phasors: Z, model: DiffuseModel, *, usable: B | None = None, step: int | None = None) -> DiffusePixels:
    """The answers of all pixels, `step` at a time."""
    flat = phasors.reshape(len(phasors), -1)
    count = flat.shape[1]
    use = np.ones(count, bool) if usable is None else usable.ravel()
    step = step or count
    parts = [
        diffuse_pixels(
            flat[:, a : a + step], tail=model.block(slice(a, min(a + step, count))), usable=use[a : a + step]
        )
        for a in range(0, count, step)
    ]
    joined = (np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(DiffusePixels)[1:])
    return DiffusePixels(model.separate_variance, *joined)


def answers(phasors: Z, *, focal_px: float | None = 60.0, n_av: float = 1e5, model: MpiModel = "auto") -> DiffusePixels:
    """The answers of a frame that the diffuse model is taken for."""
    found = model_of(phasors, focal_px=focal_px, n_av=n_av, model=model)
    assert isinstance(found, DiffuseModel)
    return predicted(phasors, found)
