"""The prediction of diffuse MPI for a frame, in the form that tests need."""

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.phasors.pooling import SharedNoise
from cadtof_cli.resolver.diffuse.choice import SEPARATE_SHARE, DiffuseChoice, patch_kinds
from cadtof_cli.resolver.diffuse.grid import View, assumed_view, patch_grid, sampled_pixels
from cadtof_cli.resolver.diffuse.light import FrameTraits, patch_means, sampled_light
from cadtof_cli.resolver.diffuse.pixels import diffuse_pixels
from cadtof_cli.resolver.diffuse.predict import diffuse_model
from cadtof_cli.resolver.diffuse.records import DiffuseModel, DiffusePixels
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
    samples: float = 1.0,
    range_offset_m: F | None = None,
    second_paths: bool = False,
    period_ns: float = T1_NS,
    terms: tuple[tuple[int, float], ...] | None = None,
) -> DiffuseModel | DiffuseChoice:
    """Return the diffuse model of a frame (H, Y, X), or the choice if another model is chosen.

    In most tests the tail is the same all over the view. Tails of rooms never are, but second paths may be. With
    `second_paths`, such frames are taken for second paths, as in the pipeline. Without it, only frames with enough
    separate patches are.
    """
    height, width = phasors.shape[1:]
    view = None if focal_px is None else View(focal_px, ((width - 1) / 2, (height - 1) / 2))
    harmonics = harmonics or tuple(range(1, len(phasors) + 1))
    sampled = sampled_pixels(height, width)
    use = (np.ones((height, width), bool) if usable is None else usable)[sampled]
    grid = patch_grid(height, width, view or assumed_view(height, width))
    light = sampled_light(phasors[:, *sampled], use, grid, harmonics=harmonics)
    settings = DiffuseSettings(model=model, period_ns=period_ns, harmonics=harmonics, terms=terms)
    noise = np.full(len(phasors), variance(n_av))
    traits = FrameTraits(grid, settings, noise / samples, tuple(noise.tolist()), SharedNoise(1.0, 0.0), range_offset_m)
    means = patch_means(light, light.seen, traits)
    kinds = patch_kinds(light, means, traits)
    choice = kinds.choice
    if not second_paths and choice.separate_share <= SEPARATE_SHARE and choice.reason == "separate paths":
        choice = replace(choice, reason="tail")
        kinds = replace(kinds, choice=choice)
    if choice.reason != "tail":
        return choice
    found = diffuse_model(light, means, kinds, traits)
    return replace(choice, reason=found) if isinstance(found, str) else found


def predicted(phasors: Z, model: DiffuseModel, *, usable: B | None = None, step: int | None = None) -> DiffusePixels:
    """Return the answers of all pixels, computed `step` pixels at a time."""
    flat = phasors.reshape(len(phasors), -1)
    count = flat.shape[1]
    use = np.ones(count, bool) if usable is None else usable.ravel()
    step = step or count
    parts = [
        diffuse_pixels(flat[:, a : a + step], model=model, first=a, usable=use[a : a + step])
        for a in range(0, count, step)
    ]
    joined = (np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(DiffusePixels))
    return DiffusePixels(*joined)


def answers(phasors: Z, *, focal_px: float | None = 60.0, n_av: float = 1e5, model: MpiModel = "auto") -> DiffusePixels:
    """Return the answers of a frame for which the diffuse model must be chosen."""
    found = model_of(phasors, focal_px=focal_px, n_av=n_av, model=model)
    assert isinstance(found, DiffuseModel)
    return predicted(phasors, found)
