"""A mesh from all sides in one batch: python trimesh_turntable.py [PICTURE.png]"""

import sys

import numpy as np
import trimesh
from PIL import Image

import argus_render

VIEWS = 8

knot = trimesh.creation.torus(1.0, 0.3)
# OpenGL poses on a circle around the z axis, 4 m away and 2 m up.
poses = np.array(
    [
        trimesh.transformations.rotation_matrix(2 * np.pi * i / VIEWS, [0, 0, 1])
        @ trimesh.transformations.rotation_matrix(np.radians(65), [1, 0, 0])
        @ trimesh.transformations.translation_matrix([0, 0, 4])
        for i in range(VIEWS)
    ]
)
with argus_render.open(argus_render.from_trimesh(knot, up="z")) as renderer:
    frames = renderer.render(poses, size=(240, 320), convention="opengl", up="z", outputs=("rgb", "range"))
for i, distance in enumerate(frames.range):
    print(f"view {i}: nearest {distance.min():.2f} m, seen {np.isfinite(distance).mean():.0%}")
Image.fromarray(np.concatenate(list(frames.rgb), axis=1)).save(sys.argv[1] if len(sys.argv) > 1 else "turntable.png")
