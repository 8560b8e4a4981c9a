"""The images of a frame: names, types, and arrays for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from argus_render.errors import InvalidField

Array = NDArray[Any]


class Output(NamedTuple):
    """The pixels of an image."""

    #: Little-endian, as on the wire.
    dtype: str
    #: Numbers of a pixel.
    channels: int

    @property
    def pixel_bytes(self) -> int:
        """Bytes of a pixel."""
        return np.dtype(self.dtype).itemsize * self.channels


#: All outputs. Their meaning stands at the properties of Frames.
OUTPUTS: dict[str, Output] = {
    "rgb": Output("|u1", 3),
    "range": Output("<f4", 1),
    "mask": Output("|u1", 1),
    "source": Output("|u1", 1),
    "confidence": Output("|u1", 1),
    "radiance": Output("<f4", 3),
    "depth": Output("<f4", 1),
    "normal": Output("<f4", 3),
    "instance": Output("<i4", 1),
    "material": Output("<i4", 1),
    "flow": Output("<f4", 2),
}


def names(outputs: str | Sequence[str]) -> tuple[str, ...]:
    """The names of wanted outputs, checked."""
    wanted = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    if not wanted:
        raise InvalidField("outputs", "at least one output must be asked for")
    for name in wanted:
        if name not in OUTPUTS:
            raise InvalidField("outputs", f"{name!r} is none of {', '.join(OUTPUTS)}")
    if len(set(wanted)) < len(wanted):
        raise InvalidField("outputs", f"an output occurs twice in {wanted}")
    return wanted


def allocate(
    wanted: Sequence[str], count: int, size: tuple[int, int], out: Mapping[str, Array] | None = None
) -> dict[str, Array]:
    """Arrays [count, height, width, channels] for the outputs: those of the caller, or new ones."""
    given = dict(out or {})
    arrays: dict[str, Array] = {}
    for name in wanted:
        output = OUTPUTS[name]
        shape = (count, *size, output.channels)
        array = given.pop(name, None)
        if array is None:
            array = np.empty(shape, output.dtype)
        elif not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != output.dtype:
            found = f"{getattr(array, 'dtype', type(array))} {getattr(array, 'shape', '')}"
            raise InvalidField(f"out[{name!r}]", f"must be an array of {np.dtype(output.dtype)} {shape}, not {found}")
        elif not (array.flags.c_contiguous and array.flags.writeable):
            raise InvalidField(f"out[{name!r}]", "must be writeable and contiguous in C order")
        arrays[name] = array
    if given:
        raise InvalidField("out", f"{next(iter(given))!r} is not among the outputs {tuple(wanted)}")
    return arrays


def turn_normals(arrays: Mapping[str, Array], up: str) -> None:
    """Turns normals, which come in the service's world with +y up, into the caller's."""
    if up == "z" and "normal" in arrays:
        normals = arrays["normal"]
        normals[..., 1], normals[..., 2] = -normals[..., 2], normals[..., 1].copy()


def as_bytes(arrays: Mapping[str, Array]) -> list[tuple[str, NDArray[np.uint8]]]:
    """The same memory as rows of bytes, one a frame."""
    return [(name, array.reshape(len(array), -1).view(np.uint8)) for name, array in arrays.items()]
