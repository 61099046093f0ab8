"""Converts a tree to a draw list: instances with world matrices and labels, and lights, without hidden subtrees.

A tree changes little between two images. ``Flattener`` keeps the instances of every node, and makes new ones only for
nodes that were edited or moved. One NumPy call multiplies the matrices of a whole level of the tree, because calls for
single nodes would take longer than the arithmetic.
"""

import threading
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.materials import TEXTURE_FIELDS, faded
from gateway.scene.tree.nodes import Node, Path, PathElement
from gateway.scene.tree.transforms import IDENTITY, Matrix, from_poses
from renderers.drawlist import LABEL_NONE, DrawList, Image, Instance, Light, Material, Mesh, Texture
from renderers.light_rig import MAX_LIGHTS
from renderers.stop import check_stop

DRAWABLE: Final = 1e15
"""Limit on the numbers in a world matrix, metres. An instance with a number that is not finite, or not below this
limit, is left out: its float32 vertices would overflow in the renderer."""

LabelOf = Callable[[Path, Part], int]
"""Function that returns the label of a part at a path."""


class _Entry:
    """Cached instances of one node."""

    __slots__ = (
        "X_node_mesh",
        "X_world_node",
        "children",
        "first_index",
        "instances",
        "lights",
        "meshes",
        "node",
        "opacity",
        "path",
    )

    def __init__(self, path: Path) -> None:
        self.path = path
        self.node: Node | None = None
        """The node in the last tree; None for a new entry."""
        self.X_world_node: Matrix = IDENTITY
        """(4, 4) float64."""
        self.opacity = 1.0
        """Product of the opacities of the node and its ancestors."""
        self.children: dict[PathElement, _Entry] = {}
        """Entries of the children that are visible and have geometry below them."""
        self.meshes: list[tuple[Mesh, Material, int]] = []
        """Meshes of the node's parts, with their materials and labels."""
        self.X_node_mesh: NDArray[np.float64] | None = None
        """(len(meshes), 4, 4); None without meshes."""
        self.lights: list[tuple[Light, Matrix]] = []
        """Lights of the node's parts, with the transforms from their parts to the node."""
        self.instances: list[Instance] = []
        """Instances of the node itself: its meshes with drawable transforms."""
        self.first_index = 0
        """Index in the last draw list of the first instance of the node and its descendants."""


class _PendingUpdate(NamedTuple):
    """Entry that may differ from its node."""

    entry: _Entry
    node: Node
    X_world_parent: Matrix
    parent_opacity: float
    parent_changed: bool
    """True if ``X_world_parent`` or ``parent_opacity`` has changed."""


def flatten(root: Node, *, label_of: LabelOf | None = None) -> DrawList:
    """Return the draw list of a tree. ``label_of`` returns the label of each part; None: all are ``LABEL_NONE``."""
    return _TreeFlattener(label_of or (lambda path, part: LABEL_NONE)).flatten(root)


class Flattener:
    """Makes draw lists of a changing tree, with a label per path. Thread-safe.

    The ``instance_id`` of each instance is its index in the draw list. ``LabelTable.path_of`` returns the path of its
    label. Instances that did not change since the last call are the same objects. For an unchanged root, the draw list
    is the same object. Of the lights, only the first ``MAX_LIGHTS`` are in it.
    """

    def __init__(self, labels: LabelTable) -> None:
        self.labels = labels
        self._flattener = _TreeFlattener(lambda path, _part: labels.label_of(path))
        self._lock = threading.Lock()

    def flatten(self, snapshot: Snapshot) -> DrawList:
        """Return the draw list of a snapshot of the live tree."""
        with self._lock:
            return self._flattener.flatten(snapshot.root)

    def warning(self) -> str:
        """Return a sentence if the last tree has more than ``MAX_LIGHTS`` lights, else an empty string."""
        if not self._flattener.has_more_lights:
            return ""
        return f"the scene has more than {MAX_LIGHTS} lights, and only the first {MAX_LIGHTS} shine"


