"""Batches of views, by a real service."""

import json
import os
import signal
import socket
import subprocess
import threading
import time

import numpy as np
import pytest
from conftest import WALLS, axis, looking, wall_of

import argus_render
from argus_render import InvalidField
from argus_render.poses import CONVENTIONS, pose, pose_rows
from argus_render.service import find_program

SIZE = (24, 32)
#: Each wall from the middle, with another one up in the image.
VIEWS = [(forward, above) for forward in WALLS for above in WALLS if forward[1] != above[1]]


def test_hello_world(renderer):
    frames = renderer.render()
    assert frames.rgb.shape == (1, 480, 640, 3) and frames.rgb.dtype == np.uint8
    assert frames.rgb.max() > 0


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("up", ["y", "z"])
def test_every_convention_sees_the_walls_that_it_names(renderer, convention, up):
    # The service's rows of each view, as poses of this convention in this world.
    rows = pose_rows([looking(*view) for view in VIEWS], "opencv", "y")
    poses = [pose(row, convention, up) for row in rows]
    frames = renderer.render(poses, fov_deg=120.0, size=(40, 40), convention=convention, up=up, direct=True)
    for (forward, above), rgb in zip(VIEWS, frames.rgb, strict=True):
        assert wall_of(rgb[20, 20]) == forward
        assert wall_of(rgb[0, 20]) == above


def test_range_is_the_distance_along_each_ray(renderer):
    height, width, f = 25, 31, 20.0
    K = [[f, 0, width / 2], [0, f, height / 2], [0, 0, 1]]
    frames = renderer.render(
        looking("+x", "+y"), K, size=(height, width), outputs=("range", "rgb"), direct=True
    )
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    expected = np.sqrt(x**2 + y**2 + f**2) / f
    assert frames.range.shape == (1, height, width, 1) and frames.range.dtype == np.float32
    np.testing.assert_allclose(frames.range[0, :, :, 0], expected, rtol=1e-5)


def test_depth_is_along_the_axis_and_principal_points_may_be_anywhere(renderer):
    height, width = 20, 30
    K = [[25.0, 0, 4.0], [0, 20.0, 17.5]] + [[0, 0, 1]]
    view = {"size": (height, width), "outputs": ("range", "depth"), "direct": True, "pixel_center": 0.0}
    frames = renderer.render(looking("+z", "+y"), K, **view)
    x, y = (np.arange(width) - 4.0) / 25.0, (np.arange(height) - 17.5) / 20.0
    expected = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    # Where the rays meet the wall ahead.
    ahead = (np.abs(x[None, :]) < 0.99) & (np.abs(y[:, None]) < 0.99)
    np.testing.assert_allclose(frames.depth[0, :, :, 0][ahead], 1.0, rtol=1e-5)
    np.testing.assert_allclose(frames.range[0, :, :, 0][ahead], expected[ahead], rtol=1e-5)


def test_distorted_images_show_what_opencv_projects_there(renderer):
    size, f = (64, 64), 40.0
    K, k = [[f, 0, 32.0], [0, f, 32.0], [0, 0, 1]], [-0.2, 0.05, 0.001, -0.002, 0.0]
    frames = renderer.render(looking("+x", "+y"), K, distortion=k, size=size, outputs="range", direct=True)
    # OpenCV's model, forwards: a ray of a place on the wall, and the pixel that shows it.
    a, b = np.meshgrid(np.linspace(-0.5, 0.5, 9), np.linspace(-0.5, 0.5, 9))
    r2 = a**2 + b**2
    radial = 1 + k[0] * r2 + k[1] * r2**2
    u = a * radial + 2 * k[2] * a * b + k[3] * (r2 + 2 * a**2)
    v = b * radial + k[2] * (r2 + 2 * b**2) + 2 * k[3] * a * b
    column, row = (f * u + 32.0).astype(int), (f * v + 32.0).astype(int)
    # The range changes by less than 0.03 within a pixel there.
    np.testing.assert_allclose(frames.range[0, row, column, 0], np.sqrt(1 + r2), atol=0.03)
    plain = renderer.render(looking("+x", "+y"), K, size=size, outputs="range", direct=True)
    assert np.abs(plain.range - frames.range).max() > 0.05


