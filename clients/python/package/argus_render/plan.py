"""How a view is answered. Without any option the service chooses."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Literal, TypedDict


class Plan(TypedDict, total=False):
    """Options of a plan."""

    #: Render from triangles, never from samples.
    direct: bool
    #: How much of a direct view is rendered.
    detail: Literal["few-rays", "half", "half-few-rays", "quarter"]
    #: Reconstruct from samples by this search.
    search: Literal["splat", "linear", "seeded", "pyramid"]
    #: Steps of the linear and seeded searches, 1 to 4096.
    steps: int
    #: Sub-pixels on a side of each pixel, 1 to 8.
    supersampling: int
    #: Most samples of a view, 1 to 8.
    samples: int
    #: What becomes of pixels that no sample saw.
    holes: Literal["mark", "trace"]
    #: A goal that the other options override.
    preset: Literal["interactive", "balanced", "exact"]
    #: Largest accepted mean FLIP error, above 0 and up to 1.
    max_error: float
    #: Longest rendering time, milliseconds.
    deadline_ms: float


def as_json(plan: Mapping[str, object]) -> str:
    """The options that are set, as JSON."""
    unknown = plan.keys() - Plan.__annotations__.keys()
    if unknown:
        raise TypeError(f"unexpected keyword argument {sorted(unknown)[0]!r}")
    wanted = {name: value for name, value in plan.items() if value is not None}
    return json.dumps(wanted, default=lambda number: number.item())
