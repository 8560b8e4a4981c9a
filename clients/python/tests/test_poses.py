"""Poses in the conventions of other tools."""

import numpy as np
import pytest

from argus_render import InvalidField
from argus_render.poses import CONVENTIONS, pose, pose_rows

#: A camera at (1, 2, 3) that looks along −z with +y up.
OPENGL = np.array([[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], float)
OPENCV = np.array([[1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]], float)
WORLD = np.array([[0, -1, 0, 1], [0, 0, 1, 2], [-1, 0, 0, 3], [0, 0, 0, 1]], float)


def field(poses, convention="opencv", up="y"):
    with pytest.raises(InvalidField) as caught:
        pose_rows(poses, convention, up)
    return caught.value.field


def test_one_camera_is_the_same_row_in_every_convention():
    expected = [[1, 2, 3, 0, 0, -1, 0, 1, 0]]
    for name, matrix in {"opengl": OPENGL, "opencv": OPENCV, "world": WORLD}.items():
        np.testing.assert_array_equal(pose_rows(matrix, name, "y"), expected, name)


def test_a_world_with_z_up_is_turned():
    # In a world with z up, (1, 2, 3) is 3 above the ground; looking along +y is looking along −z there.
    matrix = np.array([[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1]], float)
    np.testing.assert_allclose(pose_rows(matrix, "opengl", "z"), [[1, 3, -2, 0, 0, -1, 0, 1, 0]])


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("up", ["y", "z"])
def test_a_row_becomes_its_pose_again(convention, up):
    rotations = np.linalg.qr(np.random.default_rng(7).normal(size=(20, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    for i, rotation in enumerate(rotations):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, (i, -2.0, 1e6)
        [row] = pose_rows(matrix, convention, up)
        np.testing.assert_allclose(pose(row, convention, up), matrix, atol=1e-12)


def test_float32_and_lists_will_do():
    np.testing.assert_array_equal(pose_rows(OPENCV.astype(np.float32), "opencv", "y"), pose_rows(OPENCV.tolist(), "opencv", "y"))
    turned = OPENCV.astype(np.float32)
    turned[:3, :3] *= 1 + 2e-4
    assert len(pose_rows(turned, "opencv", "y")) == 1


def test_poses_that_are_none_are_refused_by_index():
    good = OPENCV
    for reason, change in {
        "mirrored": lambda m: m[:3, 0].__imul__(-1),
        "scaled": lambda m: m[:3, :3].__imul__(2),
        "skewed": lambda m: m[0].__setitem__(1, 0.5),
        "zero": lambda m: m[:3, :3].__imul__(0),
        "NaN": lambda m: m[0].__setitem__(3, np.nan),
        "infinite": lambda m: m[0].__setitem__(0, np.inf),
        "transposed": lambda m: m.__setitem__(slice(None), m.T.copy()),
    }.items():
        bad = good.copy()
        change(bad)
        assert field([good, good, bad]) == "poses[2]", reason
    for shape in [(3, 4), (4, 3), (2, 2, 4, 4), (0, 4, 4), (16,)]:
        assert field(np.zeros(shape)) == "poses", shape
    assert field([["a"] * 4] * 4) == "poses"
    assert field(good, convention="ros2") == "convention"
    assert field(good, up="x") == "up"