def test_lenses_that_see_all_around(renderer):
    rgb = renderer.render(looking("+x", "+y"), lens="equirectangular", size=(64, 128), direct=True).rgb[0]
    middle = {"+x": (32, 64), "+z": (32, 96), "-z": (32, 32), "-x": (32, 0), "+y": (2, 64), "-y": (61, 64)}
    assert {wall: wall_of(rgb[pixel]) for wall, pixel in middle.items()} == {wall: wall for wall in middle}
    # An equidistant fisheye whose image ends 100° from the axis.
    K = [[32 / np.radians(100), 0, 32], [0, 32 / np.radians(100), 32], [0, 0, 1]]
    rgb = renderer.render(looking("+x", "+y"), K, lens="fisheye", size=(64, 64), direct=True).rgb[0]
    assert [wall_of(rgb[p]) for p in [(32, 32), (32, 62), (32, 1), (1, 32), (62, 32)]] == ["+x", "+z", "-z", "+y", "-y"]


def test_a_scan_follows_its_rays(renderer):
    # In the axes of "world": x forward, y left, z up. The last one is none.
    rays = np.array([[1, 0, 0], [0, 3, 0], [-1e30, 0, 0], [0, -1, 0], [0, 0, 1e-30], [0, 0, -1], [1, 1, 0], [0, 0, 0]], float)
    ahead, left, up = axis("+z"), axis("+x"), axis("+y")
    pose = np.eye(4)
    pose[:3, :3] = np.stack([ahead, left, up], axis=1)
    outputs = ("range", "instance", "rgb")
    scan = renderer.scan(rays, [pose, pose], convention="world", outputs=outputs)
    assert scan.range.shape == (2, 1, 8, 1)
    instances = renderer.names("instance")
    for i in range(2):
        np.testing.assert_allclose(scan.range[i, 0, :, 0], [1, 1, 1, 1, 1, 1, np.sqrt(2), np.inf], rtol=1e-5)
        seen = [instances[k] for k in scan.instance[i, 0, :6, 0]]
        assert seen == ["+z", "+x", "-z", "-x", "+y", "-y"]
    assert [wall_of(pixel) for pixel in scan.rgb[0, 0, :6]] == seen
    rows = renderer.scan(rays.reshape(2, 4, 3), pose, convention="world")
    np.testing.assert_array_equal(rows.range.reshape(-1), scan.range[0].reshape(-1))
    for wrong in (np.zeros((4, 2)), np.full((1, 3), np.nan), np.zeros((65537, 3))):
        with pytest.raises(InvalidField) as caught:
            renderer.scan(wrong, pose)
        assert caught.value.field == "rays"


def test_geometry_names_what_is_there(renderer):
    poses = [looking(*view) for view in VIEWS]
    outputs = ("normal", "instance", "material", "radiance")
    frames = renderer.render(poses, size=SIZE, outputs=outputs, direct=True)
    instances, materials = renderer.names("instance"), renderer.names("material")
    for i, (forward, _) in enumerate(VIEWS):
        np.testing.assert_allclose(frames.normal[i, 12, 16], -axis(forward), atol=1e-6)
        assert instances[frames.instance[i, 12, 16, 0]] == forward
        assert materials[frames.material[i, 12, 16, 0]] == forward
        assert frames.radiance[i, 12, 16] == pytest.approx(WALLS[forward], rel=0.01)
    # The same wall in a world with z up.
    [row] = pose_rows(looking("+y", "+x"), "opencv", "y")
    turned = renderer.render(pose(row, "opencv", "z"), size=SIZE, outputs="normal", up="z", direct=True)
    np.testing.assert_allclose(turned.normal[0, 12, 16], [0.0, 0.0, -1.0], atol=1e-6)
    with pytest.raises(InvalidField) as caught:
        renderer.names("depth")
    assert caught.value.field


def test_flow_leads_to_where_a_second_camera_shows_the_same_point(renderer):
    # 0.1 m to the right: all of a wall 1 m ahead moves f · 0.1 pixels to the left.
    first, second = looking("+x", "+y"), looking("+x", "+y", at=(0.0, 0.0, 0.1))
    K = [[40.0, 0, 16.0], [0, 40.0, 12.0], [0, 0, 1]]
    frames = renderer.render([first] * 3, K, flow_to=[second, first, second], size=SIZE, outputs=("flow", "rgb"), direct=True)
    np.testing.assert_allclose(frames.flow[0], np.broadcast_to([-4.0, 0.0], (*SIZE, 2)), atol=0.01)
    np.testing.assert_allclose(frames.flow[1], 0.0, atol=0.01)
    for arguments, field in [({"outputs": "flow"}, "flow_to"), ({"flow_to": [first] * 2, "outputs": "flow"}, "flow_to")]:
        with pytest.raises(InvalidField) as caught:
            renderer.render(first, K, size=SIZE, direct=True, **arguments)
        assert caught.value.field == field


