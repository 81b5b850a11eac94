"""Furniture as triangle meshes in metres that stand on z = 0 around the origin: drawn by scene_synthesizer, and a sofa."""

from collections.abc import Callable

import numpy as np
import scene_synthesizer
import trimesh
from scene_synthesizer import procedural_assets, procedural_scenes
from trimesh.creation import box, capsule, icosphere

from cadtof_cli.arrays import Float

Parts = dict[str, trimesh.Trimesh]
"""Meshes by name; the name says which part of which piece a mesh is."""

KITCHENS = ("single_wall", "galley", "l_shaped", "u_shaped", "peninsula", "island")
UP = (0.0, 0.0, 1.0)

rotation_matrix: Callable[..., Float] = trimesh.transformations.rotation_matrix
"""Return the matrix of a rotation by an angle in radians about an axis."""


def kitchen(layout: str, seed: int) -> Parts:
    """Return the kitchen that scene_synthesizer draws from a seed, in that program's own coordinates."""
    return _parts(getattr(procedural_scenes, f"kitchen_{layout}")(seed=seed))


def piece(rng: np.random.Generator) -> Parts:
    """Draw a piece of furniture, and return it."""
    wide, deep, high = rng.uniform((0.7, 0.4, 0.8), (1.5, 0.6, 2.0))
    kind = rng.integers(6)
    if kind == 0:
        return _alone(procedural_assets.TableAsset(wide, 1.5 * deep, 0.4 * high + 0.1))
    if kind == 1:
        return _alone(procedural_assets.TableWithBarsAsset(wide, 1.3 * deep, 0.4 * high + 0.1))
    if kind == 2:
        boards = int(rng.integers(3, 6))
        return _alone(procedural_assets.ShelfAsset(wide, deep, high, boards, backboard_thickness=0.01))
    if kind == 3:
        return _alone(
            procedural_assets.CubbyShelfAsset(wide, deep, high, np.arange(6).reshape(3, 2), ["open"] * 6),
        )
    if kind == 4:
        seed = int(rng.integers(1 << 30))
        return _alone(procedural_assets.RecursivelyPartitionedCabinetAsset(wide, deep, high, seed=seed))
    return _sofa(wide + 0.7, deep + 0.4)


def placed(parts: Parts, turn_rad: float, at_m: tuple[float, float, float]) -> Parts:
    """Return parts turned about the vertical, then moved."""
    for mesh in parts.values():
        mesh.apply_transform(rotation_matrix(turn_rad, UP)).apply_translation(at_m)
    return parts


def bounds(parts: Parts) -> tuple[Float, Float]:
    """Return the lowest and highest corner of all parts."""
    low = np.min([mesh.bounds[0] for mesh in parts.values()], axis=0)
    return low, np.max([mesh.bounds[1] for mesh in parts.values()], axis=0)


def _alone(made: object) -> Parts:
    scene = scene_synthesizer.Scene()
    scene.add_object(made, "thing")
    parts = _parts(scene)
    low, high = bounds(parts)
    middle = 0.5 * (low + high)
    return placed(parts, 0.0, (-middle[0], -middle[1], -low[2]))


def _parts(made: scene_synthesizer.Scene) -> Parts:
    scene, parts = made.scene, {}
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            parts[node] = mesh.copy().apply_transform(transform)
    return parts


def _sofa(wide: float, deep: float) -> Parts:
    back = deep / 2 - 0.11
    parts = {
        "sofa/seat": box((wide, deep, 0.42)).apply_translation((0, 0, 0.21)),
        "sofa/back": box((wide, 0.22, 0.85)).apply_translation((0, back, 0.425)),
    }
    for side in (-1, 1):
        arm = capsule(radius=0.13, height=deep - 0.26).apply_transform(rotation_matrix(np.pi / 2, (1, 0, 0)))
        parts[f"sofa/arm{side}"] = arm.apply_translation((side * wide / 2, deep / 2 - 0.13, 0.5))
        cushion = icosphere(3).apply_scale((0.28, 0.12, 0.26))
        parts[f"sofa/cushion{side}"] = cushion.apply_translation((side * wide / 4, back - 0.22, 0.62))
    return parts
