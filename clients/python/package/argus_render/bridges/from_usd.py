"""USD: the meshes, simple shapes, materials and lights of a stage, at one time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from argus_render.bridges import shapes
from argus_render.bridges.glb import Y_UP_FROM_Z_UP, Floats, Light, Material, Mesh, Node, write_glb
from argus_render.bridges.target import target
from argus_render.errors import InvalidField


def from_usd(
    stage: Any, path: str | os.PathLike[str] | None = None, *, time: float | None = None
) -> Path:
    """Writes a USD stage, or the file of one, as GLB in metres with +y up, and returns the file's path.

    Each prim that is shown is a node of its path. `UsdGeom.GetStageUpAxis` says which `up` poses of the stage's world have.
    path: the file; without it, a temporary one that is removed when this process ends.
    time: the time code; without it, the stage's default.

    Meshes (faces are cut into fans; subdivision surfaces show their cage), cubes, spheres, cylinders, cones and capsules, the
    colours of UsdPreviewSurface and displayColor, and distant and sphere lights are written. Textures are not.
    """
    from pxr import Usd, UsdGeom

    if isinstance(stage, (str, os.PathLike)):
        if not os.path.exists(stage):
            raise InvalidField("stage", f"{os.fspath(stage)} does not exist")
        stage = Usd.Stage.Open(os.fspath(stage))
    at = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    metres = UsdGeom.GetStageMetersPerUnit(stage)
    matrix = np.diag([metres, metres, metres, 1.0])
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
        matrix = Y_UP_FROM_Z_UP @ matrix
    root = Node("stage", matrix)
    poses, reader = UsdGeom.XformCache(at), _Reader(at, metres)
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Imageable) or UsdGeom.Imageable(prim).ComputeVisibility(at) == "invisible":
            continue
        if UsdGeom.Imageable(prim).ComputePurpose() not in ("default", "render"):
            continue
        # USD's matrices are of row vectors.
        world = np.array(poses.GetLocalToWorldTransform(prim)).T
        meshes, light = reader.meshes(prim), reader.light(prim)
        if meshes or light:
            root.children.append(Node(str(prim.GetPath()), world, meshes, light))
    if not any(node.meshes for node in root.children):
        raise InvalidField("stage", "has no triangles that are shown")
    file = target(path, "stage")
    write_glb(file, root)
    return file


class _Reader:
    """Reads prims at a time code."""

    def __init__(self, at: Any, metres: float) -> None:
        #: Metres of a unit of length.
        self.metres = metres
        self.at = at
        self.materials: dict[Any, Material] = {}

    def meshes(self, prim: Any) -> list[Mesh]:
        """The triangles of a prim in its own frame: one mesh a material."""
        from pxr import UsdGeom

        if not prim.IsA(UsdGeom.Gprim):
            return []
        material, upright = self.material(prim), np.eye(3)
        if prim.IsA(UsdGeom.Mesh):
            return self.mesh(UsdGeom.Mesh(prim))
        if prim.IsA(UsdGeom.Cube):
            return [shapes.box(np.full(3, self.value(prim, "size") / 2), material)]
        if prim.IsA(UsdGeom.Sphere):
            return [shapes.ellipsoid(np.full(3, self.value(prim, "radius")), material)]
        for kind in (UsdGeom.Cylinder, UsdGeom.Cone, UsdGeom.Capsule):
            if prim.IsA(kind):
                radius, half = self.value(prim, "radius"), self.value(prim, "height") / 2
                if kind is UsdGeom.Capsule:
                    shape = shapes.capsule(radius, half, material)
                else:
                    shape = shapes.frustum(radius, 0.0 if kind is UsdGeom.Cone else radius, half, material)
                # About z unless the prim names another axis: a cyclic change of axes keeps the handedness.
                upright = np.roll(upright, "XYZ".index(prim.GetAttribute("axis").Get(self.at)) + 1, axis=0)
                shape.points, shape.normals = shape.points @ upright.T, _turned(shape.normals, upright)
                return [shape]
        return []

    def mesh(self, mesh: Any) -> list[Mesh]:
        """A polygon mesh. Its corners are apart, since normals may differ by face."""
        from pxr import UsdGeom

        points = np.array(mesh.GetPointsAttr().Get(self.at), np.float64).reshape(-1, 3)
        counts = np.array(mesh.GetFaceVertexCountsAttr().Get(self.at), np.int64).reshape(-1)
        indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(self.at), np.int64).reshape(-1)
        if counts.sum() != len(indices) or (len(indices) and not 0 <= indices.min() <= indices.max() < len(points)):
            raise InvalidField(str(mesh.GetPath()), "its faces do not fit its points")
        corners, faces = _fans(counts)
        if mesh.GetOrientationAttr().Get(self.at) == UsdGeom.Tokens.leftHanded:
            corners = corners[:, ::-1]
        normals = self.normals(mesh, indices)
        parts: dict[int, Material] = {}
        of_face = np.full(len(counts), -1)
        for i, subset in enumerate(UsdGeom.Subset.GetGeomSubsets(mesh, UsdGeom.Tokens.face, "materialBind")):
            of_face[np.array(subset.GetIndicesAttr().Get(self.at), np.int64)] = i
            parts[i] = self.material(subset.GetPrim())
        if (of_face < 0).any():
            parts[-1] = self.material(mesh.GetPrim())
        meshes = []
        for i, material in parts.items():
            chosen = corners[of_face[faces] == i].ravel()
            if len(chosen):
                triangles = np.arange(len(chosen)).reshape(-1, 3)
                own = None if normals is None else normals[chosen]
                meshes.append(Mesh(points[indices[chosen]], triangles, material, own))
        return meshes

    def normals(self, mesh: Any, indices: NDArray[np.int64]) -> Floats | None:
        """Unit normals of all corners, where the mesh has them for points or corners."""
        from pxr import UsdGeom

        primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
        if primvar.HasValue():
            values, way = primvar.ComputeFlattened(self.at), primvar.GetInterpolation()
        else:
            values, way = mesh.GetNormalsAttr().Get(self.at), mesh.GetNormalsInterpolation()
        normals = np.array(values, np.float64).reshape(-1, 3) if values is not None else np.empty((0, 3))
        if way in ("vertex", "varying") and len(normals) > indices.max(initial=-1):
            normals = normals[indices]
        elif way != "faceVarying" or len(normals) != len(indices):
            return None
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return normals / lengths if (lengths > 0).all() else None

    def material(self, prim: Any) -> Material:
        """The material that is bound to a prim, or its displayColor."""
        from pxr import UsdGeom, UsdShade

        bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if bound:
            key = bound.GetPath()
            if key not in self.materials:
                self.materials[key] = self.preview_surface(bound)
            return self.materials[key]
        color = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor").Get(self.at)
        first = tuple(map(float, color[0])) if color else (0.8, 0.8, 0.8)
        return self.materials.setdefault(first, Material("", (*first, 1.0)))

    def preview_surface(self, material: Any) -> Material:
        """The constant inputs of a UsdPreviewSurface."""
        shader, _, _ = material.ComputeSurfaceSource()

        def value(name: str, usual: Any) -> Any:
            found = shader.GetInput(name) if shader else None
            given = found.Get(self.at) if found else None
            return usual if given is None else given

        color, emission = value("diffuseColor", (0.18,) * 3), value("emissiveColor", (0.0,) * 3)
        return Material(
            str(material.GetPath()),
            (*map(float, color), float(value("opacity", 1.0))),
            float(value("metallic", 0.0)),
            float(value("roughness", 0.5)),
            tuple(map(float, emission)),
        )

    def light(self, prim: Any) -> Light | None:
        """A distant or sphere light."""
        from pxr import UsdLux

        if not (prim.IsA(UsdLux.DistantLight) or prim.IsA(UsdLux.SphereLight)):
            return None
        api = UsdLux.LightAPI(prim)
        color = tuple(map(float, api.GetColorAttr().Get(self.at)))
        strength = api.GetIntensityAttr().Get(self.at) * 2.0 ** api.GetExposureAttr().Get(self.at)
        normalized = api.GetNormalizeAttr().Get(self.at)
        if prim.IsA(UsdLux.DistantLight):
            # A radiance over the disk of the sky that it fills, unless it is a lux already.
            half = np.radians(self.value(prim, "inputs:angle")) / 2
            return Light("directional", color, strength * (1.0 if normalized or half == 0 else np.pi * np.sin(half) ** 2))
        # A sphere of radius r and radiance L sends π r² L in each direction; a normalized one's L is over its surface, 4 π r².
        area = 0.25 if normalized else np.pi * self.value(prim, "inputs:radius") ** 2
        return Light("point", color, strength * area * self.metres**2)

    def value(self, prim: Any, name: str) -> float:
        return float(prim.GetAttribute(name).Get(self.at))


def _fans(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles [T, 3] of corners, fans about each face's first corner, and the face of each."""
    cuts = np.maximum(counts - 2, 0)
    faces = np.repeat(np.arange(len(counts)), cuts)
    first = (np.cumsum(counts) - counts)[faces]
    step = np.arange(len(faces)) - np.repeat(np.cumsum(cuts) - cuts, cuts)
    return np.stack([first, first + step + 1, first + step + 2], axis=1), faces


def _turned(normals: Floats | None, rotation: Floats) -> Floats | None:
    return None if normals is None else normals @ rotation.T
