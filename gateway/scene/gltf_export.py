"""The tree as one binary glTF 2.0 file (.glb): nodes named as in the tree, shared meshes, embedded textures.

The tree is Z-up and glTF Y-up, so everything hangs below a root that turns it by -90 degrees about X. Equal meshes,
materials and images (the same objects) are written once. Colours of clouds and triads, which the tree has as displays
show them, become linear, as glTF wants vertex colours (3.7.2.1); those of meshes are written as they are. Hidden
subtrees are left out; so are nodes whose transform is not finite, as JSON has no word for that.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import Surface
from gateway.scene.meshing import meshes_of
from gateway.scene.names import written
from gateway.scene.transforms import IDENTITY, Y_UP_TO_Z_UP, Matrix
from gateway.scene.tree import Node
from renderers.color import linear_colors_from_srgb
from renderers.drawlist import AlphaMode, Image, ImageError, Material, Mesh, Sampler, Texture, Topology
from renderers.encode import png_rgba

GENERATOR: Final = "Scenegate"
"""Not one of Drake's, so that our own reader takes the file as Y-up."""
MAX_BYTES: Final = 1 << 30
"""A .glb ends at 4 GB by its header; most readers give up much earlier."""

_MODES: Final = {Topology.POINTS: 0, Topology.LINES: 1, Topology.TRIANGLES: 4}
_FLOAT: Final = 5126
_UINT16: Final = 5123
_UINT32: Final = 5125
_VERTICES: Final = 34962
_INDICES: Final = 34963
_COMPONENTS: Final = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_MIN_FILTERS: Final = {(True, True): 9987, (True, False): 9729, (False, True): 9984, (False, False): 9728}
"""By (linear, mipmaps)."""
_UNLIT: Final = "KHR_materials_unlit"
_TRANSFORM: Final = "KHR_texture_transform"


class ExportError(ValueError):
    """The tree cannot be written; the message names the limit."""


def export_glb(root: Node, *, max_bytes: int = MAX_BYTES) -> bytes:
    """The tree as a .glb file.

    Args:
        root: a committed tree, Z up, metres.
        max_bytes: of the file's binary part.

    Raises:
        ExportError: the file would be larger than ``max_bytes``.
    """
    return _Writer(max_bytes).write(root)


