"""What a camera on a MuJoCo body sees at one moment: python mujoco_wrist.py [PICTURE.png]

The scene is written at the pose of the data, and does not move afterwards.
"""

import sys

import mujoco
import numpy as np
from PIL import Image

import argus_render

MODEL = """
<mujoco>
  <asset>
    <texture name="checker" type="2d" builtin="checker" width="128" height="128" rgb1=".2 .3 .4" rgb2=".8 .8 .8"/>
    <material name="floor" texture="checker" texrepeat="1 1" texuniform="true"/>
  </asset>
  <worldbody>
    <geom type="plane" size="5 5 1" material="floor"/>
    <body name="cube" pos="1 0 .2"><freejoint/><geom type="box" size=".2 .2 .2" rgba=".8 .2 .1 1"/></body>
    <body name="arm" pos="0 0 1">
      <joint name="shoulder" type="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .5 0 0" size=".06"/>
      <camera name="wrist" pos=".6 0 0" xyaxes="0 -1 0 0 0 1" fovy="70"/>
    </body>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
data.joint("shoulder").qpos[0] = 0.7
mujoco.mj_forward(model, data)
camera = data.camera("wrist")
pose = np.eye(4)
pose[:3, :3], pose[:3, 3] = camera.xmat.reshape(3, 3), camera.xpos
with argus_render.open(argus_render.from_mujoco(model, data)) as renderer:
    frames = renderer.render(
        pose, fov_deg=model.camera("wrist").fovy[0], convention="opengl", up="z", outputs=("rgb", "range")
    )
print(f"{frames.range[0, 240, 320, 0]:.3f} m ahead")
Image.fromarray(frames.rgb[0]).save(sys.argv[1] if len(sys.argv) > 1 else "wrist.png")
