"""Renders many views of a scene into numpy arrays, by an Argus service.

>>> import argus_render
>>> r = argus_render.open("bunny.ply")  # starts a service on this machine, or connect(url)
>>> rgb = r.render().rgb  # [1, 480, 640, 3], uint8
"""

from argus_render.bridges import from_mujoco, from_trimesh, from_usd
from argus_render.description import Description, Viewpoint
from argus_render.errors import (
    ArgusError,
    Damaged,
    Incompatible,
    InvalidField,
    NotAllowed,
    Overloaded,
    ServerError,
    TimedOut,
    Unavailable,
)
from argus_render.frames import Frames
from argus_render.plan import Plan
from argus_render.renderer import Renderer, connect, open
from argus_render.session import Session
from argus_render.transforms import Moved

__all__ = [
    "ArgusError",
    "Damaged",
    "Description",
    "Frames",
    "Incompatible",
    "InvalidField",
    "Moved",
    "NotAllowed",
    "Overloaded",
    "Plan",
    "Renderer",
    "ServerError",
    "Session",
    "TimedOut",
    "Unavailable",
    "Viewpoint",
    "connect",
    "from_mujoco",
    "from_trimesh",
    "from_usd",
    "open",
]
