"""The scene that `simulate --scene room` records: a room that a seed draws, perhaps with a net in it."""

import math
from dataclasses import dataclass

from cadtof_cli.errors import require
from cadtof_cli.simulation.pixel.mix import require_ratio
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.net import Net, drawn_net
from cadtof_cli.simulation.scene.rooms.random_rooms import MOST_FURNITURE, random_room
from cadtof_cli.simulation.scene.rooms.rendering import light_in_room
from cadtof_cli.simulation.scene.rooms.view import Room, View


@dataclass(frozen=True, kw_only=True)
class RandomRoom:
    """A room whose surfaces light each other; a seed draws everything in it.

    Attributes:
        seed: seed of the room.
        furniture: number of pieces of furniture; None draws 0 to 8.
        albedo: albedo of all surfaces; None draws one for each surface.
        lamp_offset_m: offset from the camera to its lamp: to the right, down, forward.
        beam_deg: half angle of the lamp's beam; None draws 42° to 65°.
        asr: ratio of ambient to direct photons for a surface with the median irradiance of the view.
        light_paths: number of light paths from each traced pixel; every fourth pixel is traced. The scatter of the rendering
            falls with the root of this number.
        tracing_seed: seed of the light paths alone.
        net_fill: share of light that a net across the middle of the view sends back; None: there is no net.
        net_distance_m: distance of the net along the optical axis; None draws it.
    """

    seed: int = 0
    furniture: int | None = None
    albedo: float | None = None
    lamp_offset_m: Vector = (0.0, 0.0, 0.0)
    beam_deg: float | None = None
    asr: float = 2.0
    light_paths: int = 256
    tracing_seed: int = 0
    net_fill: float | None = None
    net_distance_m: float | None = None

    def __post_init__(self) -> None:
        pieces, albedo, beam = self.furniture, self.albedo, self.beam_deg
        require(self.seed >= 0, "seed", self.seed, "0 or more")
        require(pieces is None or 0 <= pieces <= MOST_FURNITURE, "furniture", pieces, f"0 to {MOST_FURNITURE} pieces")
        require(albedo is None or 0 < albedo <= 0.95, "albedo", albedo, "above 0, at most 0.95")
        require(math.hypot(*self.lamp_offset_m) <= 0.3, "lamp offset", self.lamp_offset_m, "0.3 m or less")
        require(beam is None or 1 <= beam <= 180, "beam", beam, "1° to 180°")
        require_ratio(self.asr, "ASR", f"{self.asr:g}")
        require(1 <= self.light_paths <= 100_000, "light paths", self.light_paths, "1 to 100000")
        fill, distance = self.net_fill, self.net_distance_m
        require(fill is None or 0 < fill < 1, "net fill", fill, "a share above 0 and below 1")
        require(distance is None or 0.2 <= distance <= 10, "net distance", distance, "0.2 to 10 m")
        require(distance is None or fill is not None, "net distance", distance, "both a net distance and a net fill")

    @property
    def room(self) -> Room:
        """The room that the seed draws, without a net."""
        return random_room(self.seed, furniture=self.furniture, albedo=self.albedo, beam_deg=self.beam_deg)

    @property
    def net(self) -> Net | None:
        """The net, if there is one."""
        if self.net_fill is None:
            return None
        return drawn_net(self.room, fill=self.net_fill, distance_m=self.net_distance_m, seed=self.seed)

    @property
    def summary(self) -> str:
        """One sentence about the scene."""
        net = self.net
        with_net = "" if net is None else f", a net {net.distance_m:.2f} m away with a fill of {net.fill:g}"
        return f"{self.room.summary}{with_net}; all bounces of light, traced"

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return the direct path, and one path for each bin of the transient of light by way of other surfaces."""
        room, net = self.room, self.net
        light = self._light(room, camera, rows)
        return light if net is None else net.mixed(self._light(net.hung(room), camera, rows), light)

    def _light(self, room: Room, camera: Camera, rows: slice) -> Light:
        view = View(
            room=room,
            camera=camera,
            lamp_offset_m=self.lamp_offset_m,
            light_paths=self.light_paths,
            seed=self.tracing_seed,
        )
        return light_in_room(view, rows, asr=self.asr)
