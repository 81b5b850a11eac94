"""A camera with its lamp in a room: Mitsuba's scene, what each pixel sees, and the moments of its light over time."""

import math
from dataclasses import dataclass
from typing import Any

import mitransient
import mitsuba as mi
import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.units import C_M_PER_NS
from mitsuba_rooms.materials import Plugin
from mitsuba_rooms.stage import Stage

BOUNCES, SAMPLES = 12, 64
"""Largest depth of a light path; number of light paths per pixel that are traced at a time."""

NEAR_M, FAR_M = 0.35, 5.9
"""Least and largest range in a view; the largest lies just below the unambiguous range of 40 ns."""

TRIES, EVERY = 300, 8
"""Number of views that are drawn before a room is given up; a view is judged by one pixel of so many in each direction."""


@dataclass(frozen=True)
class View:
    """A view of a room.

    Attributes:
        origin_m: place of the camera.
        target_m: point that it looks at.
        across_deg: horizontal angle of view.
        lamp_deg: half angle of the lamp's beam; None: a lamp that shines evenly all around.
        width: columns.
    """

    origin_m: Float
    target_m: Float
    across_deg: float
    lamp_deg: float | None
    width: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.width * 3 // 4, self.width

    @property
    def focal_length_px(self) -> float:
        """Focal length of the pinhole."""
        return self.width / 2 / math.tan(math.radians(self.across_deg / 2))


def drawn_view(stage: Stage, width: int, *, even: bool) -> View:
    """Draw a view of a room in which everything is within range, and few pixels see the sky."""
    for _ in range(TRIES):
        origin, target = (stage.rng.uniform(*box) for box in (stage.stand, stage.look))
        across, wider = (float(stage.rng.uniform(*limits)) for limits in (stage.across_deg, (1.25, 1.9)))
        half_diagonal = math.degrees(math.atan(1.25 * math.tan(math.radians(across / 2))))
        view = View(origin, target, across, None if even else min(wider * half_diagonal, 85.0), width)
        range_m, _ = seen(scene_of(stage, view), view, EVERY)
        met = range_m[np.isfinite(range_m)]
        near_enough = met.size > 0.85 * range_m.size and met.max() < FAR_M
        if near_enough and met.min() > NEAR_M and np.median(met) > 3 * NEAR_M:
            return view
    raise SystemExit(f"found no view in {TRIES} draws, expected one from {stage.stand} to {stage.look}")


def scene_of(stage: Stage, view: View) -> Any:
    """Return Mitsuba's scene of a room, with the camera and its lamp in one place."""
    rows, columns = view.shape
    towards = mi.ScalarTransform4f().look_at([*view.origin_m], [*view.target_m], [0, 0, 1])
    lamp: Plugin = {"type": "point", "position": [*view.origin_m]}
    if view.lamp_deg is not None:
        lamp = {"type": "spot", "to_world": towards, "cutoff_angle": view.lamp_deg, "beam_width": view.lamp_deg / 2}
    film = {"type": "phasor_hdr_film", "width": columns, "height": rows, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "fov": view.across_deg, "fov_axis": "x", "to_world": towards, "film": film}
    scene = {"type": "scene", "sensor": sensor, "lamp": {**lamp, "intensity": {"type": "spectrum", "value": 1.0}}}
    return mi.load_dict({**scene, **stage.shapes})


def seen(scene: Any, view: View, step: int = 1) -> tuple[Float, Bool]:
    """Return the range at the centres of pixels, NaN if nothing is there, and whether the surface there scatters light."""
    rows, columns = (np.arange(0.5, size, step) / size for size in view.shape)
    y, x = np.meshgrid(rows, columns, indexing="ij")
    at = mi.Point2f(mi.Float(x.ravel()), mi.Float(y.ravel()))
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, at, mi.Point2f(0.5, 0.5))
    met = scene.ray_intersect(ray)
    scatters = mi.has_flag(met.bsdf(mi.RayDifferential3f(ray)).flags(), mi.BSDFFlags.Smooth) & met.is_valid()
    # measured from the camera, because rays start at the near clip plane
    length_m = np.linalg.norm(np.array(met.p).T - view.origin_m, axis=1)
    range_m = np.where(np.array(met.is_valid()), length_m, np.nan)
    return range_m.reshape(x.shape), np.array(scatters).reshape(x.shape)


def moments(scene: Any, *, period_ns: float, highest: int, samples: int, bounces: int = BOUNCES) -> Complex:
    """Return Σ light · exp(i k 2π t / T1) of every pixel, k = 0 … highest, (highest + 1, rows, columns)."""
    film = scene.sensors()[0].film()
    turns_per_m = np.arange(highest + 1) / (C_M_PER_NS * period_ns)
    film.frequencies = mitransient.utils.ArrayXf([mi.Float(float(turns)) for turns in turns_per_m])
    integrator = mi.load_dict({"type": "transient_path", "max_depth": bounces, "rr_depth": 8})
    rounds = [
        np.array(integrator.render(scene, seed=seed, spp=SAMPLES)[1], dtype=np.float64)
        for seed in range(-(-samples // SAMPLES))
    ]
    real, imaginary = np.moveaxis(np.mean(rounds, axis=0), (3, 2), (0, 1))
    # the film's phase has the opposite sign
    turned: Complex = real - 1j * imaginary
    return turned