class _Writer:
    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._chunks: list[bytes] = []
        self._nbytes = 0
        self._lists: dict[str, list[Any]] = {}
        self._known: dict[tuple[str, object], int | None] = {}
        self._alive: list[object] = []
        """Keeps what is known by its id."""
        self._primitives: list[dict[str, Any]] = []
        """Without a material."""
        self._extensions: set[str] = set()

    def write(self, root: Node) -> bytes:
        top = self._add("nodes", {"name": "Z up to Y up", "matrix": _column_major(Y_UP_TO_Z_UP.T)})
        self._nodes(root, self._lists["nodes"][top])
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": GENERATOR},
            "scene": 0,
            "scenes": [{"nodes": [top]}],
            **self._lists,
        }
        if self._extensions:
            document["extensionsUsed"] = sorted(self._extensions)
        if self._chunks:
            document["buffers"] = [{"byteLength": self._nbytes}]
        return _glb(document, self._chunks, self._nbytes)

    def _add(self, kind: str, value: dict[str, Any]) -> int:
        entries = self._lists.setdefault(kind, [])
        entries.append(value)
        return len(entries) - 1

    def _once(self, kind: str, source: object, make: Callable[[], int | None]) -> int | None:
        """What ``make`` gave for this object the first time."""
        key = (kind, id(source))
        if key not in self._known:
            self._known[key] = make()
            self._alive.append(source)
        return self._known[key]

    def _nodes(self, root: Node, top: dict[str, Any]) -> None:
        stack: list[tuple[str, Node, dict[str, Any]]] = [("", root, top)]
        while stack:
            name, node, parent = stack.pop()
            if not node.visible or not _writable(node.matrix):
                continue
            entry: dict[str, Any] = {"name": name} if name else {}
            if node.matrix is not IDENTITY and not np.array_equal(node.matrix, IDENTITY):
                entry["matrix"] = _column_major(node.matrix)
            index = self._add("nodes", entry)
            parent.setdefault("children", []).append(index)
            self._parts(node, entry)
            stack.extend((str(written(key)), child, entry) for key, child in reversed(node.children.items()))

    def _parts(self, node: Node, entry: dict[str, Any]) -> None:
        """The node's geometry: on the node itself where it needs no transform of its own, else below it."""
        for part in node.parts or ():
            for mesh, material, X_part_mesh in meshes_of(part.shape, part.material):
                with np.errstate(all="ignore"):
                    X = part.X_node_part @ X_part_mesh
                if not _writable(X):
                    continue
                index = self._mesh(mesh, material, linear=isinstance(part.shape, Surface))
                if index is None:
                    continue
                if "mesh" not in entry and np.array_equal(X, IDENTITY):
                    entry["mesh"] = index
                    continue
                child: dict[str, Any] = {"mesh": index}
                if not np.array_equal(X, IDENTITY):
                    child["matrix"] = _column_major(X)
                entry.setdefault("children", []).append(self._add("nodes", child))

    def _mesh(self, mesh: Mesh, material: Material, *, linear: bool) -> int | None:
        """A glTF mesh of one primitive; None when it draws nothing or is not finite.

        ``linear``: whether its vertex colours are linear already.
        """
        primitive = self._once("primitive", mesh, lambda: self._primitive(mesh, linear=linear))
        if primitive is None:
            return None
        key = ("mesh", (primitive, material))
        if key not in self._known:
            entry = dict(self._primitives[primitive])
            entry["material"] = self._material(material)
            self._known[key] = self._add("meshes", {"primitives": [entry]})
        return self._known[key]

    def _primitive(self, mesh: Mesh, *, linear: bool) -> int | None:
        if not mesh.elements.size or not np.isfinite(mesh.positions).all():
            return None
        colors = mesh.colors if linear or mesh.colors is None else linear_colors_from_srgb(mesh.colors)
        attributes = {"POSITION": self._accessor(mesh.positions, _VERTICES, bounds=True)}
        for name, array in (
            ("NORMAL", mesh.normals),
            ("TANGENT", mesh.tangents),
            ("TEXCOORD_0", mesh.uv0),
            ("TEXCOORD_1", mesh.uv1),
            ("COLOR_0", colors),
        ):
            if array is not None and np.isfinite(array).all():
                attributes[name] = self._accessor(array, _VERTICES)
        small = len(mesh.positions) < 0xFFFF
        indices = mesh.elements.ravel().astype(np.uint16 if small else np.uint32)
        self._primitives.append(
            {
                "attributes": attributes,
                "indices": self._accessor(indices[:, None], _INDICES),
                "mode": _MODES[mesh.topology],
            }
        )
        return len(self._primitives) - 1

    def _accessor(self, array: NDArray[Any], target: int, *, bounds: bool = False) -> int:
        view = self._view(np.ascontiguousarray(array).tobytes(), target)
        component = {"f": _FLOAT, "u": _UINT16 if array.dtype.itemsize == 2 else _UINT32}[array.dtype.kind]
        entry: dict[str, Any] = {
            "bufferView": view,
            "componentType": component,
            "count": len(array),
            "type": _COMPONENTS[array.shape[1]],
        }
        if bounds:
            entry["min"] = array.min(axis=0).astype(float).tolist()
            entry["max"] = array.max(axis=0).astype(float).tolist()
        return self._add("accessors", entry)

    def _view(self, data: bytes, target: int | None = None) -> int:
        offset = self._nbytes
        padding = -len(data) % 4
        self._nbytes += len(data) + padding
        if self._nbytes > self._max_bytes:
            raise ExportError(f"the scene as .glb is larger than {self._max_bytes} bytes")
        self._chunks.append(data)
        if padding:
            self._chunks.append(b"\0" * padding)
        entry = {"buffer": 0, "byteOffset": offset, "byteLength": len(data)}
        if target is not None:
            entry["target"] = target
        return self._add("bufferViews", entry)

    def _material(self, material: Material) -> int:
        key = ("material", material)
        if key not in self._known:
            self._known[key] = self._add("materials", self._material_entry(material))
        index = self._known[key]
        assert index is not None
        return index

    def _material_entry(self, material: Material) -> dict[str, Any]:
        metallic_roughness: dict[str, Any] = {
            "baseColorFactor": _units(material.base_color),
            "metallicFactor": _units((material.metallic,))[0],
            "roughnessFactor": _units((material.roughness,))[0],
        }
        self._put_texture(metallic_roughness, "baseColorTexture", material.base_color_texture)
        self._put_texture(metallic_roughness, "metallicRoughnessTexture", material.metallic_roughness_texture)
        entry: dict[str, Any] = {"pbrMetallicRoughness": metallic_roughness}
        self._put_texture(entry, "normalTexture", material.normal_texture, scale=material.normal_scale)
        self._put_texture(entry, "occlusionTexture", material.occlusion_texture, strength=material.occlusion_strength)
        self._put_texture(entry, "emissiveTexture", material.emissive_texture)
        if any(material.emissive):
            entry["emissiveFactor"] = _units(material.emissive)
        if material.alpha_mode is not AlphaMode.OPAQUE:
            entry["alphaMode"] = material.alpha_mode.value
        if material.alpha_mode is AlphaMode.MASK:
            entry["alphaCutoff"] = float(material.alpha_cutoff)
        if material.double_sided:
            entry["doubleSided"] = True
        if material.unlit:
            self._extensions.add(_UNLIT)
            entry["extensions"] = {_UNLIT: {}}
        return entry

    def _put_texture(self, entry: dict[str, Any], name: str, texture: Texture | None, **more: float) -> None:
        """A texture whose image cannot be decoded is left out."""
        if texture is None:
            return
        image = self._once("image", texture.image, lambda: self._image(texture.image))
        if image is None:
            return
        key = ("texture", (image, texture.sampler))
        if key not in self._known:
            sampler = self._sampler(texture.sampler)
            self._known[key] = self._add("textures", {"source": image, "sampler": sampler})
        info: dict[str, Any] = {"index": self._known[key]}
        if texture.uv_set:
            info["texCoord"] = texture.uv_set
        info.update({field: value for field, value in more.items() if value != 1.0 and math.isfinite(value)})
        if texture.uv_transform is not None:
            self._extensions.add(_TRANSFORM)
            info["extensions"] = {_TRANSFORM: _uv_transform(texture.uv_transform)}
        entry[name] = info

    def _image(self, image: Image) -> int | None:
        """The image's own file where it has one that glTF allows, else a PNG of its pixels."""
        data = getattr(image.decode, "data", None)
        kind = _media_type(bytes(data[:12])) if isinstance(data, bytes | memoryview) else None
        if kind is None:
            try:
                data, kind = png_rgba(image.decode()), "image/png"
            except ImageError:
                return None
        assert data is not None
        entry: dict[str, Any] = {"bufferView": self._view(bytes(data)), "mimeType": kind}
        if image.name:
            entry["name"] = image.name
        return self._add("images", entry)

    def _sampler(self, sampler: Sampler) -> int:
        key = ("sampler", sampler)
        if key not in self._known:
            self._known[key] = self._add(
                "samplers",
                {
                    "wrapS": sampler.wrap_s.value,
                    "wrapT": sampler.wrap_t.value,
                    "magFilter": 9729 if sampler.mag_linear else 9728,
                    "minFilter": _MIN_FILTERS[sampler.min_linear, sampler.mipmaps],
                },
            )
        index = self._known[key]
        assert index is not None
        return index


