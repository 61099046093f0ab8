"""Program that ``draco`` runs in a process of its own: decompresses Draco meshes within a limit on its memory.

    python draco_child.py MEMORY_BYTES OUTPUT_BYTES

Reads a msgpack list of meshes from stdin, and writes a list of ``DecodedMesh`` or errors (strings) to stdout. Damaged
data can make Draco allocate gigabytes or crash; only this process then ends.
"""

from __future__ import annotations

import sys

import msgspec

_CPU_SECONDS = 60


class DecodedAttribute(msgspec.Struct):
    """An attribute of a mesh."""

    unique_id: int
    dtype: str
    """NumPy's name."""
    components: int
    data: bytes


class DecodedMesh(msgspec.Struct):
    """A decompressed mesh."""

    triangles: bytes
    """(M, 3) uint32, vertex indices."""
    attributes: list[DecodedAttribute]


def decode(data: bytes) -> DecodedMesh | str:
    """Return a mesh, or the reason why there is none."""
    import DracoPy  # the server, which imports this module for its structs, does without

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
    memory_bytes, output_bytes = map(int, sys.argv[1:])
    meshes = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=list[bytes])
    _limit_memory(memory_bytes)
    results: list[DecodedMesh | str] = []
    for data in meshes:
        result = decode(data)
        if isinstance(result, DecodedMesh):
            output_bytes -= len(result.triangles) + sum(len(attribute.data) for attribute in result.attributes)
            if output_bytes < 0:
                result = "the meshes of the document are larger than max_mesh_bytes"
        results.append(result)
    sys.stdout.buffer.write(msgspec.msgpack.encode(results))


def _limit_memory(memory_bytes: int) -> None:
    """Limit the memory and the time of this process, where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (_CPU_SECONDS, _CPU_SECONDS))


if __name__ == "__main__":
    main()
