"""MuJoCo: the geoms and lights of a model, at the pose of its data."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from argus_render.bridges import shapes
from argus_render.bridges.glb import Y_UP_FROM_Z_UP, Floats, Light, Material, Mesh, Node, linear, write_glb
from argus_render.bridges.target import target
from argus_render.errors import InvalidField

#: Groups of geoms that MuJoCo's own viewer shows: what only collides is in the others.
SHOWN_GROUPS = 3

#: Half the side of a plane without limits, in extents of the model.
ENDLESS = 20.0

#: lux of a white light of MuJoCo, whose lights have no unit. Exposure follows from the whole scene.
LUX = 3.0


def from_mujoco(
    model: Any, data: Any = None, path: str | os.PathLike[str] | None = None, *, lights: bool = True
) -> Path:
    """Writes a `mujoco.MjModel` as GLB, and returns the file's path.

    Each body is a node of its name, and holds its geoms. MuJoCo's world has +z up: render its poses with `up="z"`.
    data: the pose, from `mujoco.MjData` after `mj_forward`; without it, that of `qpos0`. The file does not follow it later.
    path: the file; without it, a temporary one that is removed when this process ends.
    lights: whether the model's lights are written. Nothing else is lit then, such as by MuJoCo's headlight; without lights the
        service gives the scene a sun and a sky.

    Of textures, those of planes and meshes are written. Skins, flexes, tendons are not.
    """
    import mujoco

    if data is None:
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
    root = Node("world", Y_UP_FROM_Z_UP)
    bodies = [Node(_name(mujoco, model, "BODY", i), _pose(data.xpos[i], data.xmat[i])) for i in range(model.nbody)]
    materials: dict[Any, Material] = {}
    for geom in range(model.ngeom):
        mesh = _geom(mujoco, model, geom, materials)
        if mesh is not None:
            name = _name(mujoco, model, "GEOM", geom)
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
            node = Node(name, _pose(model.geom_pos[geom], rotation), [mesh])
            bodies[model.geom_bodyid[geom]].children.append(node)
    if not any(body.children for body in bodies):
        raise InvalidField("model", "has no geom that is shown")
    active = [i for i in range(model.nlight) if lights and model.light_active[i]]
    root.children = bodies + [_light(mujoco, model, data, i) for i in active]
    file = target(path, "mujoco")
    write_glb(file, root)
    return file


def _geom(mujoco: Any, model: Any, geom: int, materials: dict[Any, Material]) -> Mesh | None:
    """The triangles of a geom in its own frame; None if it is not shown."""
    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = kinds(int(model.geom_type[geom]))
    if model.geom_group[geom] >= SHOWN_GROUPS:
        return None
    material = _material(mujoco, model, geom, materials)
    if material.color[3] == 0.0:
        return None
    if kind == kinds.mjGEOM_PLANE:
        endless = ENDLESS * model.stat.extent
        half_x, half_y = (float(half) if half > 0 else endless for half in size[:2])
        id = model.geom_matid[geom]
        repeat = model.mat_texrepeat[id] if id >= 0 else np.ones(2)
        # A uniform texture repeats per metre, others over the plane.
        uniform = id >= 0 and model.mat_texuniform[id]
        times = repeat * (2 * np.array([half_x, half_y]) if uniform or size[0] <= 0 else 1.0)
        return shapes.rectangle(half_x, half_y, material, (float(times[0]), float(times[1])))
    if kind == kinds.mjGEOM_SPHERE:
        return shapes.ellipsoid(np.full(3, size[0]), material)
    if kind == kinds.mjGEOM_ELLIPSOID:
        return shapes.ellipsoid(size.copy(), material)
    if kind == kinds.mjGEOM_CAPSULE:
        return shapes.capsule(size[0], size[1], material)
    if kind == kinds.mjGEOM_CYLINDER:
        return shapes.cylinder(size[0], size[1], material)
    if kind == kinds.mjGEOM_BOX:
        return shapes.box(size.copy(), material)
    if kind == kinds.mjGEOM_HFIELD:
        id = model.geom_dataid[geom]
        rows, columns, begin = model.hfield_nrow[id], model.hfield_ncol[id], model.hfield_adr[id]
        half_x, half_y, top, _ = model.hfield_size[id]
        heights = model.hfield_data[begin : begin + rows * columns].reshape(rows, columns) * top
        return shapes.grid(heights, half_x, half_y, material)
    if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        return _mesh(model, model.geom_dataid[geom], material)
    return None


def _mesh(model: Any, id: int, material: Material) -> Mesh:
    """A mesh with its corners apart, since normals and texture coordinates have indices of their own."""
    begin, count = model.mesh_faceadr[id], model.mesh_facenum[id]
    faces = slice(begin, begin + count)
    points = model.mesh_vert[model.mesh_vertadr[id] + model.mesh_face[faces].ravel()]
    normals = model.mesh_normal[model.mesh_normaladr[id] + model.mesh_facenormal[faces].ravel()]
    first_uv, uvs = model.mesh_texcoordadr[id], None
    if first_uv >= 0:
        uvs = model.mesh_texcoord[first_uv + model.mesh_facetexcoord[faces].ravel()]
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = normals / lengths if (lengths > 0).all() else None
    return Mesh(points, np.arange(3 * count).reshape(-1, 3), material, unit, uvs)


def _material(mujoco: Any, model: Any, geom: int, known: dict[Any, Material]) -> Material:
    """The material of a geom. Its colour is the geom's own, unless that is the default beside a material."""
    id, rgba = int(model.geom_matid[geom]), model.geom_rgba[geom]
    is_default = bool((rgba == np.array([0.5, 0.5, 0.5, 1.0], rgba.dtype)).all())
    if id >= 0 and is_default:
        rgba = model.mat_rgba[id]
    textured = mujoco.mjtGeom(int(model.geom_type[geom])) in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_MESH)
    key = (id, tuple(rgba.tolist()), textured)
    if key not in known:
        color = (*linear(rgba[:3]).tolist(), float(rgba[3]))
        material = Material(_name(mujoco, model, "MATERIAL", id) if id >= 0 else "", color)
        if id >= 0:
            metallic, roughness = float(model.mat_metallic[id]), float(model.mat_roughness[id])
            # Negative: not given; then the highlight's sharpness says how rough it is.
            material.metallic = max(metallic, 0.0)
            material.roughness = roughness if roughness >= 0 else 1.0 - 0.7 * float(model.mat_shininess[id])
            material.emission = tuple((float(model.mat_emission[id]) * np.array(color[:3])).tolist())
            material.texture = _texture(mujoco, model, id) if textured else None
        known[key] = material
    return known[key]


