"""``NodeHandle``, which changes one path of the tree, and ``Batch``, which collects changes for one request.

Indexing a viewer, a batch or a node returns a ``NodeHandle``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from scenegate.messages.arguments import as_array, describe
from scenegate.messages.changes import Changes, Entry, Key, Path, path_of
from scenegate.messages.field_kinds import write_number
from scenegate.messages.geometry import Geometry, Transform
from scenegate.messages.wire import OK
from scenegate.tree.answer import Answer


class Sender(Protocol):
    """Sends changes: a viewer at once, a batch at the end of its block."""

    def send(self, changes: Changes) -> Answer:
        """Send changes and wait for the response, or collect them."""


class NodeHandle:
    """A path of the tree. Indexing gives the paths below: ``node["arm"][0]``, ``node["arm", 0]``, ``node["arm/x"]``."""

    __slots__ = ("_sender", "path")

    def __init__(self, sender: Sender, path: Path) -> None:
        self._sender = sender
        self.path = path

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {'/'.join(map(str, self.path)) or '/'} of {self._sender!r}>"

    def __getitem__(self, key: Key) -> NodeHandle:
        return NodeHandle(self._sender, self.path + path_of(key))

    def set(self, *geometries: Geometry, transform: Transform | ArrayLike | None = None) -> Answer:
        """Replace the geometries of this path, and its transform if one is given. Paths below stay as they are."""
        for geometry in geometries:
            if not isinstance(geometry, Geometry):
                raise TypeError(f"set takes geometries such as Box((1, 1, 1)), not {describe(geometry)}")
        transform_body = None if transform is None else Transform.of(transform).body()
        return self._send_entry(Entry([geometry.body() for geometry in geometries], transform_body))

    def transform(self, value: Transform | ArrayLike) -> Answer:
        """Replace X_parent_node: a ``Transform``, (4, 4), three numbers (a translation in metres), or seven.

        Seven numbers are a pose: x, y, z in metres, and the quaternion w, x, y, z.
        """
        return self._send_entry(Entry(transform=Transform.of(value).body()))

    def set_visible(self, visible: bool) -> Answer:
        """Show or hide this path and everything below it, in the browser and in images."""
        if not isinstance(visible, (bool, np.bool_)):
            raise TypeError(f"visible must be True or False, not {describe(visible)}")
        return self._send_entry(Entry(visible=bool(visible)))

    def set_opacity(self, opacity: float) -> Answer:
        """Set the opacity of this path, 0 to 1: a factor of the alpha of everything at and below it."""
        number = write_number("opacity", opacity)
        if not 0.0 <= number <= 1.0:
            raise ValueError(f"opacity must be from 0 to 1, not {number:g}")
        return self._send_entry(Entry(opacity=number))

    def delete(self) -> Answer:
        """Delete this path and everything below it."""
        return self._sender.send(Changes().delete(self.path))

    def _send_entry(self, entry: Entry) -> Answer:
        return self._sender.send(Changes().set_entry(self.path, entry))


class Batch:
    """Collects changes for one request. Later changes of a path override earlier ones."""

    def __init__(self) -> None:
        self.changes = Changes()
        self.answer: Answer | None = None
        """Result of the request; None until the block has ended."""

    def __repr__(self) -> str:
        return f"<Batch of {len(self.changes.entries)} paths>"

    def __getitem__(self, key: Key) -> NodeHandle:
        return NodeHandle(self, path_of(key))

    def send(self, changes: Changes) -> Answer:
        """Add changes to the batch. The result is a placeholder: the viewer has not received them yet."""
        self.changes.add(changes)
        return Answer(OK)

    def set_transforms(self, paths: Iterable[Key], poses: ArrayLike) -> Answer:
        """See ``TreeViewer.set_transforms``."""
        return self.send(transforms_of(paths, poses))


def transforms_of(paths: Iterable[Key], poses: ArrayLike) -> Changes:
    """Return the changes that replace the transforms of many paths; see ``TreeViewer.set_transforms``."""
    if isinstance(paths, str):
        raise TypeError(
            f"paths must be a list of paths, not {describe(paths)}; for one path use set_transforms([path], ...)"
        )
    node_paths = [path_of(path) for path in paths]
    wanted = f"poses must have shape ({len(node_paths)}, 7) for {len(node_paths)} paths"
    array = as_array(poses, wanted, np.float64)
    if not node_paths and array.size == 0:  # [] has the shape (0,)
        array = array.reshape(0, 7)
    if array.shape != (len(node_paths), 7):
        raise ValueError(f"{wanted}, not {array.shape}")
    is_finite, has_rotation = np.isfinite(array).all(axis=1), array[:, 3:].any(axis=1)
    if not is_finite.all():
        raise ValueError(f"pose {is_finite.argmin()} is not finite")
    if not has_rotation.all():
        raise ValueError(f"pose {has_rotation.argmin()} has a quaternion of zeros")
    changes = Changes()
    for path, row in zip(node_paths, array.tolist(), strict=True):  # bodies as of Transform, for many at once
        changes.set_entry(path, Entry(transform={"translation": row[:3], "quaternion": row[3:]}))
    return changes
