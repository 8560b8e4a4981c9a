"""The connection to a service."""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from argus_render import _native
from argus_render.description import Description
from argus_render.errors import ArgusError, InvalidField
from argus_render.frames import Frames
from argus_render.lenses import LensName, lens_rows
from argus_render.outputs import Array, allocate, as_bytes, names, turn_normals
from argus_render.plan import as_json
from argus_render.poses import Convention, Up, pose_rows, world_rays
from argus_render.service import Service
from argus_render.session import Session
from argus_render.transforms import Moved, Space, transform_rows

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from argus_render.plan import Plan

Paths = str | os.PathLike[str]


def open(scene: Paths, *, workers: int | None = None, arguments: Sequence[str] = ()) -> Renderer:
    """Starts a service on this machine that shows `scene`, and connects to it. It stops with the Renderer or this process.

    `scene` is a file (.glb, .gltf, .obj, .ply) or one of the service's own scenes, such as "terrain". `workers` is the number
    of its processes that render; `arguments` are further ones of `argus serve`.
    The program argus is found by ARGUS_BIN, beside this package's files, or on PATH.
    """
    service = Service(os.fspath(scene), workers, arguments)
    try:
        client = _native.Client(
            service.url, encoding="raw", timeout=30.0, ca=None, token=None, identity=None, scene=None
        )
        return Renderer(client, service)
    except BaseException:
        service.stop()
        raise


def connect(
    url: str,
    *,
    ca: Paths | None = None,
    token_file: Paths | None = None,
    identity: tuple[Paths, Paths] | None = None,
    encoding: Literal["raw", "zstd"] = "raw",
    timeout: float = 5.0,
    scene: str | None = None,
) -> Renderer:
    """Connects to a service such as "http://127.0.0.1:7400", within `timeout` seconds.

    `url` may list several coordinators of one service, separated by commas. For https://, `ca` is the file of the authority
    that signed the service's certificate, `token_file` the file of this client's token, and `identity` the files of a
    certificate of this client and of its key, where the service wants one. `encoding` of images on the way: "zstd" takes time
    and saves bytes. `scene` is the name of a scene, of a service with several (`Description.scenes`); the first one if not given.
    """
    if url.lower().startswith("https://") and ca is None:
        raise InvalidField("ca", "https:// needs the file of the authority that signed the service's certificate")
    token = None if token_file is None else _read("token_file", token_file).decode(errors="replace")
    credentials = None if identity is None else (_read("identity[0]", identity[0]), _read("identity[1]", identity[1]))
    authority = None if ca is None else _read("ca", ca)
    client = _native.Client(
        url, encoding=encoding, timeout=timeout, ca=authority, token=token, identity=credentials, scene=scene
    )
    return Renderer(client, None, url)


