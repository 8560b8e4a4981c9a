"""The native module, which is private to the package."""

from typing import final

import numpy as np
from numpy.typing import NDArray

from argus_render.errors import ArgusError

__all__ = ["Client", "Session", "outputs"]

def outputs() -> list[tuple[str, int]]:
    """The outputs of a frame, each with its bytes a pixel."""

@final
class Client:
    """A connection to a service. Threads may share it."""

    def __new__(
        cls,
        url: str,
        *,
        encoding: str,
        timeout: float,
        ca: bytes | None,
        token: str | None,
        identity: tuple[bytes, bytes] | None,
        scene: str | None,
    ) -> Client: ...
    def describe(self) -> str: ...
    def render(
        self,
        poses: NDArray[np.float64],
        lenses: list[tuple[str, list[float]]],
        flow_to: NDArray[np.float64] | None,
        rays: NDArray[np.float32] | None,
        size: tuple[int, int],
        arrays: list[tuple[str, NDArray[np.uint8]]],
        plan: str,
        timeout: float,
    ) -> list[str | ArgusError]: ...
    def replay(self, record: str, arrays: list[tuple[str, NDArray[np.uint8]]], timeout: float) -> str | ArgusError: ...
    def names(self, output: str) -> list[str]: ...
    def node_names(self) -> list[str]: ...
    def set_transforms(
        self,
        nodes: list[str | int],
        matrices: list[list[float] | None],
        world: bool,
        expected_revision: int | None,
    ) -> str: ...
    def node_setters(self) -> list[tuple[int, int, str]]: ...
    def session(self, size: tuple[int, int], outputs: list[str], plan: str, history: bool) -> Session: ...

@final
class Session:
    """A session of a moving camera. Threads may share it."""

    def send(self, pose: list[float], lens: tuple[str, list[float]]) -> int: ...
    def frame(self, arrays: list[tuple[str, NDArray[np.uint8]]], timeout: float) -> tuple[int, str]: ...
    def close(self) -> None: ...
