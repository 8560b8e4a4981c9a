"""Nodes that a client moves, by a real service."""

import numpy as np
import pytest
from conftest import looking

import argus_render
from argus_render import ArgusError, InvalidField
from argus_render.transforms import transform_rows


def along(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


@pytest.fixture
def alone(room):
    """A service of its own: its nodes move."""
    with argus_render.open(room, workers=1) as renderer:
        yield renderer


def middle(renderer) -> float:
    frames = renderer.render(looking("+x", "+y"), fov_deg=40.0, size=(15, 15), outputs="range")
    return float(frames.range[0, 7, 7, 0])


def test_a_moved_wall_is_farther_away_and_comes_back(alone):
    assert middle(alone) == pytest.approx(1.0, rel=1e-3)
    assert set(alone.names("node")) >= {"room", "+x", "-x"}
    moved = alone.set_transforms({"+x": along(2.0)})
    assert moved.revision > 0 and moved.movers == 1
    assert middle(alone) == pytest.approx(3.0, rel=1e-3)
    # x of a world with z up is x of the service's.
    alone.set_transforms({alone.names("node").index("+x"): along(1.0)[:3]}, up="z")
    assert middle(alone) == pytest.approx(2.0, rel=1e-3)
    again = alone.set_transforms({"+x": None})
    assert again.movers == 0
    assert middle(alone) == pytest.approx(1.0, rel=1e-3)
    ((revision, client),) = alone.node_setters().values()
    assert (revision, client) == (again.revision, "127.0.0.1")
    with pytest.raises(ArgusError, match="another client was first"):
        alone.set_transforms({"+x": along(1.0)}, expected_revision=moved.revision)


@pytest.mark.parametrize(
    ("transforms", "field"),
    [
        ({"no such node": np.eye(4)}, "nodes.name"),
        ({4000: np.eye(4)}, "nodes.index"),
        ({"+x": np.diag([1.0, 0.0, 1.0, 1.0])}, "nodes.matrix"),
        ({"+x": np.eye(3)}, "transforms['+x']"),
        ({"+x": np.full((4, 4), np.nan)}, "transforms['+x']"),
        ({"+x": along(np.nan)}, "transforms['+x']"),
        ({1.5: np.eye(4)}, "transforms[1.5]"),
        ({-1: np.eye(4)}, "transforms[-1]"),
    ],
)
def test_what_cannot_be_used_is_named(renderer, transforms, field):
    with pytest.raises(InvalidField) as raised:
        renderer.set_transforms(transforms)
    assert raised.value.field == field


def test_rows_are_in_the_world_of_the_service():
    nodes, rows = transform_rows({"a": along(1.0, 2.0, 3.0), 7: None}, "world", "z")
    assert nodes == ["a", 7] and rows[1] is None
    assert np.reshape(rows[0], (3, 4))[:, 3].tolist() == [1.0, 3.0, -2.0]
    _, [row] = transform_rows({"a": along(1.0, 2.0, 3.0)}, "parent", "z")
    assert np.reshape(row, (3, 4))[:, 3].tolist() == [1.0, 2.0, 3.0]
    for space, up in [("node", "y"), ("world", "x")]:
        with pytest.raises(InvalidField):
            transform_rows({}, space, up)
