"""Transforms of the scene's nodes."""

from __future__ import annotations

import json
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from argus_render.errors import InvalidField
from argus_render.poses import SERVICE_FROM_WORLD

Space = Literal["world", "parent"]


@dataclass(frozen=True)
class Moved:
    """The state of the nodes' transforms after a call."""

    #: Its number, which is in the provenance of frames that show it; 0: as in the file.
    revision: int
    #: Samples of the state before that workers hold. Views that need them wait for new ones, or are rendered from triangles.
    stale_samples: int
    #: Pages of light cells that workers hold, and of which they find out which ones the movers touch.
    pages_to_check: int
    #: Nodes whose transform is not that of the file.
    movers: int

    @classmethod
    def from_json(cls, text: str) -> Moved:
        return cls(**json.loads(text))


def transform_rows(
    transforms: Mapping[str | int, ArrayLike | None], space: str, up: str
) -> tuple[list[str | int], list[list[float] | None]]:
    """The nodes, and for each the numbers of its matrix row by row in the service's world, or None.

    Raises InvalidField for the first node or matrix that cannot be used, by its name.
    """
    if space not in ("world", "parent"):
        raise InvalidField("space", f"{space!r} is neither world nor parent")
    if up not in SERVICE_FROM_WORLD:
        raise InvalidField("up", f"{up!r} is none of {', '.join(SERVICE_FROM_WORLD)}")
    turn = SERVICE_FROM_WORLD[up] if space == "world" else np.eye(3)
    nodes: list[str | int] = []
    rows: list[list[float] | None] = []
    for node, matrix in transforms.items():
        field = f"transforms[{node!r}]"
        nodes.append(node if isinstance(node, str) else _index(field, node))
        if matrix is None:
            rows.append(None)
            continue
        try:
            numbers = np.asarray(matrix, np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidField(field, f"must be numbers: {error}") from None
        if numbers.shape not in ((4, 4), (3, 4)):
            raise InvalidField(field, f"must be of shape [4, 4] or [3, 4], not {list(numbers.shape)}")
        if numbers.shape == (4, 4) and (numbers[3] != [0.0, 0.0, 0.0, 1.0]).any():
            raise InvalidField(field, "its last row must be 0 0 0 1")
        if not np.isfinite(numbers).all():
            raise InvalidField(field, "must be finite")
        rows.append((turn @ numbers[:3]).ravel().tolist())
    return nodes, rows


def _index(field: str, node: object) -> int:
    try:
        index = operator.index(node)  # type: ignore[arg-type]
    except TypeError:
        raise InvalidField(field, "a node is a name or an index") from None
    if not 0 <= index < 2**32:
        raise InvalidField(field, f"there is no node {index}")
    return index
