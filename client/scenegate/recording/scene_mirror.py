"""The live scene of a gateway, from the frames of its view: nodes, their transforms and their triangles.

Coordinate frames of recordings are rigid, nodes may be scaled. The stretch S of a node (the part of its transform that
is not rigid) is therefore applied to the points of its geometry: X_world_node = X_world_frame S.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from scenegate.recording.mirror_geometry import (
    IDENTITY,
    NO_GEOMETRY,
    MirrorMesh,
    NodeGeometry,
    node_geometry,
    quaternion_of,
    read_mesh,
    read_transforms,
    split_rigid,
)
from scenegate.recording.values import LEFT_FRAME, RIGHT_FRAME, WORLD, Cloud, Entity, FrameTransform, SceneChange
from scenegate.recording.view_frames import Joints, ViewFrame, ViewFrameError

ROOT_FRAME: Final = "scene"
"""Coordinate frame of the scene's root. The frames of other nodes are paths: ``scene/robot/head``."""
MAX_NODE_POINTS: Final = 300_000
"""Maximum number of points of a node's triangles and lines. Messages have an object for each: more take seconds."""
MAX_WARNINGS: Final = 100
"""Maximum number of nodes that warnings name."""


@dataclass(slots=True, eq=False)
class _Node:
    id: int
    frame_id: str
    parent: _Node | None
    children: dict[int, _Node] = field(default_factory=dict)
    matrix: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    """X_parent_node, (4, 4)."""
    quaternion: list[float] | None = None
    """Rotation of ``matrix``, [w, x, y, z], if it is known to be rigid."""
    visible: bool = True
    opacity: float = 1.0
    draws: list[dict[str, Any]] = field(default_factory=list)
    X_parent_frame: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    """Rigid, (4, 4): from this node's coordinate frame to that of its parent."""
    frame_quaternion: list[float] = field(default_factory=lambda: [1.0, 0.0, 0.0, 0.0])
    """Rotation of ``X_parent_frame``, [w, x, y, z]."""
    stretch: NDArray[np.float64] = field(default_factory=lambda: IDENTITY)
    """S, (3, 3): from the node to its coordinate frame."""
    is_hidden: bool = False
    """True if the node or an ancestor is not visible."""
    total_opacity: float = 1.0
    """Product of the opacities of the node and its ancestors."""
    geometry: NodeGeometry = NO_GEOMETRY
    """Geometry of the last change."""

    def walk(self) -> Iterator[_Node]:
        """Iterate over this node and its descendants, parents first."""
        stack = [self]
        while stack:
            node = stack.pop()
            yield node
            stack.extend(node.children.values())


