"""Snapshots of the tree to frames: what a browser at one revision needs to be at another, encoded once for all.

A browser holds nodes by id and meshes by id. ``update`` names what changed between the snapshot that a browser has and
the newest one; since trees share what did not change, that costs what changed. Browsers that are at the same revision
share the bytes; one that skipped revisions gets a frame of its own that leads it to the newest state directly.
"""

from __future__ import annotations

import asyncio
from array import array
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final

import msgspec
import numpy as np

from gateway.scene.geometry import Part, PointCloud
from gateway.scene.live import Snapshot
from gateway.scene.meshing import MeshPart, meshes_of
from gateway.scene.tree import Change, Node, Path, changes
from gateway.viewer.frames import FrameBuilder, fragment
from gateway.viewer.payloads import Payloads
from gateway.viewer.sources import Rig
from gateway.viewer.tree_diff import Mirror, Step
from renderers.color import srgb_from_linear
from renderers.drawlist import AlphaMode, Material

EMPTY: Final = Snapshot(Node(), 0)
"""What a browser has before the first frame."""
TURN_CHANGES: Final = 40
"""Changed nodes that are encoded before others have their turn: 40 take about 1.5 ms."""
_IDENTITY: Final = np.eye(4)
KEPT_UPDATES: Final = 8
"""Encoded updates kept for browsers at other revisions; most of them are at the newest two or three."""


@dataclass(frozen=True, slots=True, eq=False)
class Update:
    """The way from one revision to another."""

    frame: bytes
    """Structure and poses."""
    meshes: frozenset[int]
    """Ids of meshes that the frame uses."""


_USELESS: Final = Update(b"", frozenset())


