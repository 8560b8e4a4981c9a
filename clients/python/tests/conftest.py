"""A service that all tests share, and its scene: a room whose walls have six colours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import argus_render
from argus_render.bridges import shapes
from argus_render.bridges.glb import Material, Mesh, Node, write_glb

#: The walls, by the axis of the service's world on which they stand, 1 m from the middle.
WALLS = {
    "+x": (1, 0, 0),
    "-x": (0, 1, 1),
    "+y": (0, 1, 0),
    "-y": (1, 0, 1),
    "+z": (0, 0, 1),
    "-z": (1, 1, 0),
}


def axis(name: str) -> np.ndarray:
    return np.eye(3)["xyz".index(name[1])] * (1.0 if name[0] == "+" else -1.0)


def wall_of(pixel: np.ndarray) -> str:
    """The wall whose colour a pixel has."""
    bright = tuple(int(channel > int(pixel.max()) // 2) for channel in pixel)
    return next(name for name, color in WALLS.items() if color == bright)


def looking(forward: str, above: str, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """An OpenCV pose that looks along one axis, with another one up in the image."""
    view, up = axis(forward), axis(above)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([np.cross(view, up), -up, view], axis=1), at
    return pose


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = Node("room")
    for name, color in WALLS.items():
        material = Material(name, (0.0, 0.0, 0.0, 1.0), emission=tuple(map(float, color)))
        square = shapes.rectangle(1.0, 1.0, material)
        inward = -axis(name)
        side = np.roll(inward, 1)
        turn = np.stack([side, np.cross(inward, side), inward], axis=1)
        mesh = Mesh(square.points @ turn.T - inward, square.triangles, material)
        root.children.append(Node(name, meshes=[mesh]))
    path = tmp_path_factory.mktemp("scene") / "room.glb"
    write_glb(path, root)
    return path


@pytest.fixture(scope="session")
def renderer(room: Path) -> Iterator[argus_render.Renderer]:
    with argus_render.open(room, workers=1) as renderer:
        yield renderer
