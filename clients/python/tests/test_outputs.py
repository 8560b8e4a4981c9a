"""Names and arrays of images."""

import numpy as np
import pytest

from argus_render import InvalidField, _native
from argus_render.outputs import OUTPUTS, allocate, names, turn_normals


def test_the_table_is_that_of_the_native_module():
    assert {name: output.pixel_bytes for name, output in OUTPUTS.items()} == dict(_native.outputs())


def test_normals_turn_into_the_callers_world():
    normals = np.array([[1.0, 2.0, 3.0]], np.float32)
    turn_normals({"normal": normals}, "y")
    np.testing.assert_array_equal(normals, [[1.0, 2.0, 3.0]])
    # +y of the service is +z of a world with z up.
    turn_normals({"normal": normals}, "z")
    np.testing.assert_array_equal(normals, [[1.0, -3.0, 2.0]])


def test_outputs_are_known_and_occur_once():
    assert names("rgb") == ("rgb",)
    assert names(["range", "rgb"]) == ("range", "rgb")
    for wrong in [[], ["colour"], ["rgb", "rgb"], ""]:
        with pytest.raises(InvalidField) as caught:
            names(wrong)
        assert caught.value.field == "outputs", wrong


def test_arrays_of_the_caller_are_checked_by_name():
    size, shape = (3, 5), (2, 3, 5, 1)
    mine = np.zeros(shape, np.float32)
    arrays = allocate(("range", "rgb"), 2, size, {"range": mine})
    assert arrays["range"] is mine and arrays["rgb"].shape == (2, 3, 5, 3)
    frozen = np.zeros(shape, np.float32)
    frozen.flags.writeable = False
    for reason, wrong in {
        "type": np.zeros(shape),
        "byte order": np.zeros(shape, ">f4"),
        "shape": np.zeros((2, 3, 5), np.float32),
        "gaps": np.zeros((2, 3, 10, 1), np.float32)[:, :, ::2],
        "order": np.zeros(shape, np.float32, order="F"),
        "read-only": frozen,
        "list": mine.tolist(),
    }.items():
        with pytest.raises(InvalidField) as caught:
            allocate(("range",), 2, size, {"range": wrong})
        assert caught.value.field == "out['range']", reason
    with pytest.raises(InvalidField) as caught:
        allocate(("rgb",), 2, size, {"range": mine})
    assert caught.value.field == "out"
