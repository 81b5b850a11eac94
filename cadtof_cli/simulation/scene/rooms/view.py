"""A room with a camera in it: the place of the camera, the surfaces that its pixels see, and the lamp's direct light on them."""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.errors import require
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.rooms.lamp import Lamp
from cadtof_cli.simulation.scene.rooms.solids import Interior, Meetings

COARSE_CAMERA = Camera(width=40, height=30, focal_length_px=29.0)
"""The camera that looks at a room before it is rendered. It has few pixels, and its view is 69° wide, wider than the default."""


@dataclass(frozen=True, kw_only=True)
class Room:
    """A room with its camera in place, ready to be looked at.

    Attributes:
        interior: the room.
        position_m: position of the camera in the room's coordinates.
        yaw_rad, pitch_rad: how far the camera is turned to the right and then down from looking along z.
        beam_rad: half angle of the lamp's beam; the middle of the beam is the optical axis.
        summary: one sentence about the room.
    """

    interior: Interior
    position_m: Vector
    yaw_rad: float
    pitch_rad: float
    beam_rad: float
    summary: str = ""


@dataclass(frozen=True, kw_only=True)
class View:
    """A room, seen by a camera with its lamp at an offset, in the camera's coordinates.

    `light_paths` is the number of light paths from each traced pixel, and `seed` that of the tracing.
    """

    room: Room
    camera: Camera
    lamp_offset_m: Vector = (0.0, 0.0, 0.0)
    light_paths: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        inside = all(0 < at < size for at, size in zip(self.lamp.position_m, self.room.interior.size_m, strict=True))
        require(inside, "lamp offset", self.lamp_offset_m, "a lamp within the room; it stands in or behind a wall")

    @property
    def turn(self) -> Float:
        """Rotation from the camera's coordinates to the room's coordinates, (3, 3)."""
        a, b = self.room.yaw_rad, self.room.pitch_rad
        right_left = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
        up_down = np.array([[1, 0, 0], [0, math.cos(b), math.sin(b)], [0, -math.sin(b), math.cos(b)]])
        return np.asarray(right_left @ up_down)

    @property
    def lamp(self) -> Lamp:
        """The camera's lamp in the room's coordinates."""
        x, y, z = np.asarray(self.room.position_m) + self.turn @ np.asarray(self.lamp_offset_m)
        ahead = self.turn[:, 2]
        return Lamp(
            position_m=(float(x), float(y), float(z)),
            axis=(float(ahead[0]), float(ahead[1]), float(ahead[2])),
            beam_rad=self.room.beam_rad,
        )

    def meet(self, rays: Float, /) -> Meetings:
        """Return where rays from the camera, (3, n) in its coordinates, meet surfaces."""
        directions = (self.turn @ (rays / np.linalg.norm(rays, axis=0))).astype(np.float32)
        start = np.asarray(self.room.position_m, np.float32)[:, None]
        return self.room.interior.meet(np.broadcast_to(start, directions.shape), directions)

    def direct(self, seen: Meetings, /) -> Float32:
        """Return the lamp's irradiance on the points where rays have met surfaces, (n,)."""
        return self.lamp.irradiance(self.room.interior, seen.points_m, seen.normals)
