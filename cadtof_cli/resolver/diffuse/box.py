"""The walls of a room that a view does not show.

They are guessed at right angles to the walls that it shows, so that the room is a box.
"""

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.planes import Surfaces

PARALLEL = 0.97
"""Smallest cosine between normals of one direction: 14°, by which MPI bends a wall as long as the MPI is not known."""

UPRIGHT = 0.25
"""Largest cosine between the first direction of walls and the second, before the second is turned to a right angle."""

LEAST_SHARE = 0.04
"""Share of the patches of which more must face one way, for a second direction to be taken from them."""

FARTHEST_SHARE = 0.98
"""Share of the patches that a wall must lie behind; the rest may have wrong ranges."""

FACING = 0.9
"""Smallest cosine between the normal of a patch and that of the wall on which it lies."""

ON_WALL = 0.1
"""Largest distance of a patch from the wall on which it lies, over the distance of the wall."""

SEEN_SHARE = 0.02
"""A wall is seen if more than this share of the patches lies on it."""

BEHIND_M = 0.2
"""How far behind the outermost patch a wall is guessed. Near walls give most of the early light that would be missed."""

NEAREST_M = 0.7
"""Smallest distance of a wall from the camera: somebody holds the camera."""


@dataclass(frozen=True, eq=False)
class Box:
    """Walls around the camera: unit normals away from it, (6, 3), and distances in m, (6,).

    The distance of a wall that is seen is infinite.
    """

    outward: Float
    distance_m: Float

    def meet(self, ray: Float, /) -> tuple[Float, Float]:
        """Return the distance at which unit rays, (3, n), meet the first guessed wall, and its normal towards the camera."""
        towards = self.outward @ ray
        ahead = towards > 0.0
        distance = np.where(ahead, self.distance_m[:, None] / np.where(ahead, towards, 1.0), np.inf)
        first = distance.argmin(0)
        return distance.min(0), -self.outward[first].T


def unseen_walls(seen: Surfaces, /) -> Box:
    """Return the walls of the box that surfaces, (n,), lie in; a wall on which enough of them lie is seen."""
    axes = _axes(seen.normal)
    outward = np.concatenate([axes, -axes])
    along = outward @ (seen.ray * seen.range_m)
    facing = -(outward @ seen.normal) > FACING
    farthest = np.sort(along, axis=1)[:, int(FARTHEST_SHARE * (along.shape[1] - 1))]
    on_wall = facing & (np.abs(along - farthest[:, None]) < ON_WALL * np.maximum(farthest, NEAREST_M)[:, None])
    shown = on_wall.sum(1) > SEEN_SHARE * on_wall.shape[1]
    return Box(outward, np.where(shown, np.inf, np.maximum(np.maximum(farthest, 0.0) + BEHIND_M, NEAREST_M)))


def _axes(normal: Float) -> Float:
    """Return three directions at right angles, as rows, along which most of the normals, (3, n), lie.

    If only one direction is seen, the second is the camera's own horizontal: cameras are held level.
    """
    single = normal.astype(np.float32)
    # a copy: numpy takes three times as long for the product of an array with itself
    alike = (np.abs(single.T @ single.copy()) > PARALLEL).astype(np.float32)
    most = alike.sum(0).argmax()
    first = _mean_direction(normal, most, alike[most])
    upright = (np.abs(first @ normal) < UPRIGHT).astype(np.float32)
    others = (alike @ upright) * upright
    most = others.argmax()
    if others[most] > LEAST_SHARE * len(alike):
        second = _mean_direction(normal, most, alike[most] * upright)
    else:
        second = np.array([1.0, 0.0, 0.0]) if abs(first[0]) < PARALLEL else np.array([0.0, 0.0, 1.0])
    second = second - (second * first).sum() * first
    second /= np.sqrt((second * second).sum())
    # written out: numpy.cross takes ten times as long
    (a, b, c), (d, e, f) = first, second
    return np.array([first, second, [b * f - c * e, c * d - a * f, a * e - b * d]])


def _mean_direction(normal: Float, most: np.intp, alike: Float32) -> Float:
    """Return the mean of the normals in `alike`, (n,), all parallel to normal number `most`.

    Opposite normals count as one direction.
    """
    total = normal @ (np.sign(normal[:, most] @ normal) * alike)
    direction: Float = total / np.sqrt((total * total).sum())
    return direction
