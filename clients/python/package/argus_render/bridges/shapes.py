"""Triangles of simple shapes about the origin, for scenes that name them instead of triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from argus_render.bridges.glb import Floats, Material, Mesh

#: Segments of a circle. The silhouette of a sphere is off by 0.2% of its radius.
SEGMENTS = 48


def ellipsoid(radii: Floats, material: Material) -> Mesh:
    """An ellipsoid along the axes."""
    profile = _half_circle()
    points = _revolved(profile)
    normals = points / radii
    return Mesh(points * radii, _strips(len(profile)), material, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def capsule(radius: float, half: float, material: Material) -> Mesh:
    """A cylinder along z of length 2 · half, with half spheres at its ends."""
    unit = _revolved(_half_circle(doubled=True))
    points = unit * radius + np.sign(np.repeat(_ends(), SEGMENTS + 1))[:, None] * np.array([0.0, 0.0, half])
    return Mesh(points, _strips(len(_ends())), material, unit)


def cylinder(radius: float, half: float, material: Material) -> Mesh:
    """A closed cylinder along z of length 2 · half."""
    return frustum(radius, radius, half, material)


def frustum(bottom: float, top: float, half: float, material: Material) -> Mesh:
    """A closed cone along z of length 2 · half, with these radii at its ends."""
    slope = np.array([2 * half, bottom - top]) / np.hypot(2 * half, bottom - top)
    # Radius and height of each ring; rings are doubled where the normal jumps.
    profile = np.array([[0, -half], [bottom, -half], [bottom, -half], [top, half], [top, half], [0, half]])
    normal = np.array([[0, -1], [0, -1], slope, slope, [0, 1], [0, 1]])
    return Mesh(_revolved(profile), _strips(len(profile)), material, _revolved(normal))


def box(half: Floats, material: Material) -> Mesh:
    """A box of these half extents along the axes."""
    points: list[Floats] = []
    normals: list[Floats] = []
    triangles: list[list[int]] = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal, side = np.eye(3)[axis] * sign, np.eye(3)[(axis + 1) % 3]
            up = np.cross(normal, side)
            triangles += [[len(points) + corner for corner in three] for three in ((0, 1, 2), (0, 2, 3))]
            points += [(normal + a * side + b * up) * half for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            normals += [normal] * 4
    return Mesh(np.array(points), np.array(triangles), material, np.array(normals))


def rectangle(half_x: float, half_y: float, material: Material, repeat: tuple[float, float] = (1.0, 1.0)) -> Mesh:
    """A rectangle in z = 0, seen from +z, with a texture that is repeated this often."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    points = np.c_[corners * [half_x, half_y], np.zeros(4)]
    uvs = (corners * [0.5, -0.5] + 0.5) * repeat
    return Mesh(points, np.array([[0, 1, 2], [0, 2, 3]]), material, np.tile([0.0, 0.0, 1.0], (4, 1)), uvs)


def grid(heights: Floats, half_x: float, half_y: float, material: Material) -> Mesh:
    """A field of heights [rows along y, columns along x] over a rectangle in z = 0."""
    rows, columns = heights.shape
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    triangles = (first + np.array([0, 1, columns + 1, 0, columns + 1, columns])).reshape(-1, 3)
    return Mesh(np.c_[x.ravel(), y.ravel(), heights.ravel()], triangles, material)


def _ends() -> Floats:
    """The signs of the rings' heights in a half circle whose equator is doubled."""
    return np.repeat([-1.0, 1.0], SEGMENTS // 4 + 1)


def _half_circle(doubled: bool = False) -> Floats:
    """Radius and height of the rings of a unit sphere, from its south pole."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, SEGMENTS // 2 + 1)
    if doubled:
        angles = np.insert(angles, SEGMENTS // 4, 0.0)
    profile: Floats = np.c_[np.cos(angles), np.sin(angles)]
    # The poles are one point each.
    profile[[0, -1], 0] = 0.0
    return profile


def _revolved(profile: Floats) -> Floats:
    """Rings about z of points of a profile (radius, height)."""
    # The last point of a ring is its first one again, to the bit.
    around = np.linspace(0.0, 2 * np.pi, SEGMENTS + 1) % (2 * np.pi)
    radius, height = profile[:, :1], np.broadcast_to(profile[:, 1:], (len(profile), SEGMENTS + 1))
    points: Floats = np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=2).reshape(-1, 3)
    return points


def _strips(rings: int) -> NDArray[np.int64]:
    """Triangles between neighbouring rings."""
    row = SEGMENTS + 1
    first = (np.arange(rings - 1)[:, None] * row + np.arange(SEGMENTS)).reshape(-1, 1)
    triangles: NDArray[np.int64] = (first + np.array([0, 1, row + 1, 0, row + 1, row])).reshape(-1, 3)
    return triangles
