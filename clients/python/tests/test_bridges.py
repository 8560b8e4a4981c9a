"""Scenes of other tools, rendered by a real service."""

import numpy as np
import pytest
from conftest import axis, looking

import argus_render
from argus_render.bridges import shapes
from argus_render.bridges.glb import Material, Node, write_glb

Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def from_outside(wall, distance=4.0):
    """A pose that looks at the origin against an axis."""
    above = "+y" if wall[1] != "y" else "+x"
    return looking(("-" if wall[0] == "+" else "+") + wall[1], above, at=tuple(axis(wall) * distance))


def ranges(scene, poses, up="y"):
    """The range at the middle of a narrow view of each pose."""
    with argus_render.open(scene, workers=1) as renderer:
        frames = renderer.render(poses, fov_deg=1.0, size=(9, 9), up=up, outputs=("range", "rgb"), direct=True)
        return frames.range[:, 4, 4, 0]


@pytest.mark.parametrize(
    ("shape", "reach"),
    [
        (lambda m: shapes.box(np.array([0.5, 1.0, 1.5]), m), (0.5, 1.0, 1.5)),
        (lambda m: shapes.ellipsoid(np.array([0.5, 1.0, 1.5]), m), (0.5, 1.0, 1.5)),
        (lambda m: shapes.capsule(0.5, 1.0, m), (0.5, 0.5, 1.5)),
        (lambda m: shapes.cylinder(0.5, 1.0, m), (0.5, 0.5, 1.0)),
        (lambda m: shapes.frustum(1.0, 0.0, 1.0, m), (0.5, 0.5, 1.0)),
    ],
)
def test_shapes_reach_as_far_as_they_should(shape, reach, tmp_path):
    mesh = shape(Material())
    lengths = np.linalg.norm(mesh.normals, axis=1)
    np.testing.assert_allclose(lengths, 1.0)
    # Each triangle turns the way of its normals, or has no area.
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    turns = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", turns, mesh.normals[mesh.triangles].mean(axis=1)) > -1e-12).all()
    write_glb(tmp_path / "shape.glb", Node("shape", meshes=[mesh]))
    seen = ranges(tmp_path / "shape.glb", [from_outside(wall) for wall in ("+x", "-x", "+y", "-y", "+z")])
    np.testing.assert_allclose(seen, 4.0 - np.array([reach[0], reach[0], reach[1], reach[1], reach[2]]), rtol=5e-3)


