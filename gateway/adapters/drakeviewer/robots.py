"""Links of rigid bodies, from the load and draw messages of one family."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import compress
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.config import Limits
from gateway.adapters.drakeviewer.link_paths import link_paths
from gateway.adapters.drakeviewer.shapes import read_geometries
from gateway.adapters.drakeviewer.wire import WORLD, Draw, Link, LinkKey, LinkNames
from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, Path, TreeEdit

ROOT: Final = "drake"
"""Name of the node of the live tree that contains everything from Drake."""
ILLUSTRATION: Final = "illustration"
PROXIMITY: Final = "proximity"
INERTIA: Final = "inertia"
HIDDEN: Final = frozenset((PROXIMITY, INERTIA))
"""Families that are hidden by default: their shapes enclose those of the illustration."""
HIDDEN_OPACITY: Final = 0.5
"""Opacity of families in ``HIDDEN``, as in Drake's own viewer."""
INERTIA_MARK: Final = "::InertiaVisualizer::"
"""Marks the names of links of Drake's ``InertiaVisualizer``, which publishes on the channels of the illustration."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedRobots:
    """The links of a load message as subtrees, without poses."""

    families: Mapping[str, Node]
    """Subtree of each family, to be placed at ``(ROOT, family)``."""
    paths: Mapping[LinkKey, Path]
    """Path of each link in the live tree."""
    warnings: tuple[str, ...]
    """Reasons why geometries are not shown."""


def read_robots(links: tuple[Link, ...], family: str, files: MeshFiles, limits: Limits) -> LoadedRobots:
    """Read the links of a load message, and the mesh files. Raises MessageError if a name has too many elements.

    ``family``: family of the channel; links of Drake's ``InertiaVisualizer`` belong to ``INERTIA``.
    """
    warnings: list[str] = []
    trees: dict[str, TreeEdit] = {family: TreeEdit(Node())}
    paths: dict[LinkKey, Path] = {}
    origins: dict[LinkKey, tuple[str, LinkKey]] = {}
    """Family of each link, and its key without the mark."""
    for link in links:
        robot, name = link.key
        _, mark, link_name = name.partition(INERTIA_MARK)
        origins[link.key] = (INERTIA, (robot, link_name)) if mark else (family, link.key)
    paths_by_family = {
        name: link_paths((key for own_family, key in origins.values() if own_family == name), limits)
        for name in (family, INERTIA)
    }
    for link in links:
        own_family, key = origins[link.key]
        path = paths_by_family[own_family][key]
        paths[link.key] = (ROOT, own_family, *path)
        tree = trees.setdefault(own_family, TreeEdit(Node()))
        tree.set_parts(path, read_geometries(link.geometries, files, limits, warnings))
    return LoadedRobots({name: tree.commit() for name, tree in trees.items()}, paths, tuple(warnings))


@dataclass(slots=True, eq=False)
class RobotChannels:
    """State of a family's load and draw channels, and their edits of the live tree."""

    family: str
    names: LinkNames | None = None
    """Links of the last draw message, for ``wire.decode_draw``."""
    draws: int = 0
    """Draw messages that were shown."""
    stale: int = 0
    """Draw messages that were ignored, because their links are not those that were loaded."""
    seconds: float = -math.inf
    """Time of the last draw message that was shown."""
    unloaded: int = 0
    """Draw messages that were ignored, because no load message was received."""
    _loaded: LoadedRobots | None = None
    """Content of the last load message."""
    _was_shown: bool = False
    """True if the loaded links were added to the live tree. A client of the tree viewer may have deleted them."""
    _paths: list[Path] = field(default_factory=list)
    """Paths of the links in ``names`` that are loaded."""
    _poses: NDArray[np.float64] | None = None
    """Poses of the last draw message that was shown, (N, 7) float64."""

    @property
    def links(self) -> int:
        """Number of links that are loaded."""
        return len(self._loaded.paths) if self._loaded is not None else 0

    def load(self, loaded: LoadedRobots, edit: TreeEdit) -> None:
        """Remove the links of earlier load messages. The new ones appear with their first poses."""
        families = {self.family, *(self._loaded.families if self._loaded is not None else ())}
        for family in families:
            clear_children(edit, (ROOT, family))
        self._loaded, self._was_shown = loaded, False
        self.names, self._paths, self._poses = None, [], None

    def draw(self, draw: Draw, edit: TreeEdit) -> str:
        """Move the links; return the reason why the message is ignored, or an empty string."""
        loaded = self._loaded
        if loaded is None:
            self.unloaded += 1
            return "no load message was received: start the simulation after the gateway, or let it publish again"
        if draw.names != self.names:
            self.names, self._poses = draw.names, None
            self._paths = [loaded.paths[key] for key in draw.names.keys if key in loaded.paths]
        is_shown = self._was_shown and _has_links(edit.root, loaded)
        has_only_loaded_links = len(self._paths) == len(draw.names.keys)
        # A first message needs all links; they are not counted again in later ones, which may move some.
        if not has_only_loaded_links or not (is_shown or len(set(draw.names.keys)) >= self._movable_count):
            self.stale += 1
            return f"its {len(draw.names.keys)} links are not the {self._movable_count} that are loaded"
        if not is_shown:
            for family, subtree in loaded.families.items():
                show_family(edit, family)
                for name, child in subtree.children.items():
                    edit.set_subtree((ROOT, family, name), child)
            self._was_shown, self._poses = True, None
        poses, last_poses = draw.poses, self._poses
        moved = np.ones(len(poses), np.bool_) if last_poses is None else (poses != last_poses).any(axis=1)
        edit.set_poses(list(compress(self._paths, moved.tolist())), map(tuple, poses[moved].tolist()))
        self._poses = poses
        self.draws += 1
        return ""

    @property
    def _movable_count(self) -> int:
        """Number of loaded links for which Drake sends poses."""
        return 0 if self._loaded is None else sum(key != WORLD for key in self._loaded.paths)


def _has_links(root: Node, loaded: LoadedRobots) -> bool:
    """Return False if links of a load message are missing in the live tree."""
    for family, subtree in loaded.families.items():
        node = root.find((ROOT, family))
        if node is None:
            return False
        for name, child in subtree.children.items():
            shown = node.children.get(name)
            if shown is None or shown.nodes_with_parts < child.nodes_with_parts:
                return False
    return True


def show_family(edit: TreeEdit, family: str) -> None:
    """Create the node of a family, with its default visibility. An existing node is not changed."""
    if edit.root.find((ROOT, family)) is None:
        edit.set_visible((ROOT, family), family not in HIDDEN)
        edit.set_opacity((ROOT, family), HIDDEN_OPACITY if family in HIDDEN else 1.0)


def clear_children(edit: TreeEdit, path: Path) -> None:
    """Delete the children of a node. The node keeps its visibility and opacity."""
    node = edit.root.find(path)
    for name in () if node is None else tuple(node.children):
        edit.delete((*path, name))


@dataclass(slots=True, eq=False)
class ShownParts:
    """What a channel whose messages replace each other has in the live tree: contacts, or deformable bodies."""

    paths: frozenset[Path] = frozenset()

    def replace(self, parts: Mapping[Path, tuple[Part, ...]], edit: TreeEdit) -> None:
        """Set the parts at their paths, and delete the paths that are not among them any more."""
        for path in self.paths - parts.keys():
            edit.delete(path)
        for path, parts_of_path in parts.items():
            edit.set_parts(path, parts_of_path)
        self.paths = frozenset(parts)