class _TreeFlattener:
    """Flattens a changing tree. Keeps an entry for each drawn node from one tree to the next. Not thread-safe."""

    def __init__(self, label_of: LabelOf) -> None:
        self._label_of = label_of
        self._root = _Entry(())
        self._last_tree: Node | None = None
        """Root of the tree of ``_last_draw_list``; None after an error."""
        self._last_draw_list = DrawList()
        self._materials_changed = False
        """True if the current call of ``flatten`` may have changed the set of materials: images are collected again."""
        self._order_changed = False
        """True if the current call may have changed the number of instances of a node, or its lights."""
        self._lit_entries: list[_Entry] = []
        """Entries with lights, in the order of the tree."""
        self.has_more_lights = False
        """The last tree has more than ``MAX_LIGHTS`` lights."""

    def flatten(self, tree: Node) -> DrawList:
        """Return the draw list of a tree, given its root."""
        if self._last_tree is tree:
            return self._last_draw_list
        self._materials_changed, self._order_changed = False, self._last_tree is None
        self._last_tree = None
        try:
            outdated = self._update_entries(tree if tree.visible else Node())
            self._make_instances(outdated)
            if self._order_changed:
                instances = self._all_instances()
            else:
                instances = list(self._last_draw_list.instances)
                for entry in outdated:
                    instances[entry.first_index : entry.first_index + len(entry.instances)] = entry.instances
        except BaseException:
            # The entries may be half-updated, so the next call must start with none.
            self._root = _Entry(())
            raise
        images = self._last_draw_list.images
        if self._materials_changed or self._order_changed:
            images = images_of(instance.material for instance in instances)
        lights = tuple(islice(self._lights(), MAX_LIGHTS + 1))
        self.has_more_lights = len(lights) > MAX_LIGHTS
        self._last_draw_list = DrawList(tuple(instances), images, lights[:MAX_LIGHTS])
        self._last_tree = tree
        return self._last_draw_list

    def _update_entries(self, tree: Node) -> list[_Entry]:
        """Update entries and world matrices level by level; return the entries whose instances are out of date."""
        outdated: list[_Entry] = []
        level = [_PendingUpdate(self._root, tree, IDENTITY, 1.0, parent_changed=False)]
        while level:
            moved_entries: list[_Entry] = []
            moved_nodes: list[Node] = []
            parent_matrices: list[Matrix] = []
            parents: list[tuple[_Entry, Node, bool]] = []
            """Entries that have children in this tree or the last one; True if their matrix or opacity has changed."""
            for entry, node, X_world_parent, parent_opacity, parent_changed in level:
                old_node = entry.node
                entry.node = node
                opacity = parent_opacity * node.opacity
                opacity_changed = opacity != entry.opacity
                entry.opacity = opacity
                parts_changed = opacity_changed or node.parts is not (None if old_node is None else old_node.parts)
                if parts_changed:
                    self._update_meshes(entry, node.parts or ())
                moved = parent_changed or old_node is None or not old_node.same_transform(node)
                if moved:
                    moved_entries.append(entry)
                    moved_nodes.append(node)
                    parent_matrices.append(X_world_parent)
                elif parts_changed:
                    outdated.append(entry)
                if node.children or entry.children:
                    parents.append((entry, node, moved or opacity_changed))
            if moved_entries:
                with np.errstate(all="ignore"):
                    world_matrices = np.matmul(np.array(parent_matrices), _local_matrices(moved_nodes))
                for entry, X_world_node in zip(moved_entries, world_matrices, strict=True):
                    entry.X_world_node = X_world_node
                outdated.extend(moved_entries)
            level = []
            for entry, node, changed in parents:
                self._add_children(entry, node, changed, next_level=level)
        return outdated

    def _update_meshes(self, entry: _Entry, parts: tuple[Part, ...]) -> None:
        self._materials_changed = True
        self._order_changed |= bool(entry.lights)
        entry.meshes, entry.lights = [], []
        matrices: list[Matrix] = []
        for part in parts:
            check_stop()
            if isinstance(part.shape, Light):  # it needs no label
                entry.lights.append((part.shape, part.X_node_part))
                self._order_changed = True
                continue
            label = self._label_of(entry.path, part)
            for mesh, material, X_part_mesh in meshes_of(part.shape, part.material):
                drawn_material = material if entry.opacity == 1.0 else faded(material, entry.opacity)
                entry.meshes.append((mesh, drawn_material, label))
                matrices.append(_product(part.X_node_part, X_part_mesh))
        entry.X_node_mesh = np.array(matrices) if matrices else None

    def _add_children(self, entry: _Entry, node: Node, changed: bool, next_level: list[_PendingUpdate]) -> None:
        """Append the children that need an update to ``next_level``, and drop the entries of removed children.

        ``changed``: the world matrix or the opacity of ``entry`` has.
        """
        drawn = {name: child for name, child in node.children.items() if child.visible and child.nodes_with_parts}
        if list(entry.children) != list(drawn):
            self._order_changed = True
            entry.children = {name: entry.children.get(name) or _Entry((*entry.path, name)) for name in drawn}
        for child_entry, child in zip(entry.children.values(), drawn.values(), strict=True):
            if changed or child_entry.node is not child:
                next_level.append(_PendingUpdate(child_entry, child, entry.X_world_node, entry.opacity, changed))

    def _make_instances(self, entries: list[_Entry]) -> None:
        """Create the instances of entries from their world matrices, with one matrix product for all of them."""
        for entry in entries:
            if entry.X_node_mesh is None and entry.instances:
                entry.instances, self._order_changed = [], True
        entries_with_meshes = [(entry, entry.X_node_mesh) for entry in entries if entry.X_node_mesh is not None]
        if not entries_with_meshes:
            return
        mesh_counts = [len(X_node_mesh) for _, X_node_mesh in entries_with_meshes]
        X_world_node = np.repeat([entry.X_world_node for entry, _ in entries_with_meshes], mesh_counts, axis=0)
        X_node_mesh = np.concatenate([X_node_mesh for _, X_node_mesh in entries_with_meshes])
        with np.errstate(all="ignore"):
            X_world_mesh = np.matmul(X_world_node, X_node_mesh)
            is_drawable = (np.abs(X_world_mesh) < DRAWABLE).all(axis=(1, 2)).tolist()
        mesh_index = 0
        for entry, _ in entries_with_meshes:
            instances: list[Instance] = []
            for mesh, material, label in entry.meshes:
                if is_drawable[mesh_index]:
                    # _all_instances renumbers the instances if first_index is out of date.
                    instance_id = entry.first_index + len(instances)
                    instances.append(Instance(mesh, material, X_world_mesh[mesh_index], label, instance_id))
                mesh_index += 1
            if len(instances) != len(entry.instances):
                self._order_changed = True
            entry.instances = instances

    def _all_instances(self) -> list[Instance]:
        """Return all instances in the order of the tree, with their index as ``instance_id``; collect lit entries."""
        result: list[Instance] = []
        self._lit_entries = []
        stack = [self._root]
        while stack:
            entry = stack.pop()
            index = entry.first_index = len(result)
            if entry.instances and entry.instances[0].instance_id != index:
                entry.instances = [
                    Instance(old.mesh, old.material, old.X_world_mesh, old.label, instance_id)
                    for instance_id, old in enumerate(entry.instances, index)
                ]
            result += entry.instances
            if entry.lights:
                self._lit_entries.append(entry)
            stack += reversed(entry.children.values())
        return result

    def _lights(self) -> Iterator[Light]:
        """Yield the lights of the tree in the world, in its order, without those that are too far away."""
        for entry in self._lit_entries:
            for light, X_node_light in entry.lights:
                with np.errstate(all="ignore"):
                    X_world_light = _product(entry.X_world_node, X_node_light)
                placed = light.placed(X_world_light) if (np.abs(X_world_light) < DRAWABLE).all() else None
                if placed is not None:
                    yield placed


