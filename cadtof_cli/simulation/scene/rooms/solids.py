"""The surfaces that rays meet in a room: its own six faces from within, and boxes and balls that stand in it.

Lengths are in metres, in the room's coordinates: x to the right, y down from the ceiling, z into the room. All surfaces are
Lambertian. Rays are float32, because there are so many that they decide how long a rendering takes; 10⁻⁶ of a room is a
micrometre.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Float32, Index
from cadtof_cli.errors import require
from cadtof_cli.simulation.scene.geometry import Vector

FACES = ("left", "right", "ceiling", "floor", "near", "far")
"""Names of the faces of a box, by number: 2·axis, plus 1 on the side of larger coordinates."""

MARGIN_M = 1e-4
"""Distance before a surface at which a ray starts, so that rounding never puts its start behind the surface."""

BLOCK = 16384
"""Number of rays that are followed together; it is so small that their arrays stay in the cache."""

NEIGHBOURS_M = 1.0
"""Largest distance between the centre of a group's first solid and the centres of its other solids."""

_TINY = 1e-12
"""Added to slopes, so that no ray is exactly parallel to a face."""


@dataclass(frozen=True, kw_only=True)
class Box:
    """A cuboid, turned about the upright axis.

    Attributes:
        centre_m: centre of the box.
        half_m: half of its width, height and depth.
        turn_rad: angle by which it is turned from x towards z.
        albedo: albedo of all its faces.
    """

    centre_m: Vector
    half_m: Vector
    turn_rad: float = 0.0
    albedo: float = 0.5

    @property
    def reach_m(self) -> float:
        """Distance of its corners from its centre."""
        return math.hypot(*self.half_m)

    def entry(self, origins_m: Float32, directions: Float32, /) -> Float32:
        """Return the distance along each ray, (3, n), to where it enters the box, (n,); inf where it misses the box."""
        cosine, sine = math.cos(self.turn_rad), math.sin(self.turn_rad)
        x, y, z = (origin - centre for origin, centre in zip(origins_m, self.centre_m, strict=True))
        dx, dy, dz = directions
        x, z = cosine * x + sine * z, cosine * z - sine * x
        dx, dz = cosine * dx + sine * dz, cosine * dz - sine * dx
        near, far = _slab(y, dy, self.half_m[1])
        for start, slope, half in ((x, dx, self.half_m[0]), (z, dz, self.half_m[2])):
            enter, leave = _slab(start, slope, half)
            np.maximum(near, enter, out=near)
            np.minimum(far, leave, out=far)
        near[(near > far) | (near <= 0)] = np.inf
        return near


