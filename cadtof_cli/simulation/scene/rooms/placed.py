"""A room with its camera in place, ready to be looked at."""

from dataclasses import dataclass

from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.rooms.solids import Interior
from cadtof_cli.simulation.scene.rooms.view import View


@dataclass(frozen=True, kw_only=True)
class Room:
    """An interior, and where the camera stands in it.

    Attributes:
        interior: the room.
        position_m: of the camera.
        yaw_rad, pitch_rad: how far the camera is turned to the right and down from looking along z.
        beam_rad: half angle of the lamp's beam.
        summary: one sentence.
    """

    interior: Interior
    position_m: Vector
    yaw_rad: float
    pitch_rad: float
    beam_rad: float
    summary: str

    def view(self, camera: Camera, /, *, lamp_offset_m: Vector, light_paths: int, seed: int) -> View:
        """Return the room through a camera."""
        return View(
            interior=self.interior,
            camera=camera,
            position_m=self.position_m,
            yaw_rad=self.yaw_rad,
            pitch_rad=self.pitch_rad,
            lamp_offset_m=lamp_offset_m,
            beam_rad=self.beam_rad,
            light_paths=light_paths,
            seed=seed,
        )