def _product(X: Matrix, Y: Matrix) -> Matrix:
    """Return X @ Y, which is one of the two if the other ``is IDENTITY``."""
    if X is IDENTITY:
        return Y
    return X if Y is IDENTITY else X @ Y


def _local_matrices(nodes: list[Node]) -> NDArray[np.float64]:
    """Return X_parent_node of each node, (N, 4, 4). All poses are converted in one call."""
    posed = [index for index, node in enumerate(nodes) if node.pose is not None]
    if len(posed) < 8:  # one by one is faster then
        return np.array([node.matrix for node in nodes])
    matrices = np.empty((len(nodes), 4, 4))
    matrices[posed] = from_poses(np.array([nodes[index].pose for index in posed], dtype=np.float64))
    for index, node in enumerate(nodes):
        if node.pose is None:
            matrices[index] = node.matrix
    return matrices


def images_of(materials: Iterable[Material]) -> tuple[Image, ...]:
    """Return the different images of all materials, in the order of first use."""
    images: dict[Image, None] = {}
    for material in {id(material): material for material in materials}.values():  # by id: comparing values is slow
        textures: list[Texture | None] = [getattr(material, field) for field in TEXTURE_FIELDS]
        images |= {texture.image: None for texture in textures if texture is not None}
    return tuple(images)
