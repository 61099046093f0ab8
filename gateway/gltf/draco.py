"""Decompresses primitives of KHR_draco_mesh_compression, with the package DracoPy."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, Final

import DracoPy
import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.gltf import schema
from gateway.gltf.accessors import Accessor
from gateway.gltf.buffers import Buffer, Buffers
from gateway.gltf.draco_header import DracoError, element_counts
from gateway.gltf.errors import GltfError
from gateway.gltf.limits import GltfLimits
from renderers.stop import check_stop

EXTENSION: Final = "KHR_draco_mesh_compression"


def decompress(
    raw: msgspec.Raw,
    attributes: Mapping[str, Accessor],
    indices: Accessor | None,
    buffers: Buffers,
    limits: GltfLimits,
    name: str,
) -> tuple[dict[str, Accessor], Accessor]:
    """Return the attributes and the vertex indices of a primitive, whose elements are separate triangles.

    Args:
        raw: JSON text of the extension.
        attributes: Accessors by attribute. Their data is not read, except that of attributes that are not compressed.
        indices: Accessor of the vertex indices.
        name: Name of the extension in the document, for messages.

    Raises:
        GltfError: The data cannot be decompressed, or does not have what the accessors say.
    """
    try:
        source = msgspec.json.decode(raw, type=schema.DracoCompression)
    except msgspec.MsgspecError as error:
        raise GltfError(f"{name}: {error}") from error
    if buffers.merged_by_drake:
        raise GltfError(f"{name}: Drake's merge does not adapt the index of the buffer view")
    if source.buffer_view is None:
        raise GltfError(f"{name}.bufferView: missing")
    if indices is None:
        raise GltfError(f"{name}: the primitive has no indices")
    view = buffers.view(source.buffer_view, f"{name}.bufferView")
    data = bytes(memoryview(view.buffer.data)[view.offset : view.offset + view.length])
    vertex_count = attributes["POSITION"].count
    if vertex_count > limits.max_compressed_vertices:
        limit = limits.max_compressed_vertices
        raise GltfError(f"{name}: {vertex_count} vertices are more than max_compressed_vertices = {limit}")
    mesh = _decode(data, vertex_count, indices.count // 3, name)
    decompressed = dict(attributes)
    for attribute, unique_id in (source.attributes or {}).items():
        if attribute in attributes and unique_id is not None:
            accessor = attributes[attribute]
            values = _values(mesh, unique_id, (vertex_count, accessor.components), f"{name}.attributes.{attribute}")
            decompressed[attribute] = _accessor(accessor, values.astype(accessor.dtype))
    if decompressed["POSITION"] is attributes["POSITION"]:
        raise GltfError(f"{name}.attributes.POSITION: missing")
    return decompressed, _accessor(indices, mesh.faces.astype(np.uint32).reshape(-1, 1))


def _decode(data: bytes, vertex_count: int, triangle_count: int, name: str) -> Any:
    """Return the ``DracoPy.DracoMesh`` in ``data``, if it has no more vertices and triangles than the accessors."""
    check_stop()
    try:
        vertices, triangles = element_counts(data)
        if vertices > vertex_count or triangles > triangle_count:
            raise DracoError(
                f"{vertices} vertices and {triangles} triangles, but the accessors have {vertex_count} and "
                f"{triangle_count}"
            )
        mesh = DracoPy.decode(data)
    except (ValueError, DracoPy.FileTypeException) as error:
        raise GltfError(f"{name}: {error}") from error
    check_stop()
    return mesh


def _values(mesh: Any, unique_id: int, shape: tuple[int, int], path: str) -> NDArray[Any]:
    """Return an attribute of a decoded mesh, an array of ``shape``."""
    attribute = mesh.get_attribute_by_unique_id(unique_id)
    if attribute is None:
        raise GltfError(f"{path}: the mesh has no attribute with the id {unique_id}")
    values: NDArray[Any] = attribute["data"]
    if values.shape != shape:
        raise GltfError(f"{path}: {' x '.join(map(str, values.shape))} values instead of {shape[0]} x {shape[1]}")
    return values


def _accessor(described: Accessor, values: NDArray[Any]) -> Accessor:
    """Return an accessor of ``values``, (N, components), with the name of another one."""
    data = values.tobytes()
    return msgspec.structs.replace(
        described,
        dtype=values.dtype,
        count=len(values),
        buffer=Buffer(data, hashlib.sha256(data).digest()),
        offset=0,
        stride=values.dtype.itemsize * values.shape[1],
        sparse=None,
    )
