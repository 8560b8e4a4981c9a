"""Lenses: a field of view, the matrix K of a pinhole with or without distortion, or all directions."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from argus_render.errors import InvalidField

LensName = Literal["opencv", "fisheye", "equirectangular"]

#: A lens as the native module takes it: its kind and numbers.
Lens = tuple[str, list[float]]

#: Vertical field of view without any other word, degrees.
DEFAULT_FOV_DEG = 45.0

#: Coefficients that each model may be given: OpenCV leaves out the last ones.
COEFFICIENTS = {"opencv": (4, 5, 8), "fisheye": (4,)}


def lens_rows(
    K: ArrayLike | None,
    fov_deg: ArrayLike | None,
    distortion: ArrayLike | None,
    lens: str,
    count: int,
    pixel_center: float,
) -> list[Lens]:
    """The lens of each of `count` cameras.

    K [3, 3] or [count, 3, 3] is in pixels; `pixel_center` says where it has the centre of the first pixel: 0.5 or 0.
    """
    if lens not in ("opencv", "fisheye", "equirectangular"):
        raise InvalidField("lens", f"{lens!r} is none of opencv, fisheye, equirectangular")
    if lens == "equirectangular":
        for field, value in (("K", K), ("fov_deg", fov_deg), ("distortion", distortion)):
            if value is not None:
                raise InvalidField(field, "an equirectangular image shows all directions: it has none")
        return [(lens, [])] * count
    if K is None:
        for field, is_given in (("distortion", distortion is not None), ("lens", lens != "opencv")):
            if is_given:
                raise InvalidField(field, "needs K")
        angles = _each("fov_deg", DEFAULT_FOV_DEG if fov_deg is None else fov_deg, count, ())
        return [("fov", [float(angle)]) for angle in angles]
    if fov_deg is not None:
        raise InvalidField("fov_deg", "K has the field of view: give one of the two")
    if pixel_center not in (0.0, 0.5):
        raise InvalidField("pixel_center", f"must be 0.5 or 0.0, not {pixel_center}")
    coefficients = _coefficients(distortion, lens)
    kind = lens if lens == "fisheye" or any(coefficients) else "pinhole"
    matrices = _each("K", K, count, (3, 3))
    numbers = [_intrinsics(matrix, pixel_center, i) for i, matrix in enumerate(matrices)]
    return [(kind, pinhole + (coefficients if kind != "pinhole" else [])) for pinhole in numbers]


def _coefficients(distortion: ArrayLike | None, lens: str) -> list[float]:
    """All coefficients of a model, in the order of OpenCV."""
    most = COEFFICIENTS[lens][-1]
    if distortion is None:
        return [0.0] * most
    given = _numbers("distortion", distortion)
    if given.ndim != 1 or len(given) not in COEFFICIENTS[lens]:
        lengths = " or ".join(map(str, COEFFICIENTS[lens]))
        raise InvalidField("distortion", f"the model {lens} has {lengths} coefficients, not {list(given.shape)}")
    if not np.isfinite(given).all():
        raise InvalidField("distortion", "must be finite")
    return [*map(float, given), *[0.0] * (most - len(given))]


def _intrinsics(K: NDArray[np.float64], pixel_center: float, index: int) -> list[float]:
    field = f"K[{index}]"
    if not np.isfinite(K).all():
        raise InvalidField(field, "must be finite")
    (fx, skew, cx), (zero, fy, cy), last = K
    if skew != 0.0 or zero != 0.0 or (last != [0.0, 0.0, 1.0]).any():
        raise InvalidField(field, "must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    if not (fx > 0.0 and fy > 0.0):
        raise InvalidField(field, f"fx and fy must be above 0, not {fx} and {fy}")
    shift = 0.5 - pixel_center
    return [float(fx), float(fy), float(cx + shift), float(cy + shift)]


def _each(field: str, values: ArrayLike, count: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Values of this shape, one a camera."""
    array = _numbers(field, values)
    if array.shape not in (shape, (count, *shape)):
        raise InvalidField(field, f"must be of shape {list(shape)} or {[count, *shape]}, not {list(array.shape)}")
    return np.broadcast_to(array, (count, *shape))


def _numbers(field: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidField(field, f"must be numbers: {error}") from None
