"""Sessions: the newest frame of a moving camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from argus_render import _native
from argus_render.frames import SessionFrame
from argus_render.lenses import Lens
from argus_render.outputs import Array, allocate, as_bytes, turn_normals
from argus_render.poses import Up


class Session:
    """A moving camera. A newer pose replaces older ones that are not rendered yet, and a newer frame one that was not taken.

    Made by `Renderer.session`. One thread may send while another waits for frames.
    """

    def __init__(
        self,
        native: _native.Session,
        row: Callable[[ArrayLike], NDArray[np.float64]],
        lens: Lens,
        wanted: tuple[str, ...],
        size: tuple[int, int],
        up: Up,
        owner: object,
    ) -> None:
        """`row` checks a pose. `owner` is what must live as long as the session."""
        self._native, self._row, self._lens, self._wanted, self._size = native, row, lens, wanted, size
        self._up, self._owner = up, owner

    def send(self, pose: ArrayLike) -> int:
        """Sends a pose [4, 4] and returns the number of this camera, from 1. Does not wait."""
        return self._native.send(self._row(pose).tolist(), self._lens)

    def frame(self, timeout: float = 30.0, out: Mapping[str, Array] | None = None) -> SessionFrame:
        """Waits for the newest frame that was not taken yet, at most `timeout` seconds.

        Raises TimedOut, or why the newest camera has no frame; the session goes on.
        """
        arrays = allocate(self._wanted, 1, self._size, out)
        camera, report = self._native.frame(as_bytes(arrays), timeout)
        turn_normals(arrays, self._up)
        return SessionFrame(arrays, {}, [report], camera)

    def close(self) -> None:
        """Ends the session."""
        self._native.close()

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
