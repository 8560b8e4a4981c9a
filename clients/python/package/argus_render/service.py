"""A service on this machine, which lives as long as its owner."""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
import threading
import weakref
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from argus_render.errors import ArgusError, Unavailable

logger = logging.getLogger("argus_render")

#: Seconds that the service has to finish its work when it is stopped.
GRACE_SECS = 20.0

#: Lines of the service's log that an error repeats.
REPEATED_LINES = 20

#: Services of this process. A fork must not keep them alive.
_running: weakref.WeakSet[Service] = weakref.WeakSet()


class Service:
    """An `argus serve` on a free port of the loopback interface. It ends when its owner does, however that ends: the service
    watches its standard input, which closes with this process.
    """

    def __init__(self, scene: str, workers: int | None = None, arguments: Sequence[str] = ()) -> None:
        """Starts the service, and waits until clients can connect."""
        program = find_program()
        command = [program, "serve", "--scene", scene, *([] if workers is None else ["--workers", str(workers)])]
        command += ["--config=", "--json", "--exit-with-stdin", "--listen", "127.0.0.1:0", *arguments]
        # Variables of the environment that configure services could make this one unreachable.
        environment = {name: value for name, value in os.environ.items() if not _configures(name)}
        environment.setdefault("ARGUS_LOG", "warn")
        try:
            # In a session of its own, so that Ctrl-C interrupts a call and not the service.
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=environment,
                start_new_session=True,
            )
        except OSError as error:
            raise ArgusError(f"cannot start {program}: {error}") from error
        self._process = process
        self._stop = weakref.finalize(self, _stop, process)
        _running.add(self)
        log: deque[str] = deque(maxlen=REPEATED_LINES)
        reader = threading.Thread(target=_read_log, args=(process.stderr, log), daemon=True, name="argus log")
        reader.start()
        announcement = _announcement(process.stdout)
        if announcement is None:
            self._stop()
            reader.join(timeout=1.0)
            raise Unavailable(f"argus serve ended before it served: {' '.join(log) or f'code {process.returncode}'}")
        #: Its address.
        self.url: str = announcement["url"]

    def stop(self) -> None:
        """Stops the service after it has finished its work."""
        self._stop()


def find_program() -> str:
    """The `argus` program: by ARGUS_BIN, beside this package's files, or on PATH.

    Raises ArgusError, which says what to do, if there is none.
    """
    named = os.environ.get("ARGUS_BIN")
    if named is not None:
        if not os.access(named, os.X_OK) or os.path.isdir(named):
            raise ArgusError(f"ARGUS_BIN is {named}, which is no program: name the file of the program argus")
        return named
    beside = Path(__file__).with_name("argus")
    if os.access(beside, os.X_OK):
        return str(beside)
    found = shutil.which("argus")
    if found is None:
        raise ArgusError(
            "there is no program argus on PATH: build it with `cargo build --release` and set ARGUS_BIN to target/release/argus, "
            "or connect(url) to a service that runs"
        )
    return found


def _configures(name: str) -> bool:
    return name.startswith("ARGUS_") and "__" in name


def _announcement(output: IO[bytes] | None) -> dict[str, str] | None:
    """Reads the one JSON object that the service prints when it serves; None if it ends before that."""
    text = b""
    for line in output or ():
        text += line
        if line.rstrip() == b"}":
            announcement: dict[str, str] = json.loads(text)
            return announcement
    return None


def _read_log(log: IO[bytes] | None, kept: deque[str]) -> None:
    for line in log or ():
        text = line.decode(errors="replace").rstrip()
        kept.append(text)
        logger.warning("%s", text)


def _stop(process: subprocess.Popen[bytes]) -> None:
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(GRACE_SECS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _after_fork() -> None:
    """In a forked process: lets go of the services, which are its parent's."""
    for service in list(_running):
        service._stop.detach()
        if service._process.stdin is not None:
            service._process.stdin.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
