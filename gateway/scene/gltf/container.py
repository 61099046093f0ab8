"""The outer form of a document: ``.glb`` or ``.gltf``, told apart by the bytes; embedded data taken out of the JSON."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final

from gateway.scene.gltf.errors import GltfError

_MAGIC: Final = b"glTF"
_JSON_CHUNK: Final = 0x4E4F534A
_BIN_CHUNK: Final = 0x004E4942
_TAKEN_FROM: Final = 256
"""Bytes. Shorter data URIs stay in the JSON: taking them out would not pay."""
_WINDOWS: Final = (512, 1 << 17)
"""Bytes that are copied to search in a memoryview: first, since most distances are short, and at most at a time, which
stays in a core's cache."""
_MAX_PLACES: Final = 100_000
"""Places that are looked at. What a hostile text has beyond stays in the JSON, which is bounded."""
_URI_KEY: Final = re.compile(rb'"uri"\s*:\s*\Z')
_TOKEN: Final = "\0data "  # noqa: S105 - no secret
"""What a URI that was taken out leaves behind, before its number."""


@dataclass(frozen=True, slots=True, eq=False)
class Container:
    """A document before its JSON is parsed."""

    json: bytes
    """The JSON text, its long data URIs replaced by tokens."""
    uris: tuple[memoryview, ...]
    """The data URIs that were taken out, without quotes, as they stand in the JSON text (escapes included)."""
    tail: int | None
    """Offset in the data where the text after the last URI that was taken out begins; None: a ``.glb``."""
    bin: memoryview | None
    """The binary chunk of a ``.glb``."""

    def uri(self, text: str) -> str | memoryview:
        """The URI that ``text`` of the parsed JSON stands for: itself, or one that was taken out."""
        if not text.startswith(_TOKEN):
            return text
        number = text[len(_TOKEN) : len(_TOKEN) + 9]
        if not (number.isascii() and number.isdigit()) or int(number) >= len(self.uris):
            return text
        return self.uris[int(number)] if len(_TOKEN) + len(number) == len(text) else text


def open_container(data: bytes | memoryview) -> Container:
    """Splits ``data``.

    Raises:
        GltfError: a ``.glb`` whose header or chunks do not fit its length, or nothing that looks like a document.
    """
    view = memoryview(data).cast("B")
    start = bytes(view[:4])
    if start == _MAGIC:
        text, binary = _glb_chunks(view)
        json, uris, _ = _take_data_uris(text, text)
        return Container(json.rstrip(b"\0"), uris, None, binary)  # some writers pad the chunk with zeros
    if not bytes(view[:64]).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise GltfError(f"neither glTF JSON nor GLB: it starts with {start!r}" if start else "the document is empty")
    json, uris, tail = _take_data_uris(data if isinstance(data, bytes) else view, view)
    return Container(json, uris, tail, None)


def _glb_chunks(view: memoryview) -> tuple[memoryview, memoryview | None]:
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
        offset += -offset % 4 if size % 4 else 0
    if text is None:
        raise GltfError("GLB: there is no JSON chunk")
    return text, binary


def _take_data_uris(data: bytes | memoryview, view: memoryview) -> tuple[bytes, tuple[memoryview, ...], int]:
    """The JSON text without its long data URIs, these, and where the text after the last one begins.

    Parsing megabytes of base64 as JSON strings costs more than decoding them. A quote that no backslash precedes
    begins or ends a string, so a URI is what lies between ``"data:`` and the next quote. Text for which that is not so
    is not JSON and fails in the parser.
    """
    pieces: list[bytes] = []
    uris: list[memoryview] = []
    done = at = 0
    for _ in range(_MAX_PLACES):
        at = _find(data, b'"data:', at)
        if at < 0:
            break
        end = _find(data, b'"', at + 6)
        if end < 0:
            break
        at += 1
        is_uri = end - at >= _TAKEN_FROM and view[end - 1] != 0x5C and view[at - 2] != 0x5C
        if is_uri and _URI_KEY.search(bytes(view[max(0, at - 65) : at - 1])):
            pieces += (bytes(view[done:at]), b"\\u0000data %d" % len(uris))
            uris.append(view[at:end])
            done = end
        at = end + 1
    pieces.append(bytes(view[done:]))
    return b"".join(pieces), tuple(uris), done


def _find(data: bytes | memoryview, needle: bytes, start: int) -> int:
    """As ``bytes.find``, for memoryviews, too."""
    if isinstance(data, bytes):
        return data.find(needle, start)
    window, largest = _WINDOWS
    while start < len(data):
        index = bytes(data[start : start + window + len(needle) - 1]).find(needle)
        if index >= 0:
            return start + index
        start += window
        window = min(8 * window, largest)
    return -1