def test_trimesh_scenes_keep_their_world(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box(extents=(1.0, 2.0, 3.0))
    np.testing.assert_allclose(
        ranges(argus_render.from_trimesh(box), [from_outside(wall) for wall in ("+x", "+y", "+z")]), [3.5, 3.0, 2.5], rtol=1e-5
    )
    scene = trimesh.Scene([box])
    file = argus_render.from_trimesh(scene, tmp_path / "box.glb", up="z")
    assert file == tmp_path / "box.glb"
    poses = [Z_UP_FROM_Y_UP @ from_outside(wall) for wall in ("+x", "+y", "+z")]
    # Up in the image is +z of this world; the box is 3 m high.
    np.testing.assert_allclose(ranges(file, poses, up="z"), [3.5, 2.5, 3.0], rtol=1e-5)
    for wrong in [trimesh.Scene(), trimesh.PointCloud([[0, 0, 0]]), "box.obj"]:
        with pytest.raises(argus_render.InvalidField) as caught:
            argus_render.from_trimesh(wrong)
        assert caught.value.field == "mesh"


MODEL = """
<mujoco>
  <asset>
    <texture name="checker" type="2d" builtin="checker" width="64" height="64" rgb1="1 0 0" rgb2="0 1 0"/>
    <material name="floor" texture="checker" texrepeat="1 1" texuniform="true"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 5" dir="0 0 -1" directional="true"/>
    <geom name="floor" type="plane" size="0 0 1" material="floor"/>
    <body name="arm" pos="0 0 2">
      <joint name="hinge" type="hinge" axis="0 1 0"/>
      <geom name="rod" type="box" pos="1 0 0" size="1 0.1 0.2" rgba="0 0 1 1"/>
      <geom name="collision" type="sphere" size="3" group="3"/>
    </body>
    <body name="part" pos="10 0 0"><geom name="mesh" type="mesh" mesh="wedge"/></body>
  </worldbody>
</mujoco>
"""


def test_mujoco_models_are_written_at_their_pose():
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    down = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 6], [0, 0, 0, 1]])
    from_above = [down.copy() for _ in range(3)]
    for pose, xy in zip(from_above, [(-1.0, 0.0), (1.0, 0.0), (10.2, 0.3)], strict=True):
        pose[:2, 3] = xy
    # The arm is horizontal at first: its upper face is 0.2 above the hinge's height of 2. The wedge has x + y + z = 1.
    np.testing.assert_allclose(ranges(argus_render.from_mujoco(model), from_above, up="z"), [6.0, 3.8, 5.5], rtol=1e-3)
    # A quarter turn points it down.
    data.qpos[0] = np.pi / 2
    mujoco.mj_forward(model, data)
    file = argus_render.from_mujoco(model, data)
    np.testing.assert_allclose(ranges(file, from_above, up="z"), [6.0, 6.0, 5.5], rtol=1e-3)
    names = file.read_bytes()
    for name in ("arm", "rod", "floor", "part", "mesh"):
        assert f'"name": "{name}"'.encode() in names
    assert b"collision" not in names and b"image/png" in names and b"KHR_lights_punctual" in names
    with pytest.raises(argus_render.InvalidField) as caught:
        argus_render.from_mujoco(mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>"))
    assert caught.value.field == "model"


STAGE = """#usda 1.0
(
    upAxis = "Z"
    metersPerUnit = 0.01
)
def Xform "World" {
    double3 xformOp:translate = (0, 0, 100)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "Quad" {
        point3f[] points = [(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        color3f[] primvars:displayColor = [(0.5, 0, 0)]
    }
    def Cylinder "Pole" {
        double radius = 10
        double height = 60
        uniform token axis = "X"
        double3 xformOp:translate = (0, 300, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Sphere "Hidden" {
        double radius = 90
        token visibility = "invisible"
    }
    def Sphere "Proxy" {
        double radius = 90
        uniform token purpose = "proxy"
    }
}
def SphereLight "Lamp" {
    double3 xformOp:translate = (0, 0, 900)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def test_usd_stages_are_in_metres_with_their_own_up(tmp_path):
    usd = pytest.importorskip("pxr.Usd")
    (tmp_path / "stage.usda").write_text(STAGE)
    down = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 5], [0, 0, 0, 1]])
    poses = [down.copy() for _ in range(3)]
    poses[1][:2, 3], poses[2][:2, 3] = (0.25, 3.0), (0.35, 3.0)
    seen = ranges(argus_render.from_usd(tmp_path / "stage.usda"), poses, up="z")
    # The quad is 1 m high; the pole's top 1.1 m, up to 0.3 m from its middle along x.
    np.testing.assert_allclose(seen, [4.0, 3.9, np.inf], rtol=5e-3)
    file = argus_render.from_usd(usd.Stage.Open(str(tmp_path / "stage.usda")), tmp_path / "stage.glb")
    assert b"/World/Quad" in file.read_bytes() and b"Hidden" not in file.read_bytes()
    for wrong, field in [(tmp_path / "none.usda", "stage"), (usd.Stage.CreateInMemory(), "stage")]:
        with pytest.raises(argus_render.InvalidField) as caught:
            argus_render.from_usd(wrong)
        assert caught.value.field == field
    broken = STAGE.replace("[0, 1, 2, 3]", "[0, 1, 2, 9]")
    (tmp_path / "broken.usda").write_text(broken)
    with pytest.raises(argus_render.InvalidField, match="do not fit its points") as caught:
        argus_render.from_usd(tmp_path / "broken.usda")
    assert caught.value.field == "/World/Quad"
