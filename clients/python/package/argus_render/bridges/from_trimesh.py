"""trimesh: meshes and scenes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from argus_render.bridges.glb import Y_UP_FROM_Z_UP
from argus_render.bridges.target import target
from argus_render.errors import InvalidField
from argus_render.poses import Up


def from_trimesh(mesh: Any, path: str | os.PathLike[str] | None = None, *, up: Up = "y") -> Path:
    """Writes a `trimesh.Trimesh` or `trimesh.Scene` as GLB, and returns the file's path.

    mesh: lengths in metres. Meshes of other tools are made by `trimesh.Trimesh(vertices, faces)`, such as of Open3D.
    path: the file; without it, a temporary one that is removed when this process ends.
    up: axis that is up in the mesh's world. Poses in the same world are rendered with the same `up`.
    """
    import trimesh

    if not isinstance(mesh, (trimesh.Trimesh, trimesh.Scene)):
        raise InvalidField("mesh", f"must be a trimesh.Trimesh or trimesh.Scene, not {type(mesh).__name__}")
    scene = trimesh.Scene(mesh) if isinstance(mesh, trimesh.Trimesh) else mesh.copy()
    surfaces = [part for part in scene.geometry.values() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not surfaces:
        raise InvalidField("mesh", "has no triangles")
    if up == "z":
        scene.apply_transform(Y_UP_FROM_Z_UP)
    file = target(path, "mesh")
    file.write_bytes(scene.export(file_type="glb", include_normals=True))
    return file
