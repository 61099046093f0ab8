"""Files of the test scenes, made from arrays: PNG textures, OBJ and glTF meshes. Needs only NumPy."""

import base64
import json
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

_PNG_COLOR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}
"""PNG's colour type by the number of channels."""


def png(pixels: np.ndarray) -> bytes:
    """Encode uint8 or uint16 pixels of shape (height, width, channels)."""
    height, width, channels = pixels.shape
    data = pixels.astype(f">u{pixels.itemsize}").reshape(height, -1).view(np.uint8)
    rows = np.zeros((height, 1 + data.shape[1]), np.uint8)  # a filter type of 0 before each row
    rows[:, 1:] = data

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8 * pixels.itemsize, _PNG_COLOR_TYPES[channels], 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9))
        + chunk(b"IEND", b"")
    )


def checkers(size: int, cell: int, dark: tuple[int, ...], light: tuple[int, ...]) -> np.ndarray:
    y, x = np.indices((size, size)) // cell
    return np.where(((x + y) % 2 == 0)[..., None], np.array(dark, np.uint8), np.array(light, np.uint8))


def gradient(size: int) -> np.ndarray:
    """RGB pixels: red grows to the right, green downwards, blue is 80."""
    y, x = np.indices((size, size)) * 255 // (size - 1)
    return np.stack([x, y, np.full_like(x, 80)], -1).astype(np.uint8)


def with_alpha(rgb: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    plane = np.broadcast_to(alpha, rgb.shape[:2])[..., None].astype(np.uint8)
    return np.concatenate([rgb, plane], -1)


class Gltf:
    """A glTF document that embeds everything, in glTF's frame (Y up), which Drake turns to Z up."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "materials": [],
            "accessors": [],
            "bufferViews": [],
            "buffers": [],
        }

    def texture(self, pixels: np.ndarray, sampler: dict[str, int] | None = None, **fields: Any) -> dict[str, Any]:
        self.use(*fields.get("extensions", ()))
        uri = "data:image/png;base64," + base64.b64encode(png(pixels)).decode()
        texture: dict[str, int] = {"source": self._add("images", {"uri": uri})}
        if sampler is not None:
            texture["sampler"] = self._add("samplers", sampler)
        return {"index": self._add("textures", texture), **fields}

    def material(self, **fields: Any) -> int:
        self.use(*fields.get("extensions", ()))
        return self._add("materials", fields)

    def matte(self, color: Sequence[float] | None = None, texture: dict[str, Any] | None = None, **fields: Any) -> int:
        """Add a material that is no metal."""
        pbr = {"metallicFactor": 0.0, "baseColorFactor": color, "baseColorTexture": texture}
        given = {name: value for name, value in pbr.items() if value is not None}
        return self.material(pbrMetallicRoughness=given, **fields)

    def mesh(self, attributes: dict[str, np.ndarray], indices: np.ndarray, material: int | None) -> int:
        references = {name: self._accessor(values.astype(np.float32)) for name, values in attributes.items()}
        primitive = {
            "attributes": references,
            "indices": self._accessor(indices.astype(np.min_scalar_type(max(indices.max(), 256))).reshape(-1, 1)),
            **({} if material is None else {"material": material}),
        }
        return self._add("meshes", {"primitives": [primitive]})

    def node(self, mesh: int, **fields: Any) -> None:
        self.document["scenes"][0]["nodes"].append(self._add("nodes", {"mesh": mesh, **fields}))

    def use(self, *extensions: str) -> None:
        for extension in extensions:
            self._add("extensionsUsed", extension)

    def write(self, path: Path) -> Path:
        path.write_text(json.dumps(self.document))
        return path

    def _add(self, array: str, entry: Any) -> int:
        entries: list[Any] = self.document.setdefault(array, [])
        entries.append(entry)
        return len(entries) - 1

    def _accessor(self, values: np.ndarray) -> int:
        data = values.tobytes()
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        buffer = self._add("buffers", {"byteLength": len(data), "uri": uri})
        view = self._add("bufferViews", {"buffer": buffer, "byteLength": len(data)})
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[values.shape[1]]
        component = {np.dtype(np.uint16): 5123, np.dtype(np.uint32): 5125}.get(values.dtype, 5126)
        entry = {"bufferView": view, "componentType": component, "count": len(values), "type": kind}
        if values.dtype == np.float32:
            entry |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        return self._add("accessors", entry)


def embedded(glb: Path) -> dict[str, Any]:
    """The document of a ``.glb`` file with its binary chunk as a data URI."""
    data = glb.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    document: dict[str, Any] = json.loads(data[20 : 20 + length])
    uri = "data:application/octet-stream;base64," + base64.b64encode(data[28 + length :]).decode()
    document["buffers"][0]["uri"] = uri
    return document


def quad(width: float = 0.6, height: float = 0.6, repeat: float = 1.0) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """A rectangle around the origin that faces +Z (in Drake's frame -Y); the texture is repeated along each side."""
    u, v = np.array([0.0, 1, 1, 0]), np.array([1.0, 1, 0, 0])
    positions = np.stack([(u - 0.5) * width, (0.5 - v) * height, np.zeros(4)], -1)
    attributes = {
        "POSITION": positions,
        "NORMAL": np.tile([0.0, 0, 1], (4, 1)),
        "TEXCOORD_0": np.stack([u, v], -1) * repeat,
    }
    return attributes, np.array([0, 1, 2, 0, 2, 3])


def sphere(radius: float = 0.3, rows: int = 24, columns: int = 48) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """A sphere around the origin with normals, tangents and texture coordinates."""
    v, u = (grid.ravel() for grid in np.mgrid[0 : 1 : (rows + 1) * 1j, 0 : 1 : (columns + 1) * 1j])
    longitude, latitude = 2 * np.pi * u, np.pi * (v - 0.5)
    normals = np.stack(
        [np.cos(latitude) * np.sin(longitude), -np.sin(latitude), np.cos(latitude) * np.cos(longitude)], -1
    )
    tangents = np.stack([np.cos(longitude), 0 * u, -np.sin(longitude), np.ones_like(u)], -1)
    y, x = (grid.ravel() for grid in np.mgrid[0:rows, 0:columns])
    a, b = y * (columns + 1) + x, (y + 1) * (columns + 1) + x
    indices = np.stack([a, b, a + 1, a + 1, b, b + 1], -1).ravel()
    attributes = {
        "POSITION": radius * normals,
        "NORMAL": normals,
        "TANGENT": tangents,
        "TEXCOORD_0": np.stack([u, v], -1),
    }
    return attributes, indices


def write_obj(path: Path, attributes: dict[str, np.ndarray], indices: np.ndarray, material: str) -> Path:
    """Write an OBJ file, and beside it an MTL file with one material named "painted"."""
    path.with_suffix(".mtl").write_text(f"newmtl painted\n{material}\n")
    lines = [f"mtllib {path.with_suffix('.mtl').name}"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in attributes["POSITION"]]
    lines += [f"vt {u:.6f} {1 - v:.6f}" for u, v in attributes["TEXCOORD_0"]]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in attributes["NORMAL"]]
    lines.append("usemtl painted")
    for triangle in indices.reshape(-1, 3) + 1:
        lines.append("f " + " ".join(f"{i}/{i}/{i}" for i in triangle))
    path.write_text("\n".join(lines) + "\n")
    return path