def _texture(mujoco: Any, model: Any, material: int) -> Any:
    """The pixels of a material's flat texture, or None."""
    ids = np.atleast_1d(model.mat_texid[material])
    # Before roles there was one texture a material.
    roles = (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA) if len(ids) > 1 else (0,)
    id = max(int(ids[int(role)]) for role in roles)
    if id < 0 or model.tex_type[id] != mujoco.mjtTexture.mjTEXTURE_2D:
        return None
    shape = (model.tex_height[id], model.tex_width[id], model.tex_nchannel[id])
    begin = model.tex_adr[id]
    pixels = model.tex_data[begin : begin + int(np.prod(shape))].reshape(shape)
    return np.ascontiguousarray(np.repeat(pixels, 3, axis=2) if shape[2] == 1 else pixels)


def _light(mujoco: Any, model: Any, data: Any, id: int) -> Node:
    """A light at its pose in the world."""
    back = -data.light_xdir[id] / np.linalg.norm(data.light_xdir[id])
    side = np.cross(back, np.eye(3)[np.abs(back).argmin()])
    side /= np.linalg.norm(side)
    pose = _pose(data.light_xpos[id], np.stack([side, np.cross(back, side), back], axis=1))
    strength = float(model.light_diffuse[id].max())
    color = tuple((model.light_diffuse[id] / max(strength, 1e-9)).tolist())
    kinds, kind = mujoco.mjtLightType, model.light_type[id]
    if kind == kinds.mjLIGHT_DIRECTIONAL:
        light = Light("directional", color, LUX * strength)
    else:
        # MuJoCo's lights do not fade by themselves: as bright as they are at the middle of the model.
        distance = float(np.linalg.norm(data.light_xpos[id] - model.stat.center))
        cone = np.radians(min(float(model.light_cutoff[id]), 90.0)) if kind == kinds.mjLIGHT_SPOT else None
        light = Light("point" if cone is None else "spot", color, LUX * strength * distance**2, cone)
    return Node(_name(mujoco, model, "LIGHT", id), pose, light=light)


def _pose(position: Floats, rotation: Floats) -> Floats:
    matrix = np.eye(4)
    matrix[:3, 3], matrix[:3, :3] = position, np.reshape(rotation, (3, 3))
    return matrix


def _name(mujoco: Any, model: Any, kind: str, id: int) -> str:
    return mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), id) or f"{kind.lower()} {id}"
