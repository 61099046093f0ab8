"""Decompresses Draco meshes with the package DracoPy. Damaged data can make it allocate gigabytes or crash."""

from collections.abc import Callable

import DracoPy

from gateway.files.parsers.mesh_data import DecodedAttribute, DecodedMesh


def decode_meshes(
    read_file: Callable[[str], bytes], meshes: list[bytes], max_output_bytes: int
) -> list[DecodedMesh | str]:
    """Return a decompressed mesh, or the reason why there is none, for each of a document's meshes."""
    results: list[DecodedMesh | str] = []
    for data in meshes:
        result = _decode(data)
        if isinstance(result, DecodedMesh):
            max_output_bytes -= len(result.triangles) + sum(len(attribute.data) for attribute in result.attributes)
            if max_output_bytes < 0:
                result = "the meshes of the document are larger than max_mesh_bytes"
        results.append(result)
    return results


def _decode(data: bytes) -> DecodedMesh | str:
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