class Encoder:
    """Not thread-safe: lives on the event loop. ``advance`` to a snapshot, then ask for updates to it.

    When clients have used ``max_paths`` different paths, all numbers are given anew and browsers start over
    (``epoch``).
    """

    def __init__(self, payloads: Payloads, max_paths: int = 1_000_000) -> None:
        self._payloads = payloads
        self._max_paths = max_paths
        self._mirror = Mirror(EMPTY.root)
        self.current = EMPTY
        self.epoch = 0
        """A browser whose updates are of another epoch has to start from EMPTY."""
        self._updates: OrderedDict[tuple[int, int], Update] = OrderedDict()
        self._turns = asyncio.Lock()
        """Browsers that come at the same time share what the first one had encoded."""

    def advance(self, snapshot: Snapshot) -> None:
        """Makes ``snapshot`` the one that updates lead to."""
        if snapshot.revision == self.current.revision:
            return
        self._mirror.follow(self.current.revision, snapshot)
        if len(self._mirror) > self._max_paths:
            self.epoch += 1
            self._mirror = Mirror(snapshot.root)
            self._updates.clear()
        self.current = snapshot

    def id_of(self, path: Path) -> int | None:
        """The number of a path, or None when no node was ever there."""
        return self._mirror.id_of(path)

    async def update(self, have: Snapshot) -> tuple[Update, Snapshot]:
        """What leads a browser from ``have`` on; ``have`` is EMPTY for a new browser.

        Others have their turn in between: a scene of 50,000 nodes takes two seconds.

        Returns:
            The update, and the snapshot that it leads to, which is not the current one when that changed meanwhile.
            When ``epoch`` changed meanwhile, the update is of no use.
        """
        async with self._turns:
            target, epoch = self.current, self.epoch
            key = (have.revision, target.revision)
            found = self._updates.get(key)
            if found is None:
                for found in self._encode(have, target):
                    if found is None:
                        await asyncio.sleep(0)
                    if self.epoch != epoch:
                        return _USELESS, target
                assert found is not None
                self._keep(key, found)
            return found, target

    def _keep(self, key: tuple[int, int], update: Update) -> None:
        self._updates[key] = update
        while len(self._updates) > KEPT_UPDATES:
            self._updates.popitem(last=False)

    def _encode(self, have: Snapshot, target: Snapshot) -> Iterator[Update | None]:
        """None whenever others may have their turn, then the update. ``target`` is current when this begins."""
        builder = FrameBuilder()
        header: dict[str, Any] = {"kind": "update", "from": have.revision, "revision": target.revision}
        meshes: set[int] = set()
        step = self._mirror.since(have.revision) if have is not EMPTY else None
        if step is not None:
            self._encode_step(step, builder, header, meshes)
            yield Update(builder.finish(header), frozenset(meshes))
            return
        whole: list[msgspec.Raw] = []
        nodes: dict[int, dict[str, Any]] = {}
        removed: list[int] = []
        posed: list[tuple[int, Node]] = []
        for count, change in enumerate(changes(have.root, target.root), 1):
            if count % TURN_CHANGES == 0:
                yield None
            if change.node is None:
                removed.append(self._id(change.path))
                continue
            self._encode_change(change, change.node, nodes, posed, meshes)
            if have is EMPTY:  # then nothing comes a second time, and the whole need not be encoded at once
                whole += map(fragment, nodes.values())
                nodes.clear()
        if removed:
            header["removed"] = removed
        if nodes or whole:
            header["nodes"] = whole or list(nodes.values())
        _encode_poses(builder, header, posed)
        yield Update(builder.finish(header), frozenset(meshes))

    def _encode_step(self, step: Step, builder: FrameBuilder, header: dict[str, Any], meshes: set[int]) -> None:
        known = self._mirror.nodes
        entries: dict[int, dict[str, Any]] = {}
        for number in step.reshaped:
            entries[number] = {"id": number, "parts": self._parts(known[number], meshes)}
        for number in step.shown:
            entries.setdefault(number, {"id": number})["visible"] = known[number].visible
        if entries:
            header["nodes"] = list(entries.values())
        _encode_poses(builder, header, [(number, known[number]) for number in step.posed])

    def _parts(self, node: Node, meshes: set[int]) -> list[dict[str, Any]] | None:
        return None if node.parts is None else [self._part(part, meshes) for part in node.parts]

    def _id(self, path: Path) -> int:
        number = self._mirror.id_of(path)
        assert number is not None, "every path of a snapshot that was advanced to has a number"
        return number

    def _encode_change(
        self,
        change: Change,
        node: Node,
        nodes: dict[int, dict[str, Any]],
        posed: list[tuple[int, Node]],
        meshes: set[int],
    ) -> None:
        number = self._id(change.path)
        if change.kind == "transform":
            posed.append((number, node))
            return
        entry = nodes.setdefault(number, {"id": number})
        if change.kind == "added":
            posed.append((number, node))
            entry["parent"] = self._id(change.path[:-1])
            entry["name"] = change.path[-1]
        if change.kind == "visible" or (change.kind == "added" and not node.visible):
            entry["visible"] = node.visible
        if change.kind == "geometry" or (change.kind == "added" and node.parts is not None):
            entry["parts"] = self._parts(node, meshes)

    def _part(self, part: Part, meshes: set[int]) -> dict[str, Any]:
        draws: list[dict[str, Any]] = []
        for draw in meshes_of(part.shape, part.material):
            number = self._payloads.mesh_id(draw[0])
            meshes.add(number)
            draws.append(self._draw(number, draw, part))
        result: dict[str, Any] = {"kind": part.kind or type(part.shape).__name__.lower(), "draws": draws}
        if isinstance(part.shape, PointCloud):
            result["points"] = len(part.shape.points)
            result["channels"] = self._channels(part.shape, draws)
        if part.source:
            result["source"] = part.source
        return result

    def _channels(self, cloud: PointCloud, draws: list[dict[str, Any]]) -> dict[str, int]:
        """Columns of each channel that has a row for every point."""
        for draw in draws:
            self._payloads.note_cloud(draw["mesh"], cloud)
        count = len(cloud.points)
        return {
            name: values.size // count
            for name, values in cloud.channels.items()
            if count and values.ndim <= 2 and len(values) == count and values.size
        }

    def _draw(self, number: int, draw: MeshPart, part: Part) -> dict[str, Any]:
        _, material, X_part_mesh = draw
        matrix = part.X_node_part @ X_part_mesh
        result: dict[str, Any] = {"mesh": number, "material": self._material(material)}
        if not np.array_equal(matrix, _IDENTITY):
            # Non-finite numbers are no JSON; the renderer leaves such a part out, and so does the page.
            result["matrix"] = matrix.T.ravel().tolist() if np.isfinite(matrix).all() else None
        return result

    def _material(self, material: Material) -> dict[str, Any]:
        result: dict[str, Any] = {"color": [*map(srgb_from_linear, material.base_color[:3]), material.base_color[3]]}
        if material.alpha_mode is not AlphaMode.OPAQUE:
            result["alpha"] = material.alpha_mode.value.lower()
        if material.alpha_mode is AlphaMode.MASK and material.alpha_cutoff != 0.5:
            result["cutoff"] = material.alpha_cutoff
        optional = (
            ("metallic", material.metallic, 0.0),
            ("roughness", material.roughness, 1.0),
            ("emissive", tuple(map(srgb_from_linear, material.emissive)), (0.0, 0.0, 0.0)),
            ("doubleSided", material.double_sided, False),
            ("unlit", material.unlit, False),
            ("pointSize", material.point_size, 1.0),
            ("lineWidth", material.line_width, 1.0),
        )
        result.update({name: value for name, value, default in optional if value != default})
        if material.base_color_texture is not None:
            texture = material.base_color_texture
            result["texture"] = {
                "image": self._payloads.image_id(texture.image),
                "wrap": [texture.sampler.wrap_s.value, texture.sampler.wrap_t.value],
                "linear": texture.sampler.mag_linear,
            }
            if texture.uv_set:
                result["texture"]["set"] = texture.uv_set
            if texture.uv_transform is not None:
                result["texture"]["transform"] = texture.uv_transform
        return result


def _encode_poses(builder: FrameBuilder, header: dict[str, Any], posed: list[tuple[int, Node]]) -> None:
    """Rigid poses as 7 floats, other transforms as matrices; ids as u32 before them."""
    rigid = [(number, node.pose) for number, node in posed if node.pose is not None]
    affine = posed if not rigid else [(number, node) for number, node in posed if node.pose is None]
    if rigid:
        # array() is several times faster than numpy with tuples, and takes what is beyond float32 as infinite.
        header["poses"] = {
            "ids": builder.numbers(array("I", [number for number, _ in rigid])),
            "values": builder.numbers(array("f", chain.from_iterable([pose for _, pose in rigid]))),
        }
    if affine:
        with np.errstate(over="ignore"):
            values = np.array([node.matrix.T for _, node in affine], dtype=np.float64).astype(np.float32)
        header["matrices"] = {
            "ids": builder.numbers(array("I", [number for number, _ in affine])),
            "values": builder.array(values),
        }


def encode_status(status: dict[str, Any]) -> bytes:
    """A frame without body that shows the state of the gateway; plain JSON values."""
    return FrameBuilder().finish({"kind": "status", **status})


def encode_rig(rig: Rig | None) -> bytes:
    """A frame without body that tells where the stereo camera is."""
    if rig is None or not np.isfinite(rig.pose).all():
        return FrameBuilder().finish({"kind": "rig", "pose": None})
    described = {name: getattr(rig, name) for name in ("width", "height", "fx", "fy", "cx", "cy", "baseline")}
    return FrameBuilder().finish({"kind": "rig", "pose": rig.pose.T.ravel().tolist(), **described})