@dataclass(frozen=True, kw_only=True)
class Ball:
    """A sphere."""

    centre_m: Vector
    radius_m: float
    albedo: float = 0.5

    @property
    def reach_m(self) -> float:
        """Its radius."""
        return self.radius_m

    def entry(self, origins_m: Float32, directions: Float32, /) -> Float32:
        """Return the distance along each ray, (3, n), to where it enters the ball, (n,); inf where it misses the ball."""
        x, y, z = (origin - centre for origin, centre in zip(origins_m, self.centre_m, strict=True))
        dx, dy, dz = directions
        along = x * dx + y * dy + z * dz
        inside = along * along - (x * x + y * y + z * z - self.radius_m**2)
        near: Float32 = -along - np.sqrt(np.maximum(inside, 0))
        near[(inside < 0) | (near <= 0)] = np.inf
        return near


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A rectangle on a face of the room with its own albedo. With albedo 0 it is an opening, where light is lost.

    Attributes:
        face: number of the face, as in FACES.
        low_m, high_m: opposite corners; their coordinates along the axis at right angles to the face do not count.
    """

    face: int
    low_m: Vector
    high_m: Vector
    albedo: float

    def holds(self, points_m: Float32, /) -> Bool:
        """Return which of the points (3, n) of its face lie in the patch."""
        within = np.ones(points_m.shape[1], dtype=np.bool_)
        for axis in range(3):
            if axis != self.face // 2:
                within &= (points_m[axis] >= self.low_m[axis]) & (points_m[axis] <= self.high_m[axis])
        return within


@dataclass(frozen=True)
class _Group:
    """Solids near each other; most rays miss all of them.

    Attributes:
        solids: the solids, in the order of the room's solids.
        first: number of the first of these solids.
    """

    solids: tuple[Box | Ball, ...]
    first: int

    def near(self, origins_m: Float32, directions: Float32) -> Index:
        """Return the indices of the rays, (3, n), that pass through the ball around the group."""
        centre, radius = self._ball
        x, y, z = (origin - at for origin, at in zip(origins_m, centre, strict=True))
        dx, dy, dz = directions
        along = x * dx + y * dy + z * dz
        squared = x * x + y * y + z * z
        squared -= radius**2
        behind = (along > 0) & (squared > 0)
        along *= along
        return np.flatnonzero((along >= squared) & ~behind)

    @cached_property
    def _ball(self) -> tuple[Vector, float]:
        """Centre and radius of a ball around all solids; it is a little larger than needed."""
        x, y, z = (sum(part) / len(self.solids) for part in zip(*(s.centre_m for s in self.solids), strict=True))
        reach = max(math.dist((x, y, z), solid.centre_m) + solid.reach_m for solid in self.solids)
        return (x, y, z), 1.001 * reach + 10 * MARGIN_M


@dataclass(frozen=True)
class Meetings:
    """Where rays meet surfaces.

    Attributes:
        lengths_m: (n,), distance along the ray.
        points_m, normals: (3, n); normals look into the room.
        albedo: (n,), 0 at an opening.
        surface: (n,), number of the surface; it is equal for rays that meet the same face of the same solid.
    """

    lengths_m: Float32
    points_m: Float32
    normals: Float32
    albedo: Float32
    surface: NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class Interior:
    """A room with the solids that stand in it.

    Attributes:
        size_m: width, height and depth; the room reaches from 0 to these values.
        albedos: albedos of the six faces.
        patches: rectangles on the faces; later rectangles cover earlier ones.
        boxes, balls: the solids; the lamp and the camera must not be inside of them.
    """

    size_m: Vector
    albedos: tuple[float, float, float, float, float, float]
    patches: tuple[Patch, ...] = ()
    boxes: tuple[Box, ...] = ()
    balls: tuple[Ball, ...] = ()

    def __post_init__(self) -> None:
        require(all(0 < size < 1000 for size in self.size_m), "room", self.size_m, "lengths above 0 m")
        every = (*self.albedos, *(patch.albedo for patch in self.patches), *(solid.albedo for solid in self.solids))
        require(all(0 <= albedo <= 1 for albedo in every), "albedos", every, "0 to 1")

    @property
    def solids(self) -> tuple[Box | Ball, ...]:
        """The solids that stand in the room, boxes first."""
        return (*self.boxes, *self.balls)

    @property
    def area_m2(self) -> float:
        """Area of all six faces together."""
        width, height, depth = self.size_m
        return 2.0 * (width * height + height * depth + depth * width)

    def meet(self, origins_m: Float32, directions: Float32, /) -> Meetings:
        """Return where rays from within the room, (3, n) with unit directions, first meet a surface."""
        count = origins_m.shape[1]
        lengths, solid = np.empty(count, np.float32), np.zeros(count, np.intp)
        for start in range(0, count, BLOCK):
            block = slice(start, start + BLOCK)
            self._nearest(origins_m[:, block], directions[:, block], lengths[block], solid[block])
        points = origins_m + lengths * directions
        normals, face = self._faces(points, solid)
        albedo = self._table[3][solid]
        walls = np.flatnonzero(solid == 0)
        albedo[walls] = np.asarray(self.albedos, np.float32)[face[walls]]
        for patch in self.patches:
            there = walls[face[walls] == patch.face]
            albedo[there[patch.holds(points[:, there])]] = patch.albedo
        return Meetings(lengths, points, normals, albedo, (8 * solid + face).astype(np.int32))

    def clear(self, origins_m: Float32, directions: Float32, lengths_m: Float32, /) -> Bool:
        """Return which rays, (3, n), meet no solid before the given lengths, (n,)."""
        free = np.ones(origins_m.shape[1], dtype=np.bool_)
        for start in range(0, len(free), BLOCK):
            block = slice(start, start + BLOCK)
            for group in self._groups:
                near = start + group.near(origins_m[:, block], directions[:, block])
                if not len(near):
                    continue
                starts, ways = origins_m[:, near], directions[:, near]
                for solid in group.solids:
                    free[near] &= solid.entry(starts, ways) >= lengths_m[near]
        return free

    def _nearest(self, origins_m: Float32, directions: Float32, lengths: Float32, solid: NDArray[np.intp]) -> None:
        """Fill in the distance of the nearest surface, and the number of its solid: 0 is the room, then boxes, then balls."""
        lengths[:] = np.inf
        for origin, slope, size in zip(origins_m, directions, self.size_m, strict=True):
            np.minimum(lengths, _slab(origin - size / 2, slope, size / 2)[1], out=lengths)
        for group in self._groups:
            near = group.near(origins_m, directions)
            if not len(near):
                continue
            starts, ways, best, whose = origins_m[:, near], directions[:, near], lengths[near], solid[near]
            for number, part in enumerate(group.solids, start=group.first):
                entry = part.entry(starts, ways)
                closer = entry < best
                np.copyto(best, entry, where=closer)
                whose[closer] = number
            lengths[near], solid[near] = best, whose

    def _faces(self, points_m: Float32, solid: NDArray[np.intp]) -> tuple[Float32, NDArray[np.intp]]:
        """Return the normals at points of the given solids, (3, n), and the number of the face on which each point lies."""
        centres, halves, turns, _ = self._table
        x, y, z = points_m - centres[:, solid]
        cosine, sine = turns[:, solid]
        local = np.stack([cosine * x + sine * z, y, cosine * z - sine * x])
        depth = np.abs(local) / halves[:, solid]
        axis = np.argmax(depth, axis=0)
        (side,) = np.take_along_axis(local, axis[None], axis=0) > 0
        sign = np.where(side != (solid == 0), 1, -1).astype(np.float32)
        nx, ny, nz = (np.where(axis == a, sign, np.float32(0)) for a in range(3))
        normals = np.stack([cosine * nx - sine * nz, ny, sine * nx + cosine * nz])
        round_ones = solid > len(self.boxes)
        if round_ones.any():
            normals[:, round_ones] = np.stack([x, y, z])[:, round_ones] / halves[0, solid[round_ones]]
        return normals, np.where(round_ones, 0, 2 * axis + side)

    @cached_property
    def _groups(self) -> tuple[_Group, ...]:
        """The solids in groups of neighbours."""
        groups: list[_Group] = []
        for number, solid in enumerate(self.solids, start=1):
            if groups and math.dist(groups[-1].solids[0].centre_m, solid.centre_m) < NEIGHBOURS_M:
                groups[-1] = _Group((*groups[-1].solids, solid), groups[-1].first)
            else:
                groups.append(_Group((solid,), number))
        return tuple(groups)

    @cached_property
    def _table(self) -> tuple[Float32, Float32, Float32, Float32]:
        """Centres and half sizes, (3, n), cosine and sine of the turn, (2, n), and albedos, (n,), of the room and its solids."""
        half = [size / 2 for size in self.size_m]
        centres = [half, *(box.centre_m for box in self.boxes), *(ball.centre_m for ball in self.balls)]
        halves = [half, *(box.half_m for box in self.boxes), *((ball.radius_m,) * 3 for ball in self.balls)]
        turns = np.array([0.0, *(box.turn_rad for box in self.boxes), *(0.0 for _ in self.balls)])
        albedos = [0.0, *(part.albedo for part in self.solids)]
        return (
            np.array(centres, np.float32).T,
            np.array(halves, np.float32).T,
            np.stack([np.cos(turns), np.sin(turns)]).astype(np.float32),
            np.array(albedos, np.float32),
        )


def _slab(starts: Float32, slopes: Float32, half: float) -> tuple[Float32, Float32]:
    """Return where rays enter and leave the space between −half and half."""
    inverse = np.reciprocal(slopes + np.float32(_TINY))
    middle = starts * inverse
    reach = np.abs(inverse, out=inverse)
    reach *= np.float32(half)
    return -(middle + reach), np.subtract(reach, middle, out=middle)
