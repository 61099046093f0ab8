"""Answers about the live scene. Its methods run in worker threads, several at once."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.export import export_glb
from gateway.runtime.worker_pool import Workers
from gateway.scene.bounds import BoundsCache
from gateway.scene.cameras import CameraError, NoSuchCameraError
from gateway.scene.flatten import Flattener
from gateway.scene.labels import LabelTable
from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.viewpoints import resolve_camera
from gateway.sceneapi.config import SceneApiConfig
from gateway.sceneapi.listing import list_scene
from gateway.sceneapi.query import NoSuchCameraQueryError, PictureQuery, QueryError
from renderers.camera import Camera
from renderers.drawlist import DrawList, Topology
from renderers.encode import png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import Frame, Look, Output, Renderer

_OUTPUTS: Final = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}
_FARTHEST_MM: Final = 65535.0


@dataclass(frozen=True, slots=True)
class Answer:
    """A body and what it is."""

    body: bytes
    media_type: str
    revision: int


class SceneApi:
    """The live scene for HTTP clients. Thread-safe."""

    def __init__(
        self,
        tree: LiveTree,
        renderer: Renderer,
        workers: Workers,
        config: SceneApiConfig | None = None,
        *,
        labels: LabelTable | None = None,
        flattener: Flattener | None = None,
        stereo_camera: Callable[[], Camera | None] | None = None,
    ) -> None:
        """
        Args:
            labels: shared with whoever else draws labels of the live tree.
            flattener: over these labels, shared with whoever else draws the live tree.
            stereo_camera: gives the stereo sensor's left camera as it is now.
        """
        if flattener is not None and labels is None:
            raise ValueError("a flattener comes with its labels")
        self.config = SceneApiConfig() if config is None else config
        self.workers = workers
        self._tree = tree
        self._renderer = renderer
        self._labels = LabelTable() if labels is None else labels
        self._flattener = Flattener(self._labels) if flattener is None else flattener
        self._stereo_camera = stereo_camera
        self._process = uuid.uuid4().hex[:12]
        self._lock = threading.Lock()
        self._bounds = BoundsCache()
        self._listed: Answer | None = None
        self._counting = threading.Lock()
        self._pictures = 0

    @property
    def snapshot(self) -> Snapshot:
        """The newest state of the scene."""
        return self._tree.snapshot

    def etag(self, revision: int) -> str:
        """Names a state of this process's scene; revisions start again with every process."""
        return f'"{self._process}-{revision}"'

    def status(self) -> dict[str, Any]:
        """For health and metrics."""
        root = self._tree.snapshot
        return {"revision": root.revision, "geometries": root.root.geometry_count, "pictures": self._pictures}

    def listing(self) -> Answer:
        """``GET /scene``. Made once per revision."""
        with self._lock:
            snapshot = self._tree.snapshot
            known = self._listed
            if known is None or known.revision != snapshot.revision:
                drawn = self._flattener.flatten(snapshot)
                boxes = self._bounds.bounds_of(drawn)
                body = list_scene(snapshot, drawn, boxes, self._labels, self.config.max_nodes)
                known = self._listed = Answer(body, "application/json", snapshot.revision)
            return known

    def file(self, query: PictureQuery | None = None) -> Answer:
        """``GET /scene.glb``, with the camera of a query.

        Raises:
            ExportError: the file would be too large.
            QueryError: the camera cannot be resolved in the scene as it is.
        """
        snapshot = self._tree.snapshot
        camera = None
        if query is not None:
            camera = self._camera(query, snapshot, self._flattener.flatten(snapshot))
        body = export_glb(snapshot.root, camera=camera, max_bytes=self.config.max_export_bytes)
        return Answer(body, "model/gltf-binary", snapshot.revision)

    def picture(self, query: PictureQuery) -> Answer:
        """``GET /scene/render``.

        Raises:
            QueryError: the camera cannot be resolved in the scene as it is.
            ImageError: a texture in the scene cannot be decoded.
        """
        snapshot = self._tree.snapshot
        drawn = self._flattener.flatten(snapshot)
        camera = self._camera(query, snapshot, drawn)
        look = Look(query.look, self.config.background, query.samples, self.config.rig)
        smooth = self.config.antialias == "fxaa" and query.look != "studio" and query.samples == 1
        dots, outputs = None, _OUTPUTS[query.type]
        if query.type == "color" and query.look == "plain" and smooth:
            dots = _dots(drawn)
            outputs |= Output(0) if dots is None else Output.INSTANCE
        with self._renderer.render(drawn, camera, outputs, look) as frame:
            body, media_type = self._encoded(frame, query, dots, smooth)
        with self._counting:
            self._pictures += 1
        return Answer(body, media_type, snapshot.revision)

    def _camera(self, query: PictureQuery, snapshot: Snapshot, drawn: DrawList) -> Camera:
        try:
            return resolve_camera(
                query.camera,
                snapshot.root,
                query.width,
                query.height,
                fovy=query.fovy,
                near=query.near,
                far=query.far,
                stereo=self._stereo_camera() if self._stereo_camera is not None else None,
                drawn=drawn,
            )
        except NoSuchCameraError as error:
            raise NoSuchCameraQueryError(str(error)) from error
        except CameraError as error:
            raise QueryError(str(error)) from error

    def _encoded(
        self, frame: Frame, query: PictureQuery, dots: NDArray[np.bool_] | None, smooth: bool
    ) -> tuple[bytes, str]:
        if query.type == "color":
            assert frame.color is not None
            if smooth:
                _smooth(frame.color, frame.instance, dots)
            return png_rgb(frame.color), "image/png"
        if query.type == "label":
            assert frame.label is not None
            return png_label(frame.label), "image/png"
        assert frame.depth is not None
        if query.format == "png":
            return png_gray16(_millimetres(frame.depth)), "image/png"
        return tiff_float32(frame.depth), "image/tiff"


def _dots(drawn: DrawList) -> NDArray[np.bool_] | None:
    """Which instances are points: one bool each and a last one, False, for the background's id -1; None: none is."""
    flags = [instance.mesh.topology is Topology.POINTS for instance in drawn.instances]
    return np.array([*flags, False]) if any(flags) else None


def _smooth(color: NDArray[np.uint8], instance: NDArray[np.int32] | None, dots: NDArray[np.bool_] | None) -> None:
    """FXAA in place, but points keep their colours: it takes each for a lone spot and gives it a third of what lies
    around it."""
    if instance is None or dots is None:
        fxaa(color)
        return
    here = np.flatnonzero(dots[instance.ravel()])
    pixels = color.reshape(-1, 3)
    kept = pixels[here]
    fxaa(color)
    pixels[here] = kept


def _millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """(H, W) uint16: rounded millimetres, 65535 for nothing and for everything beyond 65.534 m."""
    rounded: NDArray[np.float32] = depth * np.float32(1000.0) + np.float32(0.5)
    return np.minimum(rounded, np.float32(_FARTHEST_MM)).astype(np.uint16)