class SceneMirror:
    """A copy of a gateway's scene."""

    def __init__(self) -> None:
        self._root = _Node(0, ROOT_FRAME, None)
        self._nodes: dict[int, _Node] = {0: self._root}
        self._meshes: dict[int, MirrorMesh] = {}
        self._joints = Joints()
        self._rig: dict[str, Any] | None = None
        """Header of the newest frame of the view with the stereo camera's pose."""
        self._rig_changed = False
        self._time_ns = 0
        """Time from which the newest update is valid."""
        self.warnings: dict[str, str] = {}
        """Sentences about nodes that are left out, by ``frame_id``."""

    def reconnect(self) -> None:
        """Prepare for the frames of a new view connection. Its first update removes all nodes that it does not have."""
        self._meshes.clear()
        self._joints = Joints()

    def apply(self, view_frame: ViewFrame, now_ns: int) -> SceneChange | None:
        """Apply a frame of the view; return the change of the scene, None if nothing can be seen of it yet.

        ``now_ns``: time of a change that has none of its own, nanoseconds since the epoch. Raises ViewFrameError.
        """
        header = view_frame.header
        try:
            match header.get("kind"):
                case "mesh":
                    self._meshes[header["id"]] = read_mesh(view_frame)
                case "forget":
                    for mesh_id in header["meshes"]:
                        self._meshes.pop(mesh_id, None)
                case "rig":
                    self._rig = header if header["pose"] is not None else None
                    self._rig_changed = True
                case "controls":
                    if self._joints.apply(header):
                        return SceneChange(now_ns, joints=self._joints.values)
                case "update":
                    return self._update(view_frame, now_ns)
        except ViewFrameError:
            raise
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise ViewFrameError(f"a frame {header.get('kind')!r} of the view is invalid: {error!r}") from None
        return None

    def whole(self) -> SceneChange:
        """Return the whole scene, with the time of its newest update: a later one would hide the next change."""
        nodes = list(self._root.walk())
        shapes = [(node.frame_id, node.geometry.primitives) for node in nodes if node.geometry.primitives]
        # As many primitives as before: readers that have the scene already delete nothing.
        return SceneChange(
            self._time_ns,
            [*map(_transform_of, nodes), *self._rig_transforms()],
            [Entity(frame_id, primitives, earlier_primitive_count=len(primitives)) for frame_id, primitives in shapes],
            [node.geometry.cloud for node in nodes if node.geometry.cloud is not None],
            self._joints.values,
        )

    def _update(self, view_frame: ViewFrame, now_ns: int) -> SceneChange:
        header = view_frame.header
        is_whole_scene = header["from"] == 0
        removed: list[_Node] = []
        if is_whole_scene:
            removed += self._root.walk()
            self._root = _Node(0, ROOT_FRAME, None)
            self._nodes = {0: self._root}
        for node_id in header.get("removed", ()):
            removed += self._remove(node_id)
        # Ordered sets of nodes whose transforms and whose geometry must be sent.
        moved: dict[_Node, None] = {self._root: None} if is_whole_scene else {}
        redrawn: dict[_Node, None] = {}
        for fields in header.get("nodes", ()):
            redrawn[self._edit_node(fields)] = None
        for node_id, matrix, quaternion in read_transforms(view_frame):
            node = self._nodes[node_id]
            node.matrix = matrix
            node.quaternion = quaternion
            moved[node] = None
        for node in {**redrawn, **moved}:  # a copy: _update_subtree adds to both
            self._update_subtree(node, moved, redrawn)
        entities, clouds = self._changed_geometry(redrawn, {node.frame_id: node for node in removed})
        transforms = [_transform_of(node) for node in moved]
        if self._rig_changed:
            transforms += self._rig_transforms()
            self._rig_changed = False
        self._time_ns = header.get("timestamp") or now_ns
        return SceneChange(self._time_ns, transforms, entities, clouds)

    def _edit_node(self, fields: dict[str, Any]) -> _Node:
        """Add or change a node. The id of a node is that of its path, so that its parent never changes."""
        node_id = fields["id"]
        if node_id not in self._nodes:
            parent = self._nodes[fields["parent"]]
            node = _Node(node_id, f"{parent.frame_id}/{_frame_element(fields['name'])}", parent)
            self._nodes[node_id] = parent.children[node_id] = node
        node = self._nodes[node_id]
        node.visible = fields.get("visible", node.visible)
        node.opacity = fields.get("opacity", node.opacity)
        if "parts" in fields:
            node.draws = [draw for part in fields["parts"] or () for draw in part["draws"]]
        return node

    def _remove(self, node_id: int) -> list[_Node]:
        """Remove a node and its descendants; return them."""
        top = self._nodes.get(node_id)
        if top is None or top.parent is None:
            return []
        del top.parent.children[node_id]
        removed = list(top.walk())
        for node in removed:
            self._nodes.pop(node.id, None)
        return removed

    def _update_subtree(self, top: _Node, moved: dict[_Node, None], redrawn: dict[_Node, None]) -> None:
        """Compute X_parent_frame, stretch, visibility and opacity of a node, and of its descendants if these change.

        Adds each of these nodes to ``moved``, and those with another stretch, visibility or opacity to ``redrawn``.
        """
        stack = [top]
        while stack:
            node = stack.pop()
            parent = node.parent
            parent_stretch = IDENTITY if parent is None else parent.stretch
            if parent_stretch is IDENTITY and node.quaternion is not None:  # five times as fast as split_rigid
                stretch = IDENTITY
                node.X_parent_frame = node.matrix
                node.frame_quaternion = node.quaternion
            else:
                node.X_parent_frame, stretch = split_rigid(parent_stretch, node.matrix)
                node.frame_quaternion = quaternion_of(node.X_parent_frame)
            is_hidden = not node.visible or (parent is not None and parent.is_hidden)
            total_opacity = node.opacity * (1.0 if parent is None else parent.total_opacity)
            is_same_look = is_hidden == node.is_hidden and total_opacity == node.total_opacity
            is_same_stretch = stretch is node.stretch or np.array_equal(stretch, node.stretch)
            moved[node] = None
            node.stretch = stretch
            node.is_hidden = is_hidden
            node.total_opacity = total_opacity
            if not (is_same_look and is_same_stretch):
                redrawn[node] = None
                stack.extend(node.children.values())

    def _changed_geometry(
        self, redrawn: dict[_Node, None], removed_by_frame: dict[str, _Node]
    ) -> tuple[list[Entity], list[Cloud]]:
        """Return the geometry of nodes that has changed.

        ``removed_by_frame``: removed nodes by ``frame_id``; those that have been added again are taken out.
        """
        entities: list[Entity] = []
        clouds: list[Cloud] = []
        changes: list[tuple[str, NodeGeometry, NodeGeometry]] = []
        for node in redrawn:
            before = removed_by_frame.pop(node.frame_id, node)  # a removed node of this frame, or itself
            old = before.geometry
            node.geometry = self._geometry(node)
            changes.append((node.frame_id, old, node.geometry))
        changes += [(frame_id, node.geometry, NO_GEOMETRY) for frame_id, node in removed_by_frame.items()]
        for frame_id, old, new in changes:
            if old.primitives or new.primitives:
                entities.append(Entity(frame_id, new.primitives, earlier_primitive_count=len(old.primitives)))
            if old.cloud is not None or new.cloud is not None:
                clouds.append(new.cloud or Cloud(frame_id, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)))
        return entities, clouds

    def _geometry(self, node: _Node) -> NodeGeometry:
        """Return the geometry of a node; none if it is hidden or too large."""
        self.warnings.pop(node.frame_id, None)
        if node.is_hidden:
            return NO_GEOMETRY
        geometry = node_geometry(node.frame_id, node.draws, self._meshes, node.stretch, node.total_opacity)
        count = sum(len(each.points) for each in geometry.primitives)
        if count <= MAX_NODE_POINTS:
            return geometry
        if len(self.warnings) < MAX_WARNINGS:
            points = f"{count} points, the limit is {MAX_NODE_POINTS}"
            self.warnings[node.frame_id] = f"{node.frame_id} is left out: its triangles and lines have {points}"
        return NodeGeometry(cloud=geometry.cloud)

    def _rig_transforms(self) -> list[FrameTransform]:
        if self._rig is None:
            return []
        X_world_left = np.asarray(self._rig["pose"], np.float64).reshape(4, 4).T
        left = FrameTransform(WORLD, LEFT_FRAME, X_world_left[:3, 3].tolist(), quaternion_of(X_world_left))
        right = FrameTransform(LEFT_FRAME, RIGHT_FRAME, (self._rig["baseline"], 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        return [left, right]


def _transform_of(node: _Node) -> FrameTransform:
    parent = WORLD if node.parent is None else node.parent.frame_id
    return FrameTransform(parent, node.frame_id, node.X_parent_frame[:3, 3].tolist(), node.frame_quaternion)


def _frame_element(name: str | int) -> str:
    """Escape an element of a node's path for a ``frame_id``, so that different paths have different ids."""
    if isinstance(name, int):
        return f"#{name}"
    return name.replace("%", "%25").replace("/", "%2F").replace("#", "%23")