def _glb(document: dict[str, Any], chunks: list[bytes], nbytes: int) -> bytes:
    """GLB 2.0: a header, the JSON chunk padded with spaces, the binary chunk padded with zeros."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    parts = [struct.pack("<II", len(text), 0x4E4F534A), text]
    if chunks:
        parts += [struct.pack("<II", nbytes, 0x004E4942), *chunks]
    total = 12 + sum(map(len, parts))
    return b"".join((struct.pack("<4sII", b"glTF", 2, total), *parts))


def _column_major(matrix: Matrix) -> list[float]:
    return [float(value) for value in matrix.T.ravel()]


def _writable(matrix: Matrix) -> bool:
    """Whether readers can hold the matrix in float32."""
    return bool((np.abs(matrix) < 1e15).all())


def _units(values: Iterable[float]) -> list[float]:
    """Factors as the specification wants them, within 0 .. 1."""
    return [min(max(float(value), 0.0), 1.0) if math.isfinite(value) else 1.0 for value in values]


def _media_type(start: bytes) -> str | None:
    if start.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    return "image/jpeg" if start.startswith(b"\xff\xd8\xff") else None


def _uv_transform(values: tuple[float, float, float, float, float, float]) -> dict[str, Any]:
    """KHR_texture_transform's offset, rotation and scale from its matrix T R S (without shear, as it has none)."""
    a, b, c, d, e, f = values
    rotation = math.atan2(-d, a)
    return {
        "offset": [c, f],
        "rotation": rotation,
        "scale": [math.hypot(a, d), b * math.sin(rotation) + e * math.cos(rotation)],
    }
