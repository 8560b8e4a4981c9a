"""Depth, lenses and flow against tools of another make: Embree by trimesh, and OpenCV.

Tests whose tool is not installed are skipped, and say so: the extra `judges` has them all.
"""

from pathlib import Path

import numpy as np
import pytest

import argus_render

SIZE = (96, 128)
K = np.array([[55.0, 0.0, 61.5], [0.0, 58.0, 50.25], [0.0, 0.0, 1.0]])
#: Coefficients k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV, and k1 to k4 of its fisheye.
DISTORTED = {
    "plumb bob": [-0.25, 0.08, 1e-3, -2e-3, -0.01],
    "rational": [0.3, 0.1, 3e-4, -2e-4, 0.01, 0.6, 0.2, 0.02],
}
FISHEYE = [0.02, -0.004, 0.001, -1e-4]


def turned(degrees: float, at: tuple[float, float, float]) -> np.ndarray:
    """An OpenCV pose: turned about the axis that is up in the image, and a little about the one to the right."""
    a, b = np.radians(degrees), np.radians(0.3 * degrees)
    around = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    nod = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    pose = np.eye(4)
    # OpenCV's y is down, and +y of the room is up.
    pose[:3, :3], pose[:3, 3] = np.diag([1.0, -1.0, -1.0]) @ around @ nod, at
    return pose


def pixels() -> np.ndarray:
    """The centres of the pixels, row by row [N, 2]."""
    height, width = SIZE
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2) + 0.5


def directions() -> np.ndarray:
    """Rays of K's pinhole at depth 1, in the camera's axes [N, 3]."""
    at = pixels()
    return np.stack([(at[:, 0] - K[0, 2]) / K[0, 0], (at[:, 1] - K[1, 2]) / K[1, 1], np.ones(len(at))], axis=1)


def test_depth_from_triangles_is_embrees(tmp_path: Path):
    trimesh = pytest.importorskip("trimesh", reason="SKIPPED, LOUDLY: trimesh is not installed")
    pytest.importorskip("embreex", reason="SKIPPED, LOUDLY: embreex is not installed")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.7)
    slab = trimesh.creation.box(extents=(3.0, 0.2, 3.0))
    slab.apply_translation([0.1, -0.9, 0.2])
    mesh = trimesh.util.concatenate([ball, slab])
    file = tmp_path / "scene.glb"
    trimesh.Scene(mesh).export(file)
    # What the file holds are floats of 32 bits.
    mesh.vertices = mesh.vertices.astype(np.float32)
    rays = RayMeshIntersector(mesh)
    poses = [turned(12.0, (0.3, 0.4, 3.0)), turned(-20.0, (-0.8, 0.2, 2.6)), turned(3.0, (0.2, 0.9, 2.0))]
    with argus_render.open(file, workers=1) as renderer:
        frames = renderer.render(poses, K, size=SIZE, outputs=("depth",), direct=True)
    for pose, depth in zip(poses, frames.depth, strict=True):
        toward = directions() @ pose[:3, :3].T
        origins = np.broadcast_to(pose[:3, 3], toward.shape)
        points, ray, _ = rays.intersects_location(origins, toward, multiple_hits=False)
        expected = np.full(len(toward), np.inf)
        expected[ray] = (points - pose[:3, 3]) @ pose[:3, 2]
        found = depth.reshape(-1).astype(np.float64)
        hit = np.isfinite(expected) & np.isfinite(found)
        # Along outlines the two may hit or miss.
        assert np.mean(np.isfinite(expected) != np.isfinite(found)) < 0.002
        assert np.mean(hit) > 0.1
        off = np.abs(found[hit] / expected[hit] - 1.0)
        assert np.quantile(off, 0.995) < 1e-5, np.quantile(off, [0.5, 0.99, 0.995, 1.0])
        assert np.median(off) < 1e-6


@pytest.mark.parametrize("name", [*DISTORTED, "fisheye"])
def test_opencv_projects_what_a_pixel_shows_onto_that_pixel(renderer: argus_render.Renderer, name: str):
    cv2 = pytest.importorskip("cv2", reason="SKIPPED, LOUDLY: opencv-python-headless is not installed")
    fisheye = name == "fisheye"
    k = np.array(FISHEYE if fisheye else DISTORTED[name])
    at = np.array([0.1, -0.15, 0.2])
    # It looks along the room's −z with +y up: the room's walls are planes of its axes.
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.diag([1.0, -1.0, -1.0]), at
    lens = {"distortion": k, "lens": "fisheye" if fisheye else "opencv"}
    frame = renderer.render(pose, K, size=SIZE, outputs=("depth", "range", "normal"), direct=True, **lens)
    there = np.isfinite(frame.depth.reshape(-1))
    depth, reach = (np.where(there, i.reshape(-1), 0.0).astype(np.float64) for i in (frame.depth, frame.range))
    normal = frame.normal.reshape(-1, 3)
    centres = pixels()
    judged = 0
    # On a wall beside the camera one coordinate is known, depth is another, and range tells the size of the third: the point
    # that a pixel shows follows without its ray.
    for axis, other in ((0, 1), (1, 0)):
        for side in (-1.0, 1.0):
            wall = there & (normal[:, axis] * side < -0.999)
            known = (side - at[axis]) * (1.0 if axis == 0 else -1.0)
            rest = np.where(wall, reach**2 - depth**2 - known**2, 0.0)
            third = np.sqrt(np.maximum(rest, 0.0))
            wall &= third > 0.2
            third *= np.sign(centres[:, other] - K[other, 2])
            points = np.zeros((int(wall.sum()), 3))
            points[:, axis], points[:, other], points[:, 2] = known, third[wall], depth[wall]
            if len(points) == 0:
                continue
            zero = np.zeros(3)
            project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
            seen, _ = project(points[:, None] if not fisheye else points[None], zero, zero, K, k)
            off = np.linalg.norm(seen.reshape(-1, 2) - centres[wall], axis=1)
            assert off.max() < 0.01, (axis, side, off.max())
            judged += len(points)
    assert judged > 1000, judged


def test_flow_of_a_still_scene_follows_from_depth_and_poses(renderer: argus_render.Renderer):
    cv2 = pytest.importorskip("cv2", reason="SKIPPED, LOUDLY: opencv-python-headless is not installed")
    first, second = turned(10.0, (0.1, -0.1, 0.2)), turned(16.0, (0.15, -0.05, 0.1))
    frame = renderer.render(first, K, size=SIZE, outputs=("depth", "flow"), flow_to=second, direct=True)
    depth, flow = frame.depth.reshape(-1).astype(np.float64), frame.flow.reshape(-1, 2)
    assert np.isfinite(depth).all()
    points = (directions() * depth[:, None]) @ first[:3, :3].T + first[:3, 3]
    second_from_world = np.linalg.inv(second)
    turn, _ = cv2.Rodrigues(second_from_world[:3, :3])
    ahead = (points @ second_from_world[:3, :3].T + second_from_world[:3, 3])[:, 2] > 0.05
    seen, _ = cv2.projectPoints(points[ahead][:, None], turn, second_from_world[:3, 3], K, None)
    off = np.linalg.norm(seen.reshape(-1, 2) - pixels()[ahead] - flow[ahead], axis=1)
    assert ahead.mean() > 0.9 and off.max() < 0.01, (ahead.mean(), off.max())
