"""Decompresses primitives of KHR_draco_mesh_compression, with the package DracoPy in a child process."""

import hashlib
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf import schema
from gateway.files.gltf.accessors import Accessor
from gateway.files.gltf.buffers import Buffer, Buffers
from gateway.files.gltf.gltf_errors import GltfError, GltfLimits, as_warning
from gateway.files.gltf.parser import extension
from gateway.files.parsers.mesh_data import DecodedMesh
from gateway.runtime.workers.limited_process import ProcessFailed, ProcessLimits, call_limited

EXTENSION: Final = "KHR_draco_mesh_compression"
_DECODER_SECONDS: Final = 60
"""Maximum CPU time of the decoder for the meshes of a document: 10 million vertices take some seconds."""

_output_decoder: Final = msgspec.msgpack.Decoder(list[DecodedMesh | str])


class DracoMeshes:
    """Compressed primitives of one document. The first ``read`` decompresses all of them."""

    def __init__(self, document: schema.Document, buffers: Buffers, limits: GltfLimits) -> None:
        self._document = document
        self._buffers = buffers
        self._limits = limits
        self._decoded: dict[int, DecodedMesh | str] | None = None
        """Mesh, or the reason why there is none, by the index of the buffer view; None before the first ``read``."""

    def read(
        self, source: schema.DracoCompression, attributes: Mapping[str, Accessor], indices: Accessor | None, name: str
    ) -> tuple[dict[str, Accessor], Accessor]:
        """Return the attributes of a primitive, and its vertex indices, three for each triangle, decompressed.

        Their counts are those of the compressed mesh, as in other readers: some exporters leave the accessors as they
        were before the compression, which may add vertices. Raises GltfError if the data cannot be decompressed, or has
        not the attributes of the primitive.
        """
        if self._document.merged_by_drake:
            raise GltfError(f"{name}: Drake's merge does not adapt the index of the buffer view")
        if source.buffer_view is None:
            raise GltfError(f"{name}.bufferView: missing")
        if indices is None:
            raise GltfError(f"{name}: the primitive has no indices")
        self._buffers.view(source.buffer_view, f"{name}.bufferView")  # raises if there is none
        if self._decoded is None:
            self._decoded = self._decode_all()
        mesh = self._decoded[source.buffer_view]
        if isinstance(mesh, str):
            raise GltfError(f"{name}: {mesh}")
        decompressed = dict(attributes)
        for attribute, unique_id in (source.attributes or {}).items():
            if attribute in attributes and unique_id is not None:
                accessor = attributes[attribute]
                values = _attribute_values(mesh, unique_id, accessor.components, f"{name}.attributes.{attribute}")
                decompressed[attribute] = _accessor_of(accessor, values.astype(accessor.dtype))
        if decompressed["POSITION"] is attributes["POSITION"]:
            raise GltfError(f"{name}.attributes.POSITION: missing")
        return decompressed, _accessor_of(indices, np.frombuffer(mesh.triangles, "<u4").reshape(-1, 1))

    def _decode_all(self) -> dict[int, DecodedMesh | str]:
        """Decompress all primitives of the document; return the results by the index of their buffer view."""
        data_by_view: dict[int, bytes] = {}
        for mesh in self._document.meshes or ():
            for primitive in (mesh.primitives or ()) if isinstance(mesh, schema.GltfMesh) else ():
                if not isinstance(primitive, schema.GltfPrimitive):
                    continue
                with as_warning([], ""):  # ignored here: ``read`` raises the error again if the primitive is drawn
                    source = extension(primitive.extensions, EXTENSION, schema.DracoCompression, "", [])
                    index = source.buffer_view if source is not None else None
                    if index is not None and index not in data_by_view:
                        view = self._buffers.view(index, "")
                        data_by_view[index] = bytes(memoryview(view.buffer.data)[view.offset :][: view.length])
        results = decode_in_child(list(data_by_view.values()), self._limits)
        return dict(zip(data_by_view, results, strict=True))


def decode_in_child(meshes: list[bytes], limits: GltfLimits) -> list[DecodedMesh | str]:
    """Decompress meshes in a child process. Return a mesh, or the reason of a failure, for each."""
    if find_spec("DracoPy") is None:
        return ["Draco's decoder is not installed: pip install 'scenegate[draco]'"] * len(meshes)
    arguments = (meshes, limits.max_mesh_bytes)
    process_limits = ProcessLimits(limits.max_draco_bytes, _DECODER_SECONDS)
    try:
        output = call_limited("gateway.files.parsers.draco:decode_meshes", arguments, process_limits)
    except ProcessFailed as error:
        if error.timed_out:
            reason = f"Draco's decoder took longer than {_DECODER_SECONDS} s"
        else:
            reason = f"Draco's decoder failed, or needs more than max_draco_bytes = {limits.max_draco_bytes} of memory"
        return [reason] * len(meshes)
    return _output_decoder.decode(output)


def _attribute_values(mesh: DecodedMesh, unique_id: int, components: int, path: str) -> NDArray[Any]:
    """Return an attribute of a decoded mesh, (number of vertices, ``components``)."""
    for attribute in mesh.attributes:
        if attribute.unique_id == unique_id:
            values: NDArray[Any] = np.frombuffer(attribute.data, attribute.dtype).reshape(-1, attribute.components)
            if attribute.components != components:
                raise GltfError(f"{path}: {attribute.components} components, but its accessor has {components}")
            return values
    raise GltfError(f"{path}: the mesh has no attribute with the id {unique_id}")


def _accessor_of(original: Accessor, values: NDArray[Any]) -> Accessor:
    """Return an accessor of ``values``, (N, components). Its other properties are those of the original accessor."""
    data = values.tobytes()
    return msgspec.structs.replace(
        original,
        dtype=values.dtype,
        count=len(values),
        buffer=Buffer(data, hashlib.sha256(data).digest()),
        offset=0,
        stride=values.dtype.itemsize * values.shape[1],
        sparse=None,
    )