class Renderer:
    """Renders views of one scene. Made by `open` or `connect`. Threads may share it; a forked process must connect anew."""

    def __init__(self, client: _native.Client, service: Service | None, url: str = "") -> None:
        self._client, self._service = client, service
        #: Address of the service, with which other processes connect.
        self.url = url if service is None else service.url

    def describe(self) -> Description:
        """The served scene, its viewpoints and limits."""
        return Description.from_json(self._client.describe())

    def render(
        self,
        poses: ArrayLike | None = None,
        K: ArrayLike | None = None,
        *,
        fov_deg: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        lens: LensName = "opencv",
        flow_to: ArrayLike | None = None,
        size: tuple[int, int] = (480, 640),
        convention: Convention = "opencv",
        outputs: str | Sequence[str] = ("rgb",),
        pixel_center: float = 0.5,
        up: Up = "y",
        timeout: float = 60.0,
        partial: bool = False,
        out: Mapping[str, Array] | None = None,
        **plan: Unpack[Plan],
    ) -> Frames:
        """Renders a view of each pose, as one batch: its frames are those that single views with the same plan give.

        poses: camera to world [N, 4, 4] or [4, 4], metres; the first viewpoint of the scene if not given.
        K: pinhole matrix in pixels, [3, 3] or one a pose. fov_deg: vertical angle instead, 45 if neither is given.
        distortion: coefficients of K's lens in OpenCV's order, the same for all poses.
        lens: their model, "opencv" (k1, k2, p1, p2, k3, k4, k5, k6) or "fisheye" (k1 to k4); or "equirectangular", all directions
            without K. Lenses with distortion are rendered from triangles.
        flow_to: for the output "flow", a second pose for each pose.
        size: (height, width) in pixels.
        convention: axes of a camera. "opencv" (ROS, COLMAP): x right, y down, z forward. "opengl" (Blender, USD): x right,
            y up, z backward. "world" (Isaac): x forward, y left, z up.
        outputs: any of "rgb", "radiance", "range", "depth", "normal", "instance", "material", "flow", "mask", "source",
            "confidence"; their meaning is at the properties of Frames.
        pixel_center: where K has the centre of the first pixel, 0.5 or 0.0.
        up: axis that is up in the world of the poses.
        timeout: longest wait for the next frame of the batch, seconds.
        partial: whether the result may lack frames, which `failed` then names. Otherwise the first failure is raised.
        out: arrays to write images into, by output; new ones are made for the rest.
        plan: how the views are answered, see Plan. Without any option the service chooses.

        Raises InvalidField for arguments that cannot be used, and any ArgusError.
        """
        if poses is None:
            viewpoint = self.describe().viewpoints[0]
            poses = viewpoint.pose(convention, up)
            if K is None and fov_deg is None and lens == "opencv":
                fov_deg = viewpoint.fov_deg
        rows, size, wanted = pose_rows(poses, convention, up), _checked(size), names(outputs)
        lenses = lens_rows(K, fov_deg, distortion, lens, len(rows), pixel_center)
        seconds = None if flow_to is None else pose_rows(flow_to, convention, up, "flow_to")
        if seconds is not None and len(seconds) != len(rows):
            raise InvalidField("flow_to", f"must be one for each of {len(rows)} poses, not {len(seconds)}")
        arrays = allocate(wanted, len(rows), size, out)
        came = self._client.render(rows, lenses, seconds, None, size, as_bytes(arrays), as_json(plan), timeout)
        return _frames(came, arrays, up, partial)

    def scan(
        self,
        rays: ArrayLike,
        poses: ArrayLike | None = None,
        *,
        convention: Convention = "opencv",
        outputs: str | Sequence[str] = ("range",),
        up: Up = "y",
        timeout: float = 60.0,
        partial: bool = False,
        out: Mapping[str, Array] | None = None,
    ) -> Frames:
        """Follows rays of any directions from each pose, like a lidar. Images have a pixel for each ray.

        rays: directions [H, W, 3] or [W, 3] in the sensor's axes, of any length; where one is zero, nothing is seen. At most
            65,536 for each pose.
        poses, convention, outputs, up, timeout, partial, out: as of `render`. "depth" is measured along the sensor's axis, and
            "range" along the ray.

        Raises InvalidField for arguments that cannot be used, and any ArgusError.
        """
        if poses is None:
            poses = self.describe().viewpoints[0].pose(convention, up)
        rows, wanted = pose_rows(poses, convention, up), names(outputs)
        directions, size = world_rays(rays, rows, convention)
        arrays = allocate(wanted, len(rows), size, out)
        lenses = lens_rows(None, None, None, "opencv", len(rows), 0.5)
        came = self._client.render(rows, lenses, None, directions, size, as_bytes(arrays), "{}", timeout)
        return _frames(came, arrays, up, partial)

    def replay(self, record: Mapping[str, Any], *, timeout: float = 60.0) -> Frames:
        """Makes the frame of a record again (see Frames.record), within `timeout` seconds.

        On the same kind of device and driver its digest is that of the record. Normals are in the service's world, +y up.
        """
        try:
            size = _checked((record["height"], record["width"]))
            wanted = names(["rgb" if output == "color" else output for output in record["outputs"]])
        except (KeyError, TypeError) as error:
            raise InvalidField("record", f"is no record of a frame: {error!r}") from None
        arrays = allocate(wanted, 1, size)
        came = self._client.replay(json.dumps(record), as_bytes(arrays), timeout)
        if isinstance(came, ArgusError):
            raise came
        return Frames(arrays, {}, [came])

    def names(self, of: Literal["instance", "material", "node"]) -> list[str]:
        """The names of the scene's instances, materials or nodes, by their ids. Some may be empty or equal."""
        return self._client.node_names() if of == "node" else self._client.names(of)

    def set_transforms(
        self,
        transforms: Mapping[str | int, ArrayLike | None],
        *,
        space: Space = "world",
        up: Up = "y",
        expected_revision: int | None = None,
    ) -> Moved:
        """Moves nodes of the scene for all viewers, all at one moment. Views that are requested afterwards show them.

        transforms: for each node, by its name or its index in `names("node")`, a matrix [4, 4] or [3, 4], metres: from the
            node's space to `space`. None: the transform of the file again. The node keeps it until it is set again, or until
            the service restarts. What hangs from the node moves along.
        space: "world", or "parent": the space of the node above, as in glTF.
        up: axis that is up in the caller's world; only for space="world".
        expected_revision: nothing moves, and ArgusError is raised, unless this is the newest revision.

        The first call that names a node takes longer than later ones: name all that will move once at the start. At most 2048
        nodes a call. Raises InvalidField for what cannot be used, and any ArgusError.
        """
        nodes, matrices = transform_rows(transforms, space, up)
        return Moved.from_json(self._client.set_transforms(nodes, matrices, space == "world", expected_revision))

    def node_setters(self) -> dict[int, tuple[int, str]]:
        """Who set each node last: by its index, the revision since which its transform is there, and the client's name."""
        return {node: (revision, client) for node, revision, client in self._client.node_setters()}

    def session(
        self,
        K: ArrayLike | None = None,
        *,
        fov_deg: float | None = None,
        distortion: ArrayLike | None = None,
        lens: LensName = "opencv",
        size: tuple[int, int] = (480, 640),
        convention: Convention = "opencv",
        outputs: str | Sequence[str] = ("rgb",),
        pixel_center: float = 0.5,
        up: Up = "y",
        history: bool = False,
        **plan: Unpack[Plan],
    ) -> Session:
        """A session of a moving camera, which gets the newest frame and never waits for older ones.

        history: whether a frame may begin from the one before it, which is faster and cannot be repeated. The other arguments
        are those of `render`.
        """
        size, wanted = _checked(size), names(outputs)
        [optics] = lens_rows(K, fov_deg, distortion, lens, 1, pixel_center)
        native = self._client.session(size, list(wanted), as_json(plan), history)

        def row(pose: ArrayLike) -> NDArray[np.float64]:
            rows = pose_rows(pose, convention, up)
            if len(rows) > 1:
                raise InvalidField("pose", f"must be one, not {len(rows)}")
            return rows.reshape(9)

        return Session(native, row, optics, wanted, size, up, self)

    def close(self) -> None:
        """Stops the service that `open` started, after it has finished its work."""
        if self._service is not None:
            self._service.stop()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _checked(size: tuple[int, int]) -> tuple[int, int]:
    try:
        height, width = (operator.index(side) for side in size)
    except (TypeError, ValueError):
        raise InvalidField("size", f"must be two whole numbers (height, width), not {size!r}") from None
    if not (0 < height < 2**32 and 0 < width < 2**32):
        raise InvalidField("size", f"must be of at least one pixel, not {size!r}")
    return height, width


def _read(field: str, path: Paths) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InvalidField(field, f"cannot be read: {error}") from error


def _frames(came: list[str | ArgusError], arrays: dict[str, Array], up: str, partial: bool) -> Frames:
    """Frames of what came: raises the first failure, unless the result may be partial."""
    turn_normals(arrays, up)
    failed = {i: error for i, error in enumerate(came) if isinstance(error, ArgusError)}
    for i, error in failed.items():
        error.index = i
        if not partial:
            raise error
        for array in arrays.values():
            array[i] = np.nan if array.dtype.kind == "f" else 0
    return Frames(arrays, failed, [report if isinstance(report, str) else None for report in came])
