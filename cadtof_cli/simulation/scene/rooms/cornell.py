"""A box in the manner of Cornell's: white walls, one dark side, two blocks, open towards the camera.

The size is that of a small room, so that delays are those of rooms. The blocks stand as in the original, which is a box of
553 mm. The albedos are grey values of its red, green and white paints.
"""

import math
from dataclasses import dataclass

from cadtof_cli.errors import require
from cadtof_cli.simulation.pixel.mix import require_ratio
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.rendering import light_in_room
from cadtof_cli.simulation.scene.rooms.solids import Box, Interior, Patch
from cadtof_cli.simulation.scene.rooms.view import Room, View

SIZE_M = 2.765
"""Length of each side of the box, five times the original's."""

STAND_OFF_M = 1.6
"""Distance of the camera from the open side."""

BLOCK_WIDTH_M = 0.825
"""Width and depth of both blocks."""

WHITE, RED, GREEN = 0.75, 0.6, 0.35


@dataclass(frozen=True, kw_only=True)
class CornellBox:
    """Cornell's box, seen through its open side.

    Attributes:
        asr: ratio of ambient to direct photons for a surface with the median irradiance of the view.
        light_paths: number of light paths from each traced pixel; every fourth pixel is traced.
        tracing_seed: seed of the light paths.
    """

    asr: float = 2.0
    light_paths: int = 256
    tracing_seed: int = 0

    def __post_init__(self) -> None:
        require_ratio(self.asr, "ASR", f"{self.asr:g}")
        require(1 <= self.light_paths <= 100_000, "light paths", self.light_paths, "1 to 100000")

    @property
    def summary(self) -> str:
        """One sentence about the scene."""
        return f"box in the manner of Cornell's, {SIZE_M:g} m wide, with two blocks; all bounces of light, traced"

    @property
    def room(self) -> Room:
        """The box, its blocks, and black space between it and the camera."""
        depth = STAND_OFF_M + SIZE_M
        before = tuple(
            Patch(face=face, low_m=(0.0, 0.0, 0.0), high_m=(SIZE_M, SIZE_M, STAND_OFF_M), albedo=0.0)
            for face in range(4)
        )
        return Room(
            interior=Interior(
                size_m=(SIZE_M, SIZE_M, depth),
                albedos=(RED, GREEN, WHITE, WHITE, 0.0, WHITE),
                patches=before,
                boxes=(_block(1.85, 0.84, 0.825, 0.29), _block(0.93, 1.76, 1.65, -0.30)),
            ),
            position_m=(SIZE_M / 2, SIZE_M / 2, 0.05),
            yaw_rad=0.0,
            pitch_rad=0.0,
            beam_rad=math.radians(40.0),
        )

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return the direct path, and one path for each bin of the transient of light by way of other surfaces."""
        view = View(room=self.room, camera=camera, light_paths=self.light_paths, seed=self.tracing_seed)
        return light_in_room(view, rows, asr=self.asr)


def _block(x_m: float, z_m: float, height_m: float, turn_rad: float) -> Box:
    """Return a white block on the floor of the box; z counts from the open side."""
    return Box(
        centre_m=(x_m, SIZE_M - height_m / 2, STAND_OFF_M + z_m),
        half_m=(BLOCK_WIDTH_M / 2, height_m / 2, BLOCK_WIDTH_M / 2),
        turn_rad=turn_rad,
        albedo=WHITE,
    )
