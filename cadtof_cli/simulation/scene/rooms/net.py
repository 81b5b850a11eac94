"""A net, or a pane that scatters, in a room: it sends back a share of each pixel's light and lets the rest through.

A pixel then sees the sum of two rooms. One room has the net as a solid panel; its weight is the share of the net that is thread.
The other room has no net; its weight is the share of the net that is hole. Light by way of other surfaces is mixed in the same
way. That is exact if the net is equally open for this light. Light that would pass the net twice gets the same weight as light
that passes it once.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.solids import Box
from cadtof_cli.simulation.scene.rooms.view import COARSE_CAMERA, Room, View

SEED_KEY = 7
"""Branch of the seed from which a net is drawn, so that the room is the same with and without a net."""

DRAWN_DISTANCE = (0.35, 0.85)
"""Limits between which a net's distance is drawn, over the distance of the surfaces behind it."""

DRAWN_HALF = ((0.12, 0.3), (0.12, 0.25))
"""Limits of half the net's width and of half its height, over its distance: 6 to 36 % of the view."""

DRAWN_ASIDE_RAD = math.radians(8.0)
"""Largest angle between the net's middle and the view's middle, to either side."""

DRAWN_ALBEDO = (0.4, 0.9)
"""Least and largest albedo of the net's threads."""

HALF_THICKNESS_M = 0.002

NEARER_NS = 1e-3
"""A panel hides a surface if its direct light comes earlier by more than this; rounding errors are far smaller."""


@dataclass(frozen=True, kw_only=True)
class Net:
    """A net in a room: the share of light that it sends back, the solid panel in its place, and its distance."""

    fill: float
    panel: Box
    distance_m: float

    def hung(self, room: Room, /) -> Room:
        """Return the room with the panel in it."""
        interior = replace(room.interior, boxes=(*room.interior.boxes, self.panel))
        return replace(room, interior=interior)

    def mixed(self, panel: Light, room: Light, /) -> Light:
        """Return the light on pixels, mixed from the light in the room with the solid panel and in the room without it."""
        hidden = panel.delays_ns[0] < room.delays_ns[0] - NEARER_NS
        threads, holes = self.fill, 1.0 - self.fill
        direct = threads * panel.photons[0] + np.where(hidden, 0.0, holes * room.photons[0])
        behind = np.where(hidden, holes * room.photons[0], 0.0)
        return Light(
            delays_ns=np.concatenate(
                [panel.delays_ns[:1], room.delays_ns[:1], panel.delays_ns[1:], room.delays_ns[1:]]
            ),
            photons=np.concatenate([direct[None], behind[None], threads * panel.photons[1:], holes * room.photons[1:]]),
            ambient=threads * panel.ambient + holes * room.ambient,
            ranges_m=panel.ranges_m,
        )


def drawn_net(room: Room, /, *, fill: float, distance_m: float | None, seed: int) -> Net:
    """Return the net of a seed: it is upright, faces the camera, and is near the middle of the camera's view.

    It sends back the share `fill` of the light. `distance_m` is its distance along the optical axis; None draws it.
    """
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SEED_KEY,)))
    share, aside = float(generator.uniform(*DRAWN_DISTANCE)), float(generator.uniform(-1.0, 1.0)) * DRAWN_ASIDE_RAD
    distance = share * _middle_range_m(room) if distance_m is None else distance_m
    half_width, half_height = (distance * float(generator.uniform(*span)) for span in DRAWN_HALF)
    yaw, level = room.yaw_rad + aside, distance * math.cos(room.pitch_rad)
    x, y, z = room.position_m
    panel = Box(
        centre_m=(x + level * math.sin(yaw), y + distance * math.sin(room.pitch_rad), z + level * math.cos(yaw)),
        half_m=(half_width, half_height, HALF_THICKNESS_M),
        turn_rad=-room.yaw_rad,
        albedo=float(generator.uniform(*DRAWN_ALBEDO)),
    )
    return Net(fill=fill, panel=panel, distance_m=distance)


def _middle_range_m(room: Room) -> float:
    """Return the range of the surfaces in the middle of the view: the median over its middle third."""
    view = View(room=room, camera=COARSE_CAMERA)
    height, width = COARSE_CAMERA.height, COARSE_CAMERA.width
    rays = COARSE_CAMERA.rays(slice(height // 3, -(height // 3)))[:, :, width // 3 : -(width // 3)]
    return float(np.median(view.meet(rays.reshape(3, -1)).lengths_m))
