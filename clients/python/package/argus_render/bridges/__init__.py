"""Scenes of other tools, written as GLB files that `open` serves. Each bridge imports its package when it is called."""

from argus_render.bridges.from_mujoco import from_mujoco
from argus_render.bridges.from_trimesh import from_trimesh
from argus_render.bridges.from_usd import from_usd

__all__ = ["from_mujoco", "from_trimesh", "from_usd"]
