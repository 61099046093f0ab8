"""Decompresses Draco meshes: the program that ``draco`` runs in a child process with limits.

    python draco_child.py OUTPUT_BYTES

Reads a list of meshes from stdin, and writes a list of ``DecodedMesh`` or errors (strings) to stdout, as MessagePack.
The limits are needed because damaged data can make Draco allocate gigabytes or crash.
"""

from __future__ import annotations

import sys

import msgspec


class DecodedAttribute(msgspec.Struct):
    """An attribute of a mesh."""

    unique_id: int
    dtype: str
    """Name of the NumPy data type."""
    components: int
    data: bytes
    """Values, (number of vertices, components)."""


class DecodedMesh(msgspec.Struct):
    """A decompressed mesh."""

    triangles: bytes
    """(M, 3) uint32, vertex indices."""
    attributes: list[DecodedAttribute]


def decode(data: bytes) -> DecodedMesh | str:
    """Return a decompressed mesh, or the reason why there is none."""
    import DracoPy  # not at the top: the server imports this module for its structs

    try:
        mesh = DracoPy.decode(data)
    except (DracoPy.FileTypeException, ValueError, MemoryError) as error:
        return str(error) or "out of memory"
    if not isinstance(mesh, DracoPy.DracoMesh):
        return "there are no triangles"
    attributes = [
        DecodedAttribute(each["unique_id"], str(each["data"].dtype), each["data"].shape[1], each["data"].tobytes())
        for each in mesh.attributes
    ]
    return DecodedMesh(mesh.faces.astype("<u4").tobytes(), attributes)


def main() -> None:
    output_bytes = int(sys.argv[1])
    meshes = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=list[bytes])
    results: list[DecodedMesh | str] = []
    for data in meshes:
        result = decode(data)
        if isinstance(result, DecodedMesh):
            output_bytes -= len(result.triangles) + sum(len(attribute.data) for attribute in result.attributes)
            if output_bytes < 0:
                result = "the meshes of the document are larger than max_mesh_bytes"
        results.append(result)
    sys.stdout.buffer.write(msgspec.msgpack.encode(results))


if __name__ == "__main__":
    main()
