"""A room that is being built: its shapes for Mitsuba, and where a camera may stand and look."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import mitsuba as mi
import numpy as np
import trimesh
from numpy.typing import ArrayLike

from mitsuba_rooms.furniture import Parts
from mitsuba_rooms.materials import Plugin, drawn, paint

Place = tuple[float, float, float]
Box = tuple[Place, Place]
Hole = tuple[tuple[float, float], tuple[float, float]]
"""A hole in a wall: its start and end along the wall's first edge, and along the second edge, in metres."""

WALLS = ("front", "back", "left", "right")
"""Names of the walls for a viewer who stands outside the front wall and looks along y."""

REVEAL_M = 0.12
"""Depth of the sides of windows and doors."""


@dataclass
class Stage:
    """A room with z up, in metres.

    Attributes:
        rng: the source of all random numbers.
        folder: folder of the files of meshes.
        shapes: shapes by name.
        stand, look: boxes from which the camera's place and the point that it looks at are drawn.
        across_deg: smallest and largest horizontal angle of view.
    """

    rng: np.random.Generator
    folder: Path
    shapes: dict[str, Plugin] = field(default_factory=dict)
    stand: Box = ((0, 0, 0), (0, 0, 0))
    look: Box = ((0, 0, 0), (0, 0, 0))
    across_deg: tuple[float, float] = (50, 70)

    def between(self, low: float, high: float) -> float:
        """Draw a number between two limits."""
        return float(self.rng.uniform(low, high))

    def add(self, shape: Plugin) -> None:
        """Add a shape."""
        self.shapes[f"shape{len(self.shapes)}"] = shape

    def mesh(self, mesh: trimesh.Trimesh, material: Plugin, *, smooth: bool = False) -> None:
        """Add a mesh; a smooth mesh gets shading normals."""
        path = self.folder / f"{len(self.shapes)}.ply"
        trimesh.Trimesh(mesh.vertices, mesh.faces, process=smooth).export(path)
        self.add({"type": "ply", "filename": str(path), "face_normals": not smooth, "bsdf": material})

    def furnish(self, parts: Parts, *, materials: int) -> None:
        """Add parts, with a number of different materials; parts of one kind have the same material."""
        palette = [drawn(self.rng) for _ in range(materials)]
        kinds: dict[str, list[trimesh.Trimesh]] = {}
        for name, mesh in parts.items():
            kinds.setdefault(re.sub(r"[\d_]+", "", name), []).append(mesh)
        for kind in sorted(kinds):
            joined = trimesh.util.concatenate(kinds[kind])
            assert isinstance(joined, trimesh.Trimesh)
            self.mesh(joined, palette[int(self.rng.integers(materials))])

    def rectangle(self, corner: ArrayLike, a: ArrayLike, b: ArrayLike, material: Plugin) -> None:
        """Add a rectangle from a corner along two edges."""
        start, first, second = (np.asarray(x, float) for x in (corner, a, b))
        normal = np.cross(first, second)
        place = np.eye(4)
        place[:3] = np.column_stack(
            [first / 2, second / 2, normal / np.linalg.norm(normal), start + (first + second) / 2]
        )
        self.add({"type": "rectangle", "to_world": mi.ScalarTransform4f(place), "bsdf": material})

    def wall(self, corner: ArrayLike, a: ArrayLike, b: ArrayLike, material: Plugin, hole: Hole | None = None) -> None:
        """Add a wall, with a hole if one is given; the wall's inside is the side to which a × b points."""
        if hole is None:
            self.rectangle(corner, a, b, material)
            return
        start, first, second = (np.asarray(x, float) for x in (corner, a, b))
        wide, high = float(np.linalg.norm(first)), float(np.linalg.norm(second))
        along, up = first / wide, second / high
        (left, right), (low, top) = hole
        pieces = ((0.0, left, 0.0, high), (right, wide, 0.0, high), (left, right, 0.0, low), (left, right, top, high))
        for x0, x1, y0, y1 in pieces:
            if min(x1 - x0, y1 - y0) > 1e-6:
                self.rectangle(start + x0 * along + y0 * up, (x1 - x0) * along, (y1 - y0) * up, material)
        outward, sill, side = -REVEAL_M * np.cross(along, up), (right - left) * along, (top - low) * up
        at = start + left * along + low * up
        for edge_start, edge in ((at, sill), (at, side), (at + side, sill), (at + sill, side)):
            self.rectangle(edge_start, edge, outward, material)

    def shell(self, low: Place, high: Place, floor: Plugin, top: Plugin, holes: dict[str, Hole] | None = None) -> None:
        """Add floor, ceiling and four painted walls, with holes by the wall's name."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        wide, deep = x1 - x0, y1 - y0
        self.rectangle(low, (wide, 0, 0), (0, deep, 0), floor)
        self.rectangle((x0, y0, z1), (wide, 0, 0), (0, deep, 0), top)
        edges = (
            ((x1, y0, z0), (-wide, 0, 0)),
            ((x0, y1, z0), (wide, 0, 0)),
            ((x0, y0, z0), (0, deep, 0)),
            ((x1, y1, z0), (0, -deep, 0)),
        )
        for name, (corner, edge) in zip(WALLS, edges, strict=True):
            self.wall(corner, edge, (0, 0, z1 - z0), paint(self.rng), (holes or {}).get(name))
