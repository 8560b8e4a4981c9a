"""Measures the package on this machine: client CPU a frame, the rate beside that of `argus load`, and the first array.

    ARGUS_BIN=../../target/release/argus python bench.py [SCENE] [--seconds 10]

Prints one JSON object. Times are wall times on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time

import numpy as np

import argus_render
from argus_render.poses import pose
from argus_render.service import find_program

#: Cameras of a step.
CAMERAS = 64
HELLO = """
import time, argus_render
begin = time.perf_counter()
shape = argus_render.open({scene!r}).render().rgb.shape
print(time.perf_counter() - begin)
"""


def load_poses(described: argus_render.Description, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The cameras of `argus load --views COUNT`: poses and vertical angles."""
    poses, fovs = [], []
    for i in range(count):
        viewpoint = described.viewpoints[i % len(described.viewpoints)]
        eye, axis, up = np.array(viewpoint.row).reshape(3, 3)
        up = up / np.linalg.norm(up)
        turn = 2 * np.pi * (i * 0.618033988749895 % 1.0)
        least, most = described.bounds
        if (least <= eye).all() and (eye <= most).all():
            side = np.cross(axis, up)
            side /= np.linalg.norm(side)
            moved = eye + (side * np.sin(turn) + up * np.cos(2 * turn) * 0.5) * (most - least).max() * 0.01
            row = (moved, turned(axis, up, 0.4 * np.sin(turn + 0.7)), up)
        else:
            ahead = turned(axis, up, 0.436 * np.sin(turn)) * (1.0 + 0.1 * np.cos(2 * turn))
            row = (eye + axis - ahead, ahead, up)
        poses.append(pose(np.concatenate(row), "opencv", "y"))
        fovs.append(viewpoint.fov_deg)
    return np.array(poses), np.array(fovs)


def turned(vector: np.ndarray, about: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' rotation."""
    along = about * (about @ vector)
    return along + (vector - along) * np.cos(angle) + np.cross(about, vector) * np.sin(angle)


def measure(renderer: argus_render.Renderer, size: tuple[int, int], seconds: float) -> dict[str, float]:
    """Steps of CAMERAS views from triangles, and `argus load` with the same views, in turn."""
    poses, fovs = load_poses(renderer.describe(), CAMERAS)
    views, out = CAMERAS, settled(renderer, poses, fovs, size)
    cpu = 0.0
    rates: list[float] = []
    of_load: list[float] = []
    frames, end = 0, time.monotonic() + seconds
    while time.monotonic() < end or len(rates) < 3:
        wall, used = time.perf_counter(), time.process_time()
        renderer.render(poses, fov_deg=fovs, size=size, direct=True, timeout=600.0, out=out)
        cpu += time.process_time() - used
        rates.append(CAMERAS / (time.perf_counter() - wall))
        frames += CAMERAS
        command = [find_program(), "load", "--server", renderer.url, "--views", str(views), "--direct", "--json"]
        command += ["--size", f"{size[1]}x{size[0]}"]
        report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        of_load.append(report["views_per_sec"])
    return {
        "client_cpu_ms_a_frame": 1e3 * cpu / frames,
        "frames_per_sec": statistics.median(rates),
        "argus_load_views_per_sec": statistics.median(of_load),
        "share_of_argus_load": statistics.median(rates) / statistics.median(of_load),
    }


def settled(
    renderer: argus_render.Renderer, poses: np.ndarray, fovs: np.ndarray, size: tuple[int, int]
) -> dict[str, np.ndarray]:
    """Renders until all views are lit by light cells, or for a minute: before, each step is lit in another way."""
    end = time.monotonic() + 60.0
    while True:
        frames = renderer.render(poses, fov_deg=fovs, size=size, direct=True, timeout=600.0)
        by_cells = all("cells" in str((provenance or {}).get("plan")) for provenance in frames.provenance)
        if by_cells or time.monotonic() > end:
            return frames.arrays


def hello(scene: str) -> float:
    """Seconds from after the import to the first array, in a new process."""
    done = subprocess.run([sys.executable, "-c", HELLO.format(scene=scene)], check=True, capture_output=True, text=True)
    return float(done.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="terrain")
    parser.add_argument("--seconds", type=float, default=10.0)
    arguments = parser.parse_args()
    report: dict[str, object] = {"scene": arguments.scene, "first_array_secs": [hello(arguments.scene) for _ in range(3)]}
    with argus_render.open(arguments.scene, workers=1) as renderer:
        for size in [(150, 200), (480, 640)]:
            report[f"{size[1]}x{size[0]}"] = measure(renderer, size, arguments.seconds)
    json.dump(report, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