def test_a_frame_is_made_again_from_its_record(renderer, tmp_path):
    poses = [looking(*view, at=(0.01 * i, 0.02 * i, 0.0)) for i, view in enumerate(VIEWS[:3])]
    frames = renderer.render(poses, size=SIZE, outputs=("rgb", "range"), supersampling=2)
    assert len(set(frames.digest)) == 3
    for i, record in enumerate(frames.record):
        again = renderer.replay(json.loads(json.dumps(record)))
        assert again.digest[0] == record["digest"] == frames.digest[i]
        np.testing.assert_array_equal(again.rgb[0], frames.rgb[i])
        np.testing.assert_array_equal(again.range[0], frames.range[i])
    # The command makes it again, too.
    (tmp_path / "frame.json").write_text(json.dumps(frames.record[1]))
    command = [find_program(), "replay", "frame.json", "--out", "again", "--server", renderer.url]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "equal" in done.stdout, done.stdout + done.stderr
    for wrong in [{}, {**frames.record[0], "provenance": 7}, {**frames.record[0], "outputs": ["colour"]}]:
        with pytest.raises(InvalidField):
            renderer.replay(wrong)


def test_a_batch_equals_its_views_alone(renderer):
    poses = [looking(*view, at=(0.01 * i, 0.02 * i, -0.013 * i)) for i, view in enumerate(VIEWS)]
    outputs = ("range", "rgb", "confidence")
    batch = renderer.render(poses, size=SIZE, outputs=outputs, direct=True)
    assert len(batch) == len(VIEWS) and len({image.tobytes() for image in batch.range}) == len(VIEWS)
    for i, one in enumerate(poses):
        alone = renderer.render(one, size=SIZE, outputs=outputs, direct=True)
        for output in outputs:
            np.testing.assert_array_equal(alone.arrays[output][0], batch.arrays[output][i])


def test_more_cameras_than_a_request_holds(renderer):
    poses = np.stack([looking("+x", "+y"), looking("-z", "+y")])[np.arange(2050) % 2]
    frames = renderer.render(poses, size=(2, 2), direct=True)
    assert [wall_of(rgb[1, 1]) for rgb in frames.rgb[[0, 1, 2047, 2048, 2049]]] == ["+x", "-z", "-z", "+x", "-z"]


def test_frames_say_how_they_were_made(renderer):
    frames = renderer.render([looking("+x", "+y")] * 2, size=SIZE, direct=True, supersampling=2)
    for provenance, cost, report in zip(frames.provenance, frames.cost, frames.reports, strict=True):
        assert provenance["plan"]["Direct"]["samples_per_pixel"] == 4
        assert cost and all(ms >= 0.0 for ms in cost.values())
        assert report["worker"] and report["age_ms"] > 0.0
    with pytest.raises(AttributeError, match="'range' was not asked for"):
        frames.range


def test_images_are_written_into_arrays_of_the_caller(renderer):
    mine = np.full((1, *SIZE, 3), 77, np.uint8)
    frames = renderer.render(looking("+y", "+x"), size=SIZE, out={"rgb": mine}, direct=True)
    assert frames.rgb is mine and wall_of(mine[0, 12, 16]) == "+y"


def test_a_wrong_camera_fails_alone(renderer):
    poses, fov = [looking("+x", "+y")] * 3, [45.0, 200.0, 45.0]
    with pytest.raises(InvalidField) as caught:
        renderer.render(poses, fov_deg=fov, size=SIZE, direct=True)
    assert caught.value.field == "camera.fov_deg" and caught.value.index == 1
    frames = renderer.render(poses, fov_deg=fov, size=SIZE, outputs=("rgb", "range"), direct=True, partial=True)
    assert list(frames.failed) == [1] and frames.failed[1].field == "camera.fov_deg"
    assert np.isnan(frames.range[1]).all() and not frames.rgb[1].any()
    assert wall_of(frames.rgb[2, 12, 16]) == "+x"
    assert frames.provenance[1] is None and frames.cost[1] == {}


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"size": (0, 10)}, "size"),
        ({"size": (10.5, 10)}, "size"),
        ({"size": 10}, "size"),
        ({"size": (1 << 40, 10)}, "size"),
        ({"size": (10, 1 << 20)}, "width"),
        ({"outputs": "depths"}, "outputs"),
        ({"steps": 0, "search": "linear"}, "plan.steps"),
        ({"steps": "many"}, "plan.steps"),
        ({"search": "guess"}, "plan.search"),
        ({"detail": "half"}, "plan.detail"),
        ({"max_error": float("nan")}, "plan"),
        ({"fov_deg": float("nan")}, "camera.fov_deg"),
        ({"timeout": -1.0}, "timeout"),
        ({"timeout": float("nan")}, "timeout"),
        ({"convention": "left"}, "convention"),
    ],
)
def test_arguments_that_cannot_be_used_are_named(renderer, arguments, field):
    with pytest.raises(InvalidField) as caught:
        renderer.render(looking("+x", "+y"), **{"size": SIZE, **arguments})
    assert caught.value.field == field
    assert isinstance(caught.value, ValueError) and caught.value.reason


