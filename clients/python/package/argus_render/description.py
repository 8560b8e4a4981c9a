"""What a service says of its scene."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from argus_render.poses import Convention, Up, pose


@dataclass(frozen=True)
class Viewpoint:
    """A viewpoint that the scene's author or the service recommends."""

    name: str
    #: Vertical field of view, degrees.
    fov_deg: float
    #: Eye, direction of view and direction up, in the service's world.
    row: tuple[float, ...]

    def pose(self, convention: Convention = "opencv", up: Up = "y") -> NDArray[np.float64]:
        """Its pose [4, 4], as `Renderer.render` takes it with the same convention and world."""
        return pose(self.row, convention, up)


@dataclass(frozen=True)
class Description:
    """The served scene. Lengths are in metres, +y is up."""

    scene: str
    #: BLAKE3 of the scene, hexadecimal.
    scene_hash: str
    #: Least and greatest corner of the box of what viewers look at, [2, 3].
    bounds: NDArray[np.float64]
    #: Triangles, instances counted.
    triangles: int
    #: Effects of light in the scene.
    effects: tuple[str, ...]
    #: At least one.
    viewpoints: tuple[Viewpoint, ...]
    #: Most pixels on a side of a view.
    max_side: int
    #: Most pixels of a view.
    max_pixels: int
    #: Seconds from one rendered moment of an animated scene to the next; 0 in a still scene.
    epoch_secs: float
    #: The light that the scene is shown in and why; empty if nothing was chosen.
    light: str
    #: Names of all scenes of the service, as `connect` takes them; it shows the first one if it gets none.
    scenes: tuple[str, ...]

    @classmethod
    def from_json(cls, text: str) -> Description:
        """The description that the native module gives."""
        fields: dict[str, Any] = json.loads(text)
        viewpoints = tuple(_viewpoint(**viewpoint) for viewpoint in fields.pop("viewpoints"))
        bounds, effects = np.array(fields.pop("bounds")), tuple(fields.pop("effects"))
        scenes = tuple(fields.pop("scenes"))
        return cls(bounds=bounds, effects=effects, viewpoints=viewpoints, scenes=scenes, **fields)


def _viewpoint(name: str, camera: dict[str, Any]) -> Viewpoint:
    eye = np.array(camera["eye"])
    row = (*eye, *(np.array(camera["target"]) - eye), *camera["up"])
    return Viewpoint(name, camera["fov_deg"], tuple(map(float, row)))
