"""Services that `open` starts."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import argus_render
from argus_render.service import find_program

#: A process that opens a scene, prints the service's process id, and waits.
OWNER = """
import sys, time, argus_render
renderer = argus_render.open(sys.argv[1], workers=1)
print(renderer._service._process.pid, flush=True)
{then}
"""


def has_ended(pid: int, within: float = 20.0) -> bool:
    """Whether a process ends, or is a zombie that nobody has waited for."""
    until = time.monotonic() + within
    while time.monotonic() < until:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
                return True
        except (FileNotFoundError, ProcessLookupError):
            return True
        time.sleep(0.05)
    return False


def own(room: Path, then: str) -> tuple[subprocess.Popen[str], int]:
    command = [sys.executable, "-c", OWNER.format(then=then), str(room)]
    owner = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert owner.stdout
    return owner, int(owner.stdout.readline())


def test_a_service_ends_with_its_renderer(room):
    with argus_render.open(room, workers=1) as renderer:
        pid, url = renderer._service._process.pid, renderer.url
        assert argus_render.connect(url).describe().triangles == 12
    assert has_ended(pid, within=0.5)
    with pytest.raises(argus_render.Unavailable):
        argus_render.connect(url)


def test_a_client_chooses_a_scene_by_its_name(room):
    with argus_render.open(room, workers=1, arguments=["--scene", "hills=terrain:2000"]) as renderer:
        assert renderer.describe().scenes == ("room", "hills")
        assert renderer.describe().triangles == 12
        assert argus_render.connect(renderer.url, scene="hills").describe().scene == "terrain:2000"
        with pytest.raises(argus_render.InvalidField, match="room, hills"):
            argus_render.connect(renderer.url, scene="valley")


@pytest.mark.parametrize("then", ["", "raise SystemExit(3)", "import os; os._exit(4)", "os = None; time.sleep(600)"])
def test_a_service_ends_however_its_owner_does(room, then):
    owner, service = own(room, then)
    if "sleep" in then:
        os.kill(owner.pid, signal.SIGKILL)
    owner.wait(30.0)
    assert has_ended(service)


def test_a_forked_process_does_not_keep_a_service_alive(room):
    then = "import os\nif os.fork() == 0:\n    time.sleep(60)\nos._exit(0)"
    owner, service = own(room, then)
    owner.wait(30.0)
    assert has_ended(service)


def test_a_scene_that_cannot_be_opened_is_an_error_with_the_reason(tmp_path):
    with pytest.raises(argus_render.Unavailable, match="missing.glb"):
        argus_render.open(tmp_path / "missing.glb")


def test_a_program_that_cannot_be_found_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setenv("ARGUS_BIN", str(tmp_path / "argus"))
    with pytest.raises(argus_render.ArgusError, match="ARGUS_BIN"):
        argus_render.open("terrain")
    monkeypatch.delenv("ARGUS_BIN")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(argus_render.ArgusError, match="set ARGUS_BIN"):
        argus_render.open("terrain")
    program = tmp_path / "argus"
    program.write_text("#!/bin/sh\necho broken >&2\nexit 3\n")
    program.chmod(0o755)
    assert find_program() == str(program)
    with pytest.raises(argus_render.Unavailable, match="broken"):
        argus_render.open("terrain")


def test_settings_of_the_environment_do_not_reach_the_service(monkeypatch, room):
    monkeypatch.setenv("ARGUS_COORDINATOR__LISTEN", "256.0.0.1:1")
    with argus_render.open(room, workers=1) as renderer:
        assert renderer.url.startswith("http://127.0.0.1:")