def test_unknown_options_are_type_errors(renderer):
    with pytest.raises(TypeError, match="'colour'"):
        renderer.render(colour="red")


def test_threads_share_a_connection(renderer):
    seen: dict[str, set[str]] = {}

    def render(wall):
        above = "+y" if wall[1] != "y" else "+x"
        seen[wall] = {wall_of(renderer.render(looking(wall, above), size=SIZE, direct=True).rgb[0, 12, 16]) for _ in range(5)}

    threads = [threading.Thread(target=render, args=(wall,)) for wall in WALLS]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert seen == {wall: {wall} for wall in WALLS}


def test_the_lock_is_released_while_a_batch_is_rendered(renderer):
    done, turns = threading.Event(), []

    def count():
        while not done.is_set():
            turns.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    begin = time.perf_counter()
    renderer.render([looking("+x", "+y")] * 32, size=(240, 320), direct=True)
    end = time.perf_counter()
    done.set()
    thread.join()
    within = [turn for turn in turns if begin < turn < end]
    assert len(within) >= 5


def test_control_c_interrupts_a_batch_and_leaves_the_service_running(renderer):
    # What a shell runs in the background ignores Control-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        begin = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            renderer.render([looking("+x", "+y")] * 1000, size=(480, 640), direct=True, supersampling=4)
        assert time.monotonic() - begin < 5.0
    finally:
        signal.signal(signal.SIGINT, before)
    assert wall_of(renderer.render(looking("+z", "+y"), size=SIZE, direct=True).rgb[0, 12, 16]) == "+z"


def test_a_forked_process_is_told_to_connect_anew(renderer):
    child = os.fork()
    if child == 0:
        code = 1
        try:
            renderer.render(size=SIZE)
        except argus_render.ArgusError as error:
            again = argus_render.connect(renderer.url)
            works = wall_of(again.render(looking("+z", "+y"), size=SIZE, direct=True).rgb[0, 12, 16]) == "+z"
            code = 0 if "forked" in str(error) and works else 2
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_describe_names_the_room(renderer):
    described = renderer.describe()
    np.testing.assert_allclose(described.bounds, [[-1, -1, -1], [1, 1, 1]], atol=1e-6)
    assert described.triangles == 12 and len(described.scene_hash) == 64
    viewpoint = described.viewpoints[0]
    same = renderer.render(viewpoint.pose("world", "z"), fov_deg=viewpoint.fov_deg, convention="world", up="z", direct=True)
    np.testing.assert_array_equal(same.rgb, renderer.render(direct=True).rgb)


def test_connections_that_cannot_be_made_say_why(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(argus_render.Unavailable, match="nothing came within 300 ms"):
            argus_render.connect(f"http://127.0.0.1:{port}", timeout=0.3)
    with pytest.raises(argus_render.Unavailable):
        argus_render.connect(f"http://127.0.0.1:{port}")
    for arguments, field in [
        ({"url": "127.0.0.1:7400"}, "url"),
        ({"url": "https://127.0.0.1:7400"}, "ca"),
        ({"url": "http://127.0.0.1:7400", "token_file": tmp_path / "none"}, "token_file"),
        ({"url": "http://127.0.0.1:7400", "encoding": "jpeg"}, "encoding"),
        ({"url": "http://127.0.0.1:7400", "timeout": 0.0}, "timeout"),
    ]:
        with pytest.raises(InvalidField) as caught:
            argus_render.connect(**arguments)
        assert caught.value.field == field
