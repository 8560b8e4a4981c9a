"""A USD stage from its own cameras: python usd_stage.py [STAGE.usd] [PICTURE.png]"""

import sys

import numpy as np
from PIL import Image
from pxr import Usd, UsdGeom

import argus_render

if len(sys.argv) > 1:
    stage = Usd.Stage.Open(sys.argv[1])
else:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.Cube.Define(stage, "/Cube").AddTranslateOp().Set((0, 1, 0))
    ground = UsdGeom.Cylinder.Define(stage, "/Ground")
    ground.CreateAxisAttr("Y"), ground.CreateRadiusAttr(5.0), ground.CreateHeightAttr(0.2)
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.AddTranslateOp().Set((0, 4, 10))
    camera.AddRotateXOp().Set(-15.0)

metres, up = UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage).lower()
cameras = [UsdGeom.Camera(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
# USD's matrices are of row vectors, and its cameras look along −z, as OpenGL's.
poses = np.array([np.array(camera.ComputeLocalToWorldTransform(0)).T for camera in cameras])
poses[:, :3, :3] /= np.linalg.norm(poses[:, :3, :3], axis=1, keepdims=True)
poses[:, :3, 3] *= metres
fov_deg = [camera.GetCamera(0).GetFieldOfView(camera.GetCamera(0).FOVVertical) for camera in cameras]
with argus_render.open(argus_render.from_usd(stage)) as renderer:
    frames = renderer.render(poses, fov_deg=fov_deg, convention="opengl", up=up)
Image.fromarray(frames.rgb[0]).save(sys.argv[2] if len(sys.argv) > 2 else "stage.png")
