"""K, distortion and fields of view."""

import numpy as np
import pytest

from argus_render import InvalidField
from argus_render.lenses import lens_rows


def K(fx=500.0, fy=400.0, cx=320.0, cy=240.0):
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def field(K=None, fov_deg=None, distortion=None, lens="opencv", center=0.5):
    with pytest.raises(InvalidField) as caught:
        lens_rows(K, fov_deg, distortion, lens, 3, center)
    return caught.value.field


def test_the_centre_of_the_first_pixel_is_where_the_caller_has_it():
    expected = [("pinhole", [500.0, 400.0, 320.0, 240.0])]
    assert lens_rows(K(), None, None, "opencv", 1, 0.5) == expected
    assert lens_rows(K(cx=319.5, cy=239.5), None, None, "opencv", 2, 0.0) == expected * 2
    assert [numbers[0] for _, numbers in lens_rows([K(), K(fx=1.0)], None, None, "opencv", 2, 0.5)] == [500.0, 1.0]


def test_angles_are_for_all_or_for_each():
    assert lens_rows(None, None, None, "opencv", 2, 0.5) == [("fov", [45.0])] * 2
    assert lens_rows(None, 30, None, "opencv", 2, 0.5) == [("fov", [30.0])] * 2
    assert lens_rows(None, [30, 60], None, "opencv", 2, 0.5) == [("fov", [30.0]), ("fov", [60.0])]


def test_coefficients_are_those_of_opencv_in_its_order():
    pinhole = [500.0, 400.0, 320.0, 240.0]
    for given in ([1, 2, 3, 4], [1, 2, 3, 4, 5], [1, 2, 3, 4, 5, 6, 7, 8]):
        [(kind, numbers)] = lens_rows(K(), None, given, "opencv", 1, 0.5)
        assert (kind, numbers) == ("opencv", pinhole + given + [0.0] * (8 - len(given)))
    assert lens_rows(K(), None, [0.0] * 5, "opencv", 1, 0.5) == [("pinhole", pinhole)]
    assert lens_rows(K(), None, None, "fisheye", 1, 0.5) == [("fisheye", pinhole + [0.0] * 4)]
    assert lens_rows(None, None, None, "equirectangular", 2, 0.5) == [("equirectangular", [])] * 2


def test_lenses_that_cannot_be_are_refused_by_name():
    assert field(K(), 45.0) == "fov_deg"
    assert field(None, [45.0, 30.0]) == "fov_deg"
    assert field(None, "wide") == "fov_deg"
    assert field(K(), center=0.25) == "pixel_center"
    assert field(np.eye(4)) == "K"
    assert field([K(), K()]) == "K"
    assert field(lens="wide") == "lens"
    assert field(lens="fisheye") == "lens"
    assert field(distortion=[0.1] * 4) == "distortion"
    assert field(K(), lens="equirectangular") == "K"
    assert field(fov_deg=90.0, lens="equirectangular") == "fov_deg"
    for wrong in ([0.1] * 3, [0.1] * 6, [[0.1] * 4], "none", [np.nan] * 4):
        assert field(K(), distortion=wrong) == "distortion", wrong
    assert field(K(), distortion=[0.1] * 5, lens="fisheye") == "distortion"
    bad = {
        "NaN": K(fx=np.nan),
        "singular": K(fy=0.0),
        "mirrored": K(fx=-500.0, fy=-500.0),
        "skewed": K() + np.array([[0, 1, 0], [0, 0, 0], [0, 0, 0]]),
        "scaled": K() * 2,
    }
    for reason, matrix in bad.items():
        assert field([K(), matrix, K()]) == "K[1]", reason
