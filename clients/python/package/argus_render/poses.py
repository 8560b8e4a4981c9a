"""Poses of cameras: 4×4 matrices that map camera space to world space, in the conventions of other tools.

The service's world has +y up, lengths in metres. Each pose becomes a row of nine numbers: the eye, the direction of view,
and the direction that is up in the image.
"""

from __future__ import annotations

from typing import Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from argus_render.errors import InvalidField

Convention = Literal["opencv", "opengl", "world"]
Up = Literal["y", "z"]
T = TypeVar("T")

#: Camera axes of each convention: (direction of view, up in the image).
#: opencv (ROS, COLMAP): x right, y down, z forward. opengl (Blender, USD, glTF): x right, y up, z backward.
#: world (Isaac): x forward, y left, z up.
CONVENTIONS: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "opencv": ((0, 0, 1), (0, -1, 0)),
    "opengl": ((0, 0, -1), (0, 1, 0)),
    "world": ((1, 0, 0), (0, 0, 1)),
}

#: Rotation from the caller's world to the service's.
SERVICE_FROM_WORLD: dict[str, NDArray[np.float64]] = {
    "y": np.eye(3),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}

#: How far a rotation may be from an orthonormal one: that of a product of many float32 matrices.
TOLERANCE = 1e-3


def pose_rows(poses: ArrayLike, convention: str, up: str, field: str = "poses") -> NDArray[np.float64]:
    """Rows [N, 9] of poses [4, 4] or [N, 4, 4].

    Raises InvalidField for the first pose that is not a rigid motion, by its index under the name of the argument, `field`.
    """
    matrices = _matrices(poses, field)
    forward, above = _choice("convention", convention, CONVENTIONS)
    world = _choice("up", up, SERVICE_FROM_WORLD)
    rotations = world @ matrices[:, :3, :3]
    parts = (matrices[:, :3, 3] @ world.T, rotations @ np.array(forward), rotations @ np.array(above))
    return np.ascontiguousarray(np.concatenate(parts, axis=1))


def world_rays(rays: ArrayLike, rows: NDArray[np.float64], convention: str) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """Directions [len(rows), H·W, 3] in the service's world, and (H, W), of `rays` [W, 3] or [H, W, 3] in the cameras' axes.

    A direction of zeros stays one: it is no ray.
    """
    try:
        directions = np.asarray(rays, np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidField("rays", f"must be numbers: {error}") from None
    if directions.ndim not in (2, 3) or directions.shape[-1] != 3 or directions.size == 0:
        raise InvalidField("rays", f"must be of shape [W, 3] or [H, W, 3], not {list(directions.shape)}")
    if not np.isfinite(directions).all():
        raise InvalidField("rays", "must be finite")
    height, width = directions.shape[-3] if directions.ndim == 3 else 1, directions.shape[-2]
    forward, above = (np.array(axis, float) for axis in _choice("convention", convention, CONVENTIONS))
    in_camera = np.stack([forward, above, np.cross(forward, above)], axis=1)
    view, high = rows[:, 3:6], rows[:, 6:9]
    in_world = np.stack([view, high, np.cross(view, high)], axis=2)
    # Of unit length, since large numbers do not fit into float32.
    flat = directions.reshape(-1, 3)
    longest = np.abs(flat).max(axis=1, keepdims=True)
    flat = np.divide(flat, longest, out=np.zeros_like(flat), where=longest > 0.0)
    turned = np.einsum("nij,kj->nki", in_world @ in_camera.T, flat)
    return np.ascontiguousarray(turned, np.float32), (height, width)


def pose(row: ArrayLike, convention: str, up: str) -> NDArray[np.float64]:
    """The pose [4, 4] of a row: the inverse of `pose_rows`. The row's directions need not be perpendicular or of unit length."""
    forward, above = (np.array(axis, float) for axis in _choice("convention", convention, CONVENTIONS))
    world_from_service = _choice("up", up, SERVICE_FROM_WORLD).T
    eye, view, high = np.asarray(row, float).reshape(3, 3) @ world_from_service.T
    view /= np.linalg.norm(view)
    side = np.cross(view, high)
    side /= np.linalg.norm(side)
    in_world = np.stack([view, np.cross(side, view), side], axis=1)
    in_camera = np.stack([forward, above, np.cross(forward, above)], axis=1)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = in_world @ in_camera.T, eye
    return matrix


def _matrices(poses: ArrayLike, field: str) -> NDArray[np.float64]:
    try:
        matrices = np.asarray(poses, np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidField(field, f"must be numbers: {error}") from None
    if matrices.shape[-2:] != (4, 4) or matrices.ndim not in (2, 3) or matrices.size == 0:
        raise InvalidField(field, f"must be of shape [4, 4] or [N, 4, 4], not {list(matrices.shape)}")
    matrices = matrices.reshape(-1, 4, 4)
    rotations = matrices[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        skewed = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(axis=(1, 2))
        checks = [
            (~np.isfinite(matrices).all(axis=(1, 2)), "must be finite"),
            ((matrices[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1), "its last row must be 0 0 0 1"),
            (~(skewed <= TOLERANCE), "its upper left 3×3 must be a rotation: unit columns, perpendicular to one another"),
            (~(np.linalg.det(rotations) > 0.0), "its upper left 3×3 mirrors: a camera cannot"),
        ]
    for wrong, reason in checks:
        if wrong.any():
            raise InvalidField(f"{field}[{int(wrong.argmax())}]", reason)
    return matrices


def _choice(field: str, name: str, known: dict[str, T]) -> T:
    if name not in known:
        raise InvalidField(field, f"{name!r} is none of {', '.join(known)}")
    return known[name]
