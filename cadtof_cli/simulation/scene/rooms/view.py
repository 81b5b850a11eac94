"""A room with a camera in it: where that stands, what its pixels see, and the light of its lamp on that."""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.errors import require
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.rooms.lamp import Lamp
from cadtof_cli.simulation.scene.rooms.solids import Interior, Meetings

LOOKING = Camera(width=40, height=30, focal_length_px=29.0)
"""The camera that looks at a room before it is rendered: few pixels, and 69° across, wider than the usual one."""


@dataclass(frozen=True, kw_only=True)
class Room:
    """A room with its camera in place, ready to be looked at.

    Attributes:
        interior: the room.
        position_m: of the camera, in the room's frame.
        yaw_rad, pitch_rad: how far it is turned to the right and then down from looking along z.
        beam_rad: half angle of the lamp's beam, whose middle is the optical axis.
        summary: one sentence.
    """

    interior: Interior
    position_m: Vector
    yaw_rad: float
    pitch_rad: float
    beam_rad: float
    summary: str = ""


@dataclass(frozen=True, kw_only=True)
class View:
    """A room through a camera.

    Attributes:
        room: the room.
        camera: array and lens.
        lamp_offset_m: from the camera to its lamp, in the camera's frame.
        light_paths: traced from each traced pixel.
        seed: of the tracing.
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
        """Rotation from the camera's frame to the room's, (3, 3)."""
        a, b = self.room.yaw_rad, self.room.pitch_rad
        right_left = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
        up_down = np.array([[1, 0, 0], [0, math.cos(b), math.sin(b)], [0, -math.sin(b), math.cos(b)]])
        return np.asarray(right_left @ up_down)

    @property
    def lamp(self) -> Lamp:
        """The camera's lamp in the room's frame."""
        x, y, z = np.asarray(self.room.position_m) + self.turn @ np.asarray(self.lamp_offset_m)
        ahead = self.turn[:, 2]
        return Lamp(
            position_m=(float(x), float(y), float(z)),
            axis=(float(ahead[0]), float(ahead[1]), float(ahead[2])),
            beam_rad=self.room.beam_rad,
        )

    def meet(self, rays: Float, /) -> Meetings:
        """Return what rays in the camera's frame, (3, n), meet."""
        directions = (self.turn @ (rays / np.linalg.norm(rays, axis=0))).astype(np.float32)
        start = np.asarray(self.room.position_m, np.float32)[:, None]
        return self.room.interior.meet(np.broadcast_to(start, directions.shape), directions)

    def direct(self, seen: Meetings, /) -> Float32:
        """Return the lamp's irradiance where rays have met surfaces, (n,)."""
        return self.lamp.irradiance(self.room.interior, seen.points_m, seen.normals)
