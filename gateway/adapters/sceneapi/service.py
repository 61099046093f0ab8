"""Makes the listing, the glTF file and the images of the live scene, for ``routes``."""

import threading
import uuid
from dataclasses import dataclass, replace
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.sceneapi.config import SceneApiConfig
from gateway.adapters.sceneapi.query import FileQuery, ImageQuery
from gateway.files.gltf.export import export_glb
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.bounds import Bounds, instance_bounds, union
from gateway.scene.draw.live_scene import LiveScene
from gateway.scene.draw.shown import with_visibility
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Node, Path, json_element
from renderers.camera import Camera
from renderers.depth_range import depth_in_millimetres
from renderers.drawlist import LABEL_NONE, DrawList, Topology
from renderers.encode import png_gray16, png_label, png_rgb, tiff_float32
from renderers.fxaa import fxaa
from renderers.interface import Frame, Output, Renderer

_OUTPUTS: Final = {"color": Output.COLOR, "depth": Output.DEPTH, "label": Output.LABEL}


@dataclass(frozen=True, slots=True)
class SceneResponse:
    """A response without its headers."""

    body: bytes
    media_type: str
    revision: int
    """Revision of the scene."""


class SceneApi:
    """Makes the bodies of responses from the newest snapshot, or another one of a timeline. Thread-safe."""

    def __init__(
        self, scene: LiveScene, renderer: Renderer, workers: WorkerPool, config: SceneApiConfig | None = None
    ) -> None:
        self.config = config or SceneApiConfig()
        self.scene = scene
        self.workers = workers
        self._renderer = renderer
        self._process_id = uuid.uuid4().hex[:12]
        self._listing_lock = threading.Lock()
        self._listing: SceneResponse | None = None
        self._count_lock = threading.Lock()
        self._image_count = 0

    def etag(self, revision: int) -> str:
        """Return the ETag of a revision. It contains a process id, because revisions start at 0 in each process."""
        return f'"{self._process_id}-{revision}"'

    def status(self) -> dict[str, Any]:
        """Return the figures for health and metrics."""
        snapshot = self.scene.tree.snapshot
        return {
            "revision": snapshot.revision,
            "geometries": snapshot.root.nodes_with_parts,
            "pictures": self._image_count,
        }

    def listing(self, snapshot: Snapshot | None = None) -> SceneResponse:
        """Return the response of ``GET /scene``; that of the newest snapshot is computed once per revision."""
        if snapshot is not None and snapshot is not self.scene.tree.snapshot:
            return self._list(snapshot)
        with self._listing_lock:
            snapshot = self.scene.tree.snapshot
            if self._listing is None or self._listing.revision != snapshot.revision:
                self._listing = self._list(snapshot)
            return self._listing

    def _list(self, snapshot: Snapshot) -> SceneResponse:
        draw_list = self.scene.draw_list(snapshot)
        body = list_scene(snapshot, draw_list, self.scene.flattener.labels, self.config.max_nodes)
        return SceneResponse(body, "application/json", snapshot.revision)

    def file(self, query: FileQuery | None = None, snapshot: Snapshot | None = None) -> SceneResponse:
        """Return the response of ``GET /scene.glb``. Without a query the file has no camera; None: the newest snapshot.

        Raises FileTooLargeError, or CameraError if the camera cannot be resolved in the scene.
        """
        snapshot = snapshot or self.scene.tree.snapshot
        camera = None
        if query is not None:
            snapshot = with_visibility(snapshot, query.hidden, query.shown)
            camera = self._camera(query, snapshot, self.scene.draw_list(snapshot))
        body = export_glb(snapshot.root, camera=camera, max_bytes=self.config.max_export_bytes)
        return SceneResponse(body, "model/gltf-binary", snapshot.revision)

    def image(self, query: ImageQuery, snapshot: Snapshot | None = None) -> SceneResponse:
        """Return the response of ``GET /scene/render``. None: the newest snapshot.

        Raises RequestValidationError if the image would be too large, CameraError, or ImageError of a texture.
        """
        snapshot = with_visibility(snapshot or self.scene.tree.snapshot, query.hidden, query.shown)
        draw_list = self.scene.draw_list(snapshot)
        camera = self._camera(query, snapshot, draw_list)
        style = replace(self.config.style.for_image(query.background_rgb, query.light), samples=query.samples or 0)
        look = style.look_for(query.look)
        outputs, smooth = _OUTPUTS[query.type], query.type == "color" and style.applies_fxaa(look)
        if smooth and query.look == "plain" and any(_flags_of_points(draw_list)):
            outputs |= Output.INSTANCE
        frame = self._renderer.render(draw_list, camera, outputs, look)
        if smooth:
            _smooth(frame, draw_list)
        body, media_type = _encode(frame, query)
        with self._count_lock:
            self._image_count += 1
        return SceneResponse(body, media_type, snapshot.revision)

    def _camera(self, query: FileQuery, snapshot: Snapshot, draw_list: DrawList) -> Camera:
        config = self.config
        width, height = query.size(config.width, config.height, config.max_side, config.max_pixels)
        return resolve_camera(
            query.camera_spec,
            snapshot.root,
            width,
            height,
            fovy=query.fovy,
            near=query.near,
            far=query.far,
            stereo=self.scene.stereo_camera(snapshot),
            draw_list=draw_list,
        )


