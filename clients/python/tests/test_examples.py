"""The examples run as they stand."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.mark.parametrize(
    ("name", "packages", "arguments"),
    [
        ("hello.py", ["PIL"], ["terrain:2000", "hello.png"]),
        ("trimesh_turntable.py", ["PIL", "trimesh"], ["turntable.png"]),
        ("usd_stage.py", ["PIL", "pxr.Usd"], []),
        ("mujoco_wrist.py", ["PIL", "mujoco"], ["wrist.png"]),
        ("vector_env.py", ["gymnasium"], ["3", "terrain:2000"]),
    ],
)
def test_an_example_runs(name, packages, arguments, tmp_path):
    for package in packages:
        pytest.importorskip(package)
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, cwd=tmp_path, env=dict(os.environ), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    pictures = list(tmp_path.glob("*.png"))
    assert len(pictures) == ("PIL" in packages)
