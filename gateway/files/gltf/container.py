"""First step of reading: split a ``.glb`` or ``.gltf`` file into its JSON text and its embedded binary data."""

import re
import struct
from dataclasses import dataclass
from typing import Final

from gateway.files.gltf.gltf_errors import GltfError
from renderers.stop import check_stop

_MAGIC: Final = b"glTF"
_JSON_CHUNK: Final = 0x4E4F534A
_BIN_CHUNK: Final = 0x004E4942
_DATA_URI: Final = re.compile(rb'"uri"\s*:\s*"(?=data:)')
"""Text before a data URI. A match after a backslash lies inside a JSON string and is ignored."""
_MIN_URI_BYTES: Final = 1024
"""Minimum size of a data URI that is taken out of the JSON. Parsing a shorter one costs less than taking it out."""
_PLACEHOLDER: Final = "\0data {}"
"""Format of the strings that replace data URIs in the JSON. No URI of a valid document starts with ``\\0``."""


@dataclass(frozen=True, slots=True, eq=False)
class Container:
    """The parts of a file. The memory views refer to the file's bytes."""

    json: bytes
    """The JSON text, with placeholders for its long data URIs."""
    data_uris: dict[str, memoryview]
    """Data URIs by placeholder, as written in the file: JSON escapes such as ``\\/`` are not decoded."""
    binary_chunk: memoryview | None
    """Binary chunk of a ``.glb``; None if there is none."""


def open_container(data: bytes | bytearray | memoryview) -> Container:
    """Split a file into its JSON text and its binary data. Raises GltfError if it is not glTF, or cut off."""
    file = memoryview(data).cast("B")
    magic = bytes(file[:4])
    if magic == _MAGIC:
        json_chunk, binary_chunk = _glb_chunks(file)
        json, data_uris = _extract_data_uris(bytes(json_chunk))
        return Container(json.rstrip(b"\0"), data_uris, binary_chunk)  # some writers pad the chunk with zeros
    if not bytes(file[:64]).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise GltfError(f"neither glTF JSON nor GLB: it starts with {magic!r}" if magic else "the document is empty")
    json, data_uris = _extract_data_uris(data if isinstance(data, bytes | bytearray) else bytes(file))
    return Container(json, data_uris, None)


def _glb_chunks(file: memoryview) -> tuple[memoryview, memoryview | None]:
    """Return the JSON chunk of a ``.glb`` (glTF 2.0, section 4.4), and the first binary chunk or None."""
    if len(file) < 20:
        raise GltfError(f"GLB: {len(file)} bytes are too few for a header and a chunk")
    version, length = struct.unpack_from("<II", file, 4)
    if version != 2:
        raise GltfError(f"GLB: version {version} is not supported, only 2")
    if length > len(file):
        raise GltfError(f"GLB: the header announces {length} bytes, but there are {len(file)}")
    json_chunk: memoryview | None = None
    binary_chunk: memoryview | None = None
    offset = 12
    while offset + 8 <= length:
        size, chunk_type = struct.unpack_from("<II", file, offset)
        begin, end = offset + 8, offset + 8 + size
        if end > length:
            raise GltfError(f"GLB: the chunk at byte {offset} has {size} bytes, but only {length - begin} are left")
        if json_chunk is None:
            if chunk_type != _JSON_CHUNK:
                raise GltfError(f"GLB: the first chunk is of type {chunk_type:#010x}, not JSON")
            json_chunk = file[begin:end]
        elif chunk_type == _BIN_CHUNK and binary_chunk is None:
            binary_chunk = file[begin:end]
        offset = end
        # Sizes should be multiples of four. Some writers pad without counting the padding, others do not pad at all.
        if size % 4 and file[offset + 4 : offset + 8] != _BIN_CHUNK.to_bytes(4, "little"):
            offset += -offset % 4
    if json_chunk is None:
        raise GltfError("GLB: there is no JSON chunk")
    return json_chunk, binary_chunk


def _extract_data_uris(text: bytes | bytearray) -> tuple[bytes, dict[str, memoryview]]:
    """Return the JSON text with placeholders for its long data URIs, and the URIs by placeholder.

    Parsing megabytes of base64 as a JSON string takes longer than decoding the base64. A URI ends at the next quote; a
    URI with an escaped quote stays in the JSON.
    """
    view = memoryview(text)
    pieces: list[memoryview | bytes] = []
    data_uris: dict[str, memoryview] = {}
    copied_until = end = 0
    while match := _DATA_URI.search(text, end):
        check_stop()
        begin = match.end()
        end = text.find(b'"', begin)
        if end < 0:
            break
        has_escape = ord("\\") in (text[match.start() - 1], text[end - 1])
        if end - begin >= _MIN_URI_BYTES and not has_escape:
            placeholder = _PLACEHOLDER.format(len(data_uris))
            data_uris[placeholder] = view[begin:end]
            pieces += view[copied_until:begin], placeholder.replace("\0", "\\u0000").encode()
            copied_until = end
    pieces.append(view[copied_until:])
    return b"".join(pieces), data_uris
