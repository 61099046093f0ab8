"""The container of a document (``.glb`` or ``.gltf``), and its JSON text without the embedded data."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final

from gateway.gltf.errors import GltfError
from renderers.stop import check_stop

_MAGIC: Final = b"glTF"
_JSON_CHUNK: Final = 0x4E4F534A
_BIN_CHUNK: Final = 0x004E4942
_DATA_URI: Final = re.compile(rb'"uri"\s*:\s*"(?=data:)')
"""The text before a data URI that is the value of a ``uri`` property, unless a backslash precedes it."""
_MIN_URI_BYTES: Final = 1024
"""Shorter data URIs stay in the JSON, where they cost less."""
_TOKEN: Final = "\0data {}"  # noqa: S105 - not a secret
"""Text that replaces a data URI. No other URI of a valid document starts with this character."""


@dataclass(frozen=True, slots=True, eq=False)
class Container:
    """A document before its JSON is parsed."""

    json: bytes
    """The JSON text, its long data URIs replaced by tokens."""
    uris: dict[str, memoryview]
    """Data URIs as they stand in the file (escapes included), by token."""
    bin: memoryview | None
    """Binary chunk of a ``.glb``."""

    def uri(self, text: str) -> str | memoryview:
        """Return the data URI that a token stands for, or any other text as it is."""
        return self.uris.get(text, text)


def open_container(data: bytes | bytearray | memoryview) -> Container:
    """Split a file into its JSON text and its binary data.

    Raises:
        GltfError: The header or the chunks of a ``.glb`` do not fit its length, or the file is neither form of glTF.
    """
    view = memoryview(data).cast("B")
    start = bytes(view[:4])
    if start == _MAGIC:
        text, binary = _glb_chunks(view)
        json, uris = _extract_data_uris(bytes(text))
        return Container(json.rstrip(b"\0"), uris, binary)  # some writers pad the chunk with zeros
    if not bytes(view[:64]).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise GltfError(f"neither glTF JSON nor GLB: it starts with {start!r}" if start else "the document is empty")
    json, uris = _extract_data_uris(data if isinstance(data, bytes | bytearray) else bytes(view))
    return Container(json, uris, None)


def _glb_chunks(view: memoryview) -> tuple[memoryview, memoryview | None]:
    """Return the JSON chunk and the binary chunk, if there is one."""
    if len(view) < 20:
        raise GltfError(f"GLB: {len(view)} bytes are too few for a header and a chunk")
    version, length = struct.unpack_from("<II", view, 4)
    if version != 2:
        raise GltfError(f"GLB: version {version} is not supported, only 2")
    if length > len(view):
        raise GltfError(f"GLB: the header announces {length} bytes, but there are {len(view)}")
    text: memoryview | None = None
    binary: memoryview | None = None
    offset = 12
    while offset + 8 <= length:
        size, kind = struct.unpack_from("<II", view, offset)
        begin, offset = offset + 8, offset + 8 + size
        if offset > length:
            raise GltfError(f"GLB: the chunk at byte {begin - 8} has {size} bytes, but only {length - begin} are left")
        if text is None:
            if kind != _JSON_CHUNK:
                raise GltfError(f"GLB: the first chunk is of type {kind:#010x}, not JSON")
            text = view[begin:offset]
        elif kind == _BIN_CHUNK and binary is None:
            binary = view[begin:offset]
        # Chunks should be padded to four bytes. Some writers pad them without counting it, others do not pad at all.
        if size % 4 and view[offset + 4 : offset + 8] != _BIN_CHUNK.to_bytes(4, "little"):
            offset += -offset % 4
    if text is None:
        raise GltfError("GLB: there is no JSON chunk")
    return text, binary


def _extract_data_uris(text: bytes | bytearray) -> tuple[bytes, dict[str, memoryview]]:
    """Return the JSON text with tokens for its long data URIs, and these URIs.

    Parsing megabytes of base64 as JSON strings costs more than decoding them. A quote that no backslash precedes begins
    or ends a string, so a URI ends at the next quote; a URI with an escaped quote stays in the JSON.
    """
    view = memoryview(text)
    pieces: list[memoryview | bytes] = []
    uris: dict[str, memoryview] = {}
    done = at = 0
    while match := _DATA_URI.search(text, at):
        check_stop()
        begin = match.end()
        at = text.find(b'"', begin)
        if at < 0:
            break
        escaped = 0x5C in (text[match.start() - 1], text[at - 1])
        if at - begin >= _MIN_URI_BYTES and not escaped:
            token = _TOKEN.format(len(uris))
            uris[token] = view[begin:at]
            pieces += view[done:begin], token.replace("\0", "\\u0000").encode()
            done = at
    pieces.append(view[done:])
    return b"".join(pieces), uris