def _encode(frame: Frame, query: ImageQuery) -> tuple[bytes, str]:
    if query.type == "color":
        assert frame.color is not None
        return png_rgb(frame.color), "image/png"
    if query.type == "label":
        assert frame.label is not None
        return png_label(frame.label), "image/png"
    assert frame.depth is not None
    if query.format == "png":
        return png_gray16(depth_in_millimetres(frame.depth)), "image/png"
    return tiff_float32(frame.depth), "image/tiff"


def _smooth(frame: Frame, draw_list: DrawList) -> None:
    """Apply FXAA, except to points if the frame has instances: it mixes a third of the neighbours' colour into them."""
    assert frame.color is not None
    original = frame.color.copy()
    fxaa(frame.color)
    if frame.instance is not None:
        is_point = np.array([*_flags_of_points(draw_list), False])  # the last one is the background's, whose id is -1
        np.copyto(frame.color, original, where=is_point[frame.instance, None])


def _flags_of_points(draw_list: DrawList) -> list[bool]:
    """Return a flag for each instance: True if it draws points."""
    return [instance.mesh.topology is Topology.POINTS for instance in draw_list.instances]


class ListedNode(msgspec.Struct):
    """One node of the scene."""

    path: list[str | int]
    """Names from the root to the node."""
    kinds: list[str]
    """Kinds of the node's own parts, as the client named them."""
    has_geometry: bool
    """True if a client has set the node's geometry, even if it is empty."""
    visible: bool
    """The node's own flag. A node is also hidden if an ancestor's flag is false."""
    opacity: float
    """The node's own factor of alpha, 0 to 1, which also applies to its descendants."""
    label: int | None
    """Label in label images, as red + 256 green + 65536 blue; null without geometry."""
    bounds: list[list[float]] | None
    """Bounds of the visible subtree in the world: minimum and maximum corner, metres. Null if nothing is drawn."""
    transform: list[list[float]]
    """X_world_node, (4, 4), row-major. Values that are not finite are null."""


class Listing(msgspec.Struct):
    """The response of ``GET /scene``."""

    revision: int
    """Revision of the live tree."""
    nodes: list[ListedNode]
    """The first nodes, up to the server's limit. Parents come before their children."""
    node_count: int
    """Number of nodes of the whole tree."""
    bounds: list[list[float]] | None
    """Bounds of the whole scene, as ``ListedNode.bounds``."""


def list_scene(snapshot: Snapshot, draw_list: DrawList, labels: LabelTable, max_nodes: int) -> bytes:
    """Return the JSON of a snapshot, with at most ``max_nodes`` nodes, at least 1, and labels from ``labels``."""
    instance_boxes = instance_bounds(draw_list.instances)
    index_by_path: dict[Path, int] = {}
    nodes: list[ListedNode] = []
    parents: list[int] = []
    """Index of each node's parent in ``nodes``; 0 for the root."""
    pending: list[tuple[Path, Node, NDArray[np.float64], int]] = [((), snapshot.root, np.eye(4), 0)]
    """Stack of nodes with their paths, X_world_parent, and the indices of their parents."""
    with np.errstate(all="ignore"):  # clients may set transforms that overflow
        while pending and len(nodes) < max_nodes:
            path, node, X_world_parent, parent_index = pending.pop()
            X_world_node = X_world_parent @ node.matrix
            index = index_by_path[path] = len(nodes)
            nodes.append(_listed_node(path, node, X_world_node, labels))
            parents.append(parent_index)
            for name, child in reversed(node.children.items()):
                pending.append(((*path, name), child, X_world_node, index))
    _set_bounds(nodes, parents, index_by_path, draw_list, instance_boxes, labels)
    bounds = union([box for box in instance_boxes if box is not None])
    return msgspec.json.encode(
        Listing(snapshot.revision, nodes, snapshot.root.node_count, None if bounds is None else bounds.tolist())
    )


def _listed_node(path: Path, node: Node, X_world_node: NDArray[np.float64], labels: LabelTable) -> ListedNode:
    label = labels.label_of(path) if node.parts else LABEL_NONE
    return ListedNode(
        path=[json_element(element) for element in path],
        kinds=[part.kind or type(part.shape).__name__.lower() for part in node.parts or ()],
        has_geometry=node.parts is not None,
        visible=node.visible,
        opacity=node.opacity,
        label=None if label == LABEL_NONE else label,
        bounds=None,
        transform=X_world_node.tolist(),
    )


def _set_bounds(
    nodes: list[ListedNode],
    parents: list[int],
    index_by_path: dict[Path, int],
    draw_list: DrawList,
    instance_boxes: list[Bounds | None],
    labels: LabelTable,
) -> None:
    """Set the bounds of all nodes from their instances and their children's bounds, children first."""
    boxes_below: list[list[Bounds]] = [[] for _ in nodes]
    """Boxes of each node's instances, and of its children when those have their bounds."""
    for instance, box in zip(draw_list.instances, instance_boxes, strict=True):
        path = labels.path_of(instance.label)
        if box is None or path is None:
            continue
        while path and path not in index_by_path:  # beyond the limit: it counts for the nearest listed ancestor
            path = path[:-1]
        boxes_below[index_by_path[path]].append(box)
    for index in range(len(nodes) - 1, -1, -1):
        box = union(boxes_below[index])
        if box is None:
            continue
        nodes[index].bounds = box.tolist()
        if index:
            boxes_below[parents[index]].append(box)
