"""Steel parts to draw with: rounded plates, boxes, round bars; without mass, touching nothing."""

from collections.abc import Iterable
from enum import StrEnum

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

Disc = tuple[float, float, float]  # x, z, radius [m]
Point = tuple[float, float, float]  # x, y, z [m]
_CORNERS = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)


class Material(StrEnum):
    """What parts are made of."""

    PAINT = "paint"
    STEEL = "steel"
    BARREL = "barrel"
    CHROME = "chrome"
    CONCRETE = "concrete"


_LOOK = {  # rgba, specular, shininess
    Material.PAINT: ((0.90, 0.36, 0.04, 1.0), 0.35, 0.55),
    Material.STEEL: ((0.20, 0.21, 0.23, 1.0), 0.40, 0.50),
    Material.BARREL: ((0.13, 0.135, 0.15, 1.0), 0.70, 0.70),
    Material.CHROME: ((0.80, 0.82, 0.85, 1.0), 1.00, 0.90),
    Material.CONCRETE: ((0.55, 0.55, 0.54, 1.0), 0.05, 0.10),
}


def add_materials(spec: mujoco.MjSpec) -> None:
    """Make every `Material` known to the model."""
    for name, (rgba, specular, shininess) in _LOOK.items():
        spec.add_material(name=name, rgba=rgba, specular=specular, shininess=shininess)


def plate(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    discs: list[Disc],
    low: float,
    high: float,
    material: Material = Material.PAINT,
) -> None:
    """A plate in the plane of x and z, `low` to `high` to the side [m]: the hull of some discs."""
    circle = np.stack([np.cos(_CORNERS), np.sin(_CORNERS)], axis=1)
    points = np.concatenate([np.array([x, z]) + radius * circle for x, z, radius in discs])
    outline = points[ConvexHull(points).vertices]  # counter-clockwise

    # Corners are repeated for each face, with the face's normal: edges stay sharp.
    corners: list[Point] = []
    normals: list[Point] = []
    faces: list[tuple[int, int, int]] = []

    def face(polygon: list[Point], normal: Point) -> None:
        first = len(corners)
        corners.extend(polygon)
        normals.extend([normal] * len(polygon))
        faces.extend((first, first + k, first + k + 1) for k in range(1, len(polygon) - 1))

    face([(x, low, z) for x, z in outline], (0.0, -1.0, 0.0))
    face([(x, high, z) for x, z in outline[::-1]], (0.0, 1.0, 0.0))
    for (x, z), (to_x, to_z) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        along = np.array([to_x - x, to_z - z]) / np.hypot(to_x - x, to_z - z)
        rim = [(to_x, low, to_z), (x, low, z), (x, high, z), (to_x, high, to_z)]
        face(rim, (along[1], 0.0, -along[0]))

    mesh = spec.add_mesh(name=f"plate_{len(spec.meshes)}")
    mesh.uservert, mesh.usernormal = np.ravel(corners), np.ravel(normals)
    mesh.userface = mesh.userfacenormal = np.ravel(faces)
    _add(body, mujoco.mjtGeom.mjGEOM_MESH, material, meshname=mesh.name)


def plates(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    discs: list[Disc],
    inside: float,
    outside: float,
    material: Material = Material.PAINT,
) -> None:
    """The same plate on both sides, each `inside` to `outside` from the middle [m]."""
    plate(spec, body, discs, inside, outside, material)
    plate(spec, body, discs, -outside, -inside, material)


def box(body: mujoco.MjsBody, low: Point, high: Point, material: Material) -> None:
    """A box between two opposite corners."""
    corners = np.array([low, high])
    size, centre = np.diff(corners, axis=0)[0] / 2, corners.mean(axis=0)
    _add(body, mujoco.mjtGeom.mjGEOM_BOX, material, size=size, pos=centre)


def bar(body: mujoco.MjsBody, start: Point, end: Point, radius: float, material: Material) -> None:
    """A round bar."""
    size = (radius, 0.0, 0.0)
    _add(body, mujoco.mjtGeom.mjGEOM_CYLINDER, material, size=size, fromto=(*start, *end))


def pin(body: mujoco.MjsBody, at: Iterable[float], half_width: float, radius: float) -> None:
    """A pin across the plane, at (x, z) of it."""
    x, z = at
    bar(body, (x, -half_width, z), (x, half_width, z), radius, Material.STEEL)


def _add(body: mujoco.MjsBody, kind: mujoco.mjtGeom, material: Material, **shape: object) -> None:
    body.add_geom(type=kind, material=material, mass=0.0, contype=0, conaffinity=0, **shape)
