"""Frames: the images of some views, with their cost and provenance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from argus_render.errors import ArgusError
from argus_render.outputs import Array


@dataclass(eq=False)
class Frames:
    """N frames. Arrays are [N, height, width, channels], row 0 at the top, also for N = 1."""

    #: The arrays, by output.
    arrays: dict[str, Array]
    #: The frames that did not come, and why. Their images are NaN, or 0 where there is no NaN.
    failed: dict[int, ArgusError]
    _reports: Sequence[str | None] = field(repr=False)

    def __len__(self) -> int:
        return len(self._reports)

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """sRGB colour, 3 channels."""
        return self._array("rgb")

    @property
    def range(self) -> NDArray[np.float32]:
        """Distance from the eye, metres, +inf where nothing is."""
        return self._array("range")

    @property
    def mask(self) -> NDArray[np.uint8]:
        """255 where no sample saw the pixel's surface and it is guessed, 128 where it was traced instead, else 0."""
        return self._array("mask")

    @property
    def source(self) -> NDArray[np.uint8]:
        """Number, from 1, of the plan's sample that served the pixel; 0 for none."""
        return self._array("source")

    @property
    def confidence(self) -> NDArray[np.uint8]:
        """0 where no sample saw the pixel; else 127 × (1 − residual), and 128 more where a second sample agrees."""
        return self._array("confidence")

    @property
    def radiance(self) -> NDArray[np.float32]:
        """Linear radiance, Rec. 709 primaries, without exposure, 3 channels. From samples it has 11 bits, as they have."""
        return self._array("radiance")

    @property
    def depth(self) -> NDArray[np.float32]:
        """Distance from the eye along the camera's axis, metres, +inf where nothing is."""
        return self._array("depth")

    @property
    def normal(self) -> NDArray[np.float32]:
        """Unit normal of the triangle in the world of the poses, on the eye's side, 3 channels; zero where nothing is."""
        return self._array("normal")

    @property
    def instance(self) -> NDArray[np.int32]:
        """Id of the instance at the pixel's centre, an index into `Renderer.names("instance")`; -1 where nothing is."""
        return self._array("instance")

    @property
    def material(self) -> NDArray[np.int32]:
        """Id of the material at the pixel's centre, an index into `Renderer.names("material")`; -1 where nothing is."""
        return self._array("material")

    @property
    def flow(self) -> NDArray[np.float32]:
        """From the pixel's centre to where the second camera shows the same point, pixels right and down, 2 channels; +inf
        where that is not in front of it.
        """
        return self._array("flow")

    @property
    def digest(self) -> list[str | None]:
        """BLAKE3 of each frame's images as they came from the service, hexadecimal: equal digests mean equal images."""
        return [report["digest"] if report else None for report in self.reports]

    @property
    def record(self) -> list[dict[str, Any] | None]:
        """What `Renderer.replay` makes each frame again from; as JSON in a file, what `argus replay` does."""
        return [report and report.get("record") for report in self.reports]

    @property
    def provenance(self) -> list[dict[str, Any] | None]:
        """All that each frame's bytes are a function of, beside its camera, size and outputs."""
        return [report and report["provenance"] for report in self.reports]

    @property
    def cost(self) -> list[dict[str, float]]:
        """Milliseconds of each frame, by stage. Frames of a batch that were rendered together share its cost evenly."""
        return [report["cost"] if report else {} for report in self.reports]

    @cached_property
    def reports(self) -> list[dict[str, Any] | None]:
        """What each frame says of itself: worker, age_ms, provenance, digest, record, cost, decision, predicted, served,
        unresolved_fraction; None if it failed.
        """
        return [None if report is None else json.loads(report) for report in self._reports]

    def _array(self, output: str) -> Array:
        if output not in self.arrays:
            raise AttributeError(f"{output!r} was not asked for: outputs={tuple(self.arrays)}")
        return self.arrays[output]


@dataclass(eq=False)
class SessionFrame(Frames):
    """The frame of one camera of a session; N = 1."""

    #: Number of the camera, from `Session.send`.
    camera: int = 0
