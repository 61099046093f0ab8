"""Motion of a scene's nodes for a glTF file: a tree with all nodes that there were, and channels of those that move.

glTF animates the translation, rotation and scale of nodes. A node that is hidden or deleted for a while has the scale 0
meanwhile: by the specification (3.11), readers then do not draw it. Geometry and opacity cannot change.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf.export.exporter import AnimatedNode, Channel, GlbWriter
from gateway.files.gltf.export.glb_document import MAX_BYTES, is_writable
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Node, Path, changes
from gateway.scene.tree.sampling import FileTooLargeError
from gateway.scene.tree.transforms import IDENTITY, Matrix, quaternions_of

KEY_BYTES: Final = 100
"""Memory of a key."""
_EPSILON: Final = 1e-6
"""Maximum difference of axes from a rotation with a scale."""


_LEFT_OUT: Final = {
    "geometry": "glTF animates no geometry: the file has the first geometry",
    "opacity": "glTF animates no opacity: the file has the first opacity",
    "shear": "glTF animates no shear: the file is without the shear",
}


@dataclass(slots=True, eq=False)
class Track:
    """States of a node over time."""

    node: Node
    """The node in the tree with all nodes that there were, as it was first."""
    states: dict[int, tuple[Matrix, bool]] = field(default_factory=dict)
    """Transform, and True if the node is shown, by the number of the sample at which they change, ascending."""

    @property
    def last_matrix(self) -> Matrix:
        """The last transform."""
        return next(reversed(self.states.values()))[0] if self.states else IDENTITY


class MotionWriter:
    """Writes states of a scene as a ``.glb`` file with one animation: a ``SectionWriter``.

    The nodes are stored as they are when they are first shown. ``asset.extras.warnings`` has sentences about changes
    that the file does not have.
    """

    def __init__(self, max_bytes: int = MAX_BYTES) -> None:
        """
        Args:
            max_bytes: Maximum size of the file's binary part, and of the keys of all nodes.
        """
        self._max_bytes = max_bytes
        self._start: int | None = None
        self._key_count = 0
        self._last: Node | None = None
        self._tracks: dict[Path, Track] = {}
        """Tracks of all nodes that there were, parents before children."""
        self._times: list[float] = []
        """Times of the samples, seconds since the first one."""
        self._left_out: dict[str, dict[Path, None]] = {kind: {} for kind in _LEFT_OUT}
        """Paths of nodes with changes that the file does not have."""

    def add(self, time: int, snapshot: Snapshot) -> None:
        """Append a state. The animation begins at the time of the first one, nanoseconds since the epoch.

        Raises:
            FileTooLargeError: The file would be larger than ``max_bytes``.
        """
        root, sample = snapshot.root, len(self._times)
        self._start = time if self._start is None else self._start
        self._times.append((time - self._start) / 1e9)
        if self._last is None:
            self._last = Node()
            self._set(sample, (), root)
        for change in changes(self._last, root):
            if change.node is None:
                self._hide(sample, change.path)
            elif change.kind in ("geometry", "opacity"):
                self._note_change(change.kind, change.path, change.node)
            elif change.kind != "reordered":
                self._set(sample, change.path, change.node)
        self._last = root
        if KEY_BYTES * self._key_count > self._max_bytes:
            raise FileTooLargeError(
                f"the motion as .glb needs more than {self._max_bytes} bytes: take a shorter time, or a lower rate"
            )

    def _set(self, sample: int, path: Path, node: Node) -> None:
        """Append the transform and the visibility of a node, which may be new."""
        track = self._tracks.get(path)
        if track is None:
            track = self._tracks[path] = Track(Node(node.parts))
            track.node.opacity = node.opacity
            if path:
                self._tracks[path[:-1]].node.children[path[-1]] = track.node
            if sample:
                track.states[0] = node.matrix if is_writable(node.matrix) else IDENTITY, False
        else:  # it was deleted before
            if node.parts is not track.node.parts:
                self._note_change("geometry", path, node)
            if node.opacity != track.node.opacity:
                self._note_change("opacity", path, node)
        is_finite = is_writable(node.matrix)
        track.states[sample] = node.matrix if is_finite else track.last_matrix, is_finite and node.visible
        self._key_count += 1

    def _hide(self, sample: int, path: Path) -> None:
        """Hide a node that was deleted, and its descendants: one that is added again may have others."""
        for below, _ in self._tracks[path].node.walk(path):
            track = self._tracks[below]
            track.states[sample] = track.last_matrix, False
            self._key_count += 1

    def _note_change(self, kind: str, path: Path, node: Node) -> None:
        first = self._tracks[path].node
        if kind == "geometry" and first.parts is None:
            first.parts = node.parts
        elif kind == "opacity" or node.parts is not first.parts:
            self._left_out[kind].setdefault(path)

    def finish(self, end: int) -> bytes:
        """Return the file. It needs at least one state.

        Raises:
            FileTooLargeError: The file would be larger than ``max_bytes``.
            ImageError: A texture cannot be decoded.
        """
        animated: list[AnimatedNode] = []
        for path, track in self._tracks.items():
            track.node.visible = any(shown for _, shown in track.states.values())
            is_moving = len(track.states) > 1
            first, channels, has_shear = _animate(track, self._times) if is_moving else ({}, (), False)
            if not channels:
                track.node.set_matrix(next(iter(track.states.values()))[0])
                continue
            animated.append(AnimatedNode(track.node, first, channels))
            if has_shear:
                self._left_out["shear"].setdefault(path)
        warnings = [
            f"{_LEFT_OUT[kind]} of {len(paths)} nodes, such as {'/'.join(map(str, next(iter(paths))))[:80]}"
            for kind, paths in self._left_out.items()
            if paths
        ]
        return GlbWriter(self._max_bytes, warnings).write(self._tracks[()].node, None, animated)


def _animate(track: Track, times: list[float]) -> tuple[dict[str, list[float]], tuple[Channel, ...], bool]:
    """Return what a node has when it is first shown, its channels, and True if a shear is left out.

    Viewers interpolate between keys. Where values stay the same for several samples and change then, the last of these
    samples is a key, too: the motion begins there, and not at the key before.
    """
    samples: list[int] = []
    states: list[tuple[Matrix, bool]] = []
    for sample, state in track.states.items():
        if samples and sample > samples[-1] + 1:
            samples.append(sample - 1)
            states.append(states[-1])
        samples.append(sample)
        states.append(state)
    translation, rotation, scale, has_shear = _decompose(np.array([matrix for matrix, _ in states]))
    shown = np.array([is_shown for _, is_shown in states])
    properties = {"translation": translation, "rotation": rotation, "scale": scale}
    first_shown = np.argmax(shown)
    first = {path: values[first_shown].tolist() for path, values in properties.items()}
    scale[~shown] = 0.0  # hides the node; also in ``properties``
    key_times = np.array(times, np.float32)[samples]
    channels: list[Channel] = []
    for path, values in properties.items():
        differs = np.append(True, (values[1:] != values[:-1]).any(axis=1))  # from the sample before
        is_step = path == "scale" and not shown.all()  # a node does not shrink while it disappears
        keys = differs if is_step else slice(None)
        if differs[1:].any():
            channels.append(Channel(path, key_times[keys], values[keys].astype(np.float32), is_step))
    return first, tuple(channels), has_shear


def _decompose(
    matrices: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], bool]:
    """Decompose transforms into translations, rotations and scales.

    Args:
        matrices: (N, 4, 4).

    Returns:
        translations, (N, 3); quaternions x, y, z, w, each nearer to the one before than its negative, (N, 4); scales,
        (N, 3); True if a matrix has a shear, which is left out.
    """
    axes = matrices[:, :3, :3]
    scale = np.linalg.norm(axes, axis=1)
    scale[:, 0] *= np.where(np.linalg.det(axes) < 0.0, -1.0, 1.0)
    rotations = axes / np.where(scale == 0.0, 1.0, scale)[:, None, :]
    rotations[(scale == 0.0).any(axis=1)] = np.eye(3)
    gram = np.swapaxes(rotations, 1, 2) @ rotations
    quaternions = np.roll(quaternions_of(rotations), -1, axis=1)
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(flips)[:, None]
    return matrices[:, :3, 3], quaternions, scale, bool((np.abs(gram - np.eye(3)) > _EPSILON).any())
