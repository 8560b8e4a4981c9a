"""The written types are those of the code."""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent.parent


def run(*arguments: str) -> None:
    environment = os.environ | {"MYPYPATH": "package"}
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=HERE, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_stubs_are_those_of_the_native_module():
    run("mypy.stubtest", "--mypy-config-file", "pyproject.toml", "argus_render._native")


def test_the_package_and_its_examples_keep_their_types():
    run("mypy")
