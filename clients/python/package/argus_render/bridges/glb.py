"""Writes GLB files: nodes by name, triangles, materials, textures and lights.

Written after the glTF 2.0 specification and its extension KHR_lights_punctual. Lengths are in metres, +y is up.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Rotation of a world with +z up into one with +y up.
Y_UP_FROM_Z_UP: Floats = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])

_FLOAT, _UINT = 5126, 5125
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}


@dataclass(eq=False)
class Material:
    """A surface. Colours are linear."""

    name: str = ""
    color: tuple[float, ...] = (0.8, 0.8, 0.8, 1.0)
    metallic: float = 0.0
    roughness: float = 0.8
    emission: tuple[float, ...] = (0.0, 0.0, 0.0)
    #: sRGB pixels [height, width, 3 or 4], uint8, row 0 at v = 0; times the colour.
    texture: NDArray[np.uint8] | None = None


@dataclass(eq=False)
class Mesh:
    """Triangles of one material. Nodes may share it."""

    #: [V, 3], metres.
    points: Floats
    #: [T, 3], indices of points, counter-clockwise from outside.
    triangles: NDArray[np.int64]
    material: Material
    #: [V, 3], unit length.
    normals: Floats | None = None
    #: [V, 2], v downwards.
    uvs: Floats | None = None


@dataclass(eq=False)
class Light:
    """A light of a node, along its −z."""

    #: "directional", "point" or "spot".
    kind: str
    color: tuple[float, ...]
    #: lux of a directional light, else candela.
    intensity: float
    #: Half the angle of a spot's cone, radians.
    cone: float | None = None


@dataclass(eq=False)
class Node:
    """A named frame, relative to its parent's."""

    name: str
    matrix: Floats = field(default_factory=lambda: np.eye(4))
    meshes: list[Mesh] = field(default_factory=list)
    light: Light | None = None
    children: list[Node] = field(default_factory=list)


def write_glb(path: Path, root: Node) -> None:
    """Writes a tree of nodes as one file."""
    writer = _Writer()
    scene = writer.node(root)
    writer.document.update(scene=0, scenes=[{"nodes": [scene]}])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(writer.finish())


def linear(srgb: NDArray[Any]) -> Floats:
    """Linear values of sRGB ones, 0 to 1 (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, np.float64)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


class _Writer:
    def __init__(self) -> None:
        self.document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "argus-render"}}
        self.data = bytearray()
        #: Indices of what was written, by list and identity.
        self.written: dict[tuple[str, int], int] = {}

    def node(self, node: Node) -> int:
        entry: dict[str, Any] = {"name": node.name}
        if not np.array_equal(node.matrix, np.eye(4)):
            entry["matrix"] = np.asarray(node.matrix, float).T.ravel().tolist()
        if node.meshes:
            entry["mesh"] = self.mesh(node.name, node.meshes)
        if node.light:
            entry["extensions"] = {"KHR_lights_punctual": {"light": self.light(node.light)}}
        children = [self.node(child) for child in node.children]
        if children:
            entry["children"] = children
        return self.add("nodes", entry)

    def mesh(self, name: str, meshes: list[Mesh]) -> int:
        return self.add("meshes", {"name": name, "primitives": [self.primitive(mesh) for mesh in meshes]})

    def primitive(self, mesh: Mesh) -> dict[str, Any]:
        def attributes() -> int:
            return self.accessor(np.asarray(mesh.points, "<f4"), bounded=True)

        attribute = {"POSITION": self.once("points", mesh.points, attributes)}
        for name, values in (("NORMAL", mesh.normals), ("TEXCOORD_0", mesh.uvs)):
            if values is not None:
                array = np.asarray(values, "<f4")
                attribute[name] = self.once(name, values, lambda array=array: self.accessor(array))  # type: ignore[misc]
        indices = np.asarray(mesh.triangles, "<u4").reshape(-1, 1)
        return {
            "attributes": attribute,
            "indices": self.once("triangles", mesh.triangles, lambda: self.accessor(indices)),
            "material": self.once("materials", mesh.material, lambda: self.material(mesh.material)),
        }

    def material(self, material: Material) -> int:
        surface: dict[str, Any] = {
            "baseColorFactor": [float(part) for part in material.color],
            "metallicFactor": float(material.metallic),
            "roughnessFactor": float(material.roughness),
        }
        texture = material.texture
        if texture is not None:
            surface["baseColorTexture"] = {"index": self.once("textures", texture, lambda: self.texture(texture))}
        entry = {"name": material.name, "pbrMetallicRoughness": surface, "doubleSided": True}
        if any(material.emission):
            entry["emissiveFactor"] = [float(min(part, 1.0)) for part in material.emission]
        if material.color[3] < 1.0:
            entry["alphaMode"] = "BLEND"
        return self.add("materials", entry)

    def texture(self, pixels: NDArray[np.uint8]) -> int:
        image = self.add("images", {"mimeType": "image/png", "bufferView": self.view(_png(pixels))})
        return self.add("textures", {"source": image})

    def light(self, light: Light) -> int:
        entry: dict[str, Any] = {"type": light.kind, "intensity": float(light.intensity)}
        entry["color"] = [float(part) for part in light.color]
        if light.cone is not None:
            entry["spot"] = {"outerConeAngle": float(light.cone)}
        self.document["extensionsUsed"] = ["KHR_lights_punctual"]
        extensions = self.document.setdefault("extensions", {})
        lights: list[Any] = extensions.setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(entry)
        return len(lights) - 1

    def accessor(self, array: NDArray[Any], bounded: bool = False) -> int:
        kind = _FLOAT if array.dtype.kind == "f" else _UINT
        entry: dict[str, Any] = {"bufferView": self.view(array.tobytes()), "componentType": kind}
        entry.update(count=len(array), type=_SHAPES[array.shape[1]])
        if bounded:
            entry.update(min=array.min(axis=0).tolist(), max=array.max(axis=0).tolist())
        return self.add("accessors", entry)

    def view(self, data: bytes) -> int:
        self.data += bytes(-len(self.data) % 4)
        offset = len(self.data)
        self.data += data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": offset, "byteLength": len(data)})

    def once(self, name: str, value: object, write: Callable[[], int]) -> int:
        key = (name, id(value))
        if key not in self.written:
            self.written[key] = write()
        return self.written[key]

    def add(self, name: str, entry: dict[str, Any]) -> int:
        entries: list[Any] = self.document.setdefault(name, [])
        entries.append(entry)
        return len(entries) - 1

    def finish(self) -> bytes:
        self.data += bytes(-len(self.data) % 4)
        self.document["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.document).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.data), b"BIN\0") + self.data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """An image [height, width, 3 or 4] as PNG, without filters."""
    height, width, channels = pixels.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 3)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body
