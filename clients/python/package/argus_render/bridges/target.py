"""Where a bridge writes its file."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path


def target(path: str | os.PathLike[str] | None, name: str) -> Path:
    """The caller's path; or, without one, a file in a new folder, which is removed when this process ends."""
    if path is not None:
        return Path(path)
    folder = tempfile.mkdtemp(prefix="argus-render-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder, f"{name}.glb")
