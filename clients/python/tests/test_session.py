"""Sessions of a moving camera."""

import threading
import time

import numpy as np
import pytest
from conftest import WALLS, looking, wall_of

import argus_render

SIZE = (24, 32)


def above(wall):
    return "+y" if wall[1] != "y" else "+x"


def test_each_pose_gets_its_frame(renderer):
    with renderer.session(size=SIZE, outputs=("rgb", "range"), direct=True) as session:
        for number, wall in enumerate(WALLS, start=1):
            assert session.send(looking(wall, above(wall))) == number
            frame = session.frame()
            assert frame.camera == number and len(frame) == 1
            assert wall_of(frame.rgb[0, 12, 16]) == wall
            assert frame.range[0, 12, 16, 0] == pytest.approx(1.0, rel=0.01)
            assert frame.provenance[0] and frame.cost[0]


def test_the_newest_pose_wins(renderer):
    with renderer.session(size=(120, 160), direct=True, supersampling=4) as session:
        poses = [looking("+x", "+y", at=(0.001 * i, 0.0, 0.0)) for i in range(200)]
        begin = time.monotonic()
        for pose in poses:
            last = session.send(pose)
        assert time.monotonic() - begin < 1.0, "sending does not wait for frames"
        seen = [session.frame().camera]
        while seen[-1] < last:
            seen.append(session.frame().camera)
    assert last == len(poses) and seen == sorted(set(seen)) and len(seen) < len(poses)


def test_one_thread_sends_while_another_waits(renderer):
    with renderer.session(size=SIZE, direct=True) as session:
        frames = []
        waiting = threading.Thread(target=lambda: frames.append(session.frame()))
        waiting.start()
        time.sleep(0.2)
        session.send(looking("-z", "+y"))
        waiting.join(30.0)
    assert wall_of(frames[0].rgb[0, 12, 16]) == "-z"


def test_without_a_pose_no_frame_comes(renderer):
    with renderer.session(size=SIZE) as session:
        with pytest.raises(argus_render.TimedOut, match="within 200 ms"):
            session.frame(timeout=0.2)
        session.send(looking("+x", "+y"))
        assert session.frame().camera == 1


def test_arguments_that_cannot_be_used_are_named(renderer):
    with renderer.session(size=SIZE, fov_deg=200.0) as session:
        with pytest.raises(argus_render.InvalidField) as caught:
            session.send(looking("+x", "+y"))
        assert caught.value.field == "camera.fov_deg"
    with renderer.session(size=SIZE) as session:
        for field, wrong in {"poses[0]": np.zeros((4, 4)), "pose": [looking("+x", "+y")] * 2}.items():
            with pytest.raises(argus_render.InvalidField) as caught:
                session.send(wrong)
            assert caught.value.field == field
    with pytest.raises(argus_render.InvalidField) as caught:
        renderer.session(size=SIZE, outputs="colour")
    assert caught.value.field == "outputs"


def test_a_closed_session_says_so(renderer):
    session = renderer.session(size=SIZE, direct=True)
    session.close()
    session.close()
    with pytest.raises(argus_render.ArgusError, match="closed"):
        session.send(looking("+x", "+y"))
    with pytest.raises(argus_render.ArgusError, match="closed"):
        session.frame(timeout=5.0)
