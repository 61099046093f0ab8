"""The outer form of a document: ``.glb`` or ``.gltf``, told apart by the bytes; embedded data taken out of the JSON."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.gltf.compare import address_of_bytes, address_of_new, equal_bytes
from gateway.gltf.errors import GltfError
from gateway.gltf.reader_kernels import STRETCH, long_strings

_STRETCH: Final = int(STRETCH)
_MAGIC: Final = b"glTF"
_JSON_CHUNK: Final = 0x4E4F534A
_BIN_CHUNK: Final = 0x004E4942
_USUAL_KEY: Final = b'"uri":"data:'
_URI_KEY: Final = re.compile(rb'"uri"\s*:\s*\Z')
_LAST: Final = 64
"""Bytes at the end of URIs by which equal ones find each other."""
_TOKEN: Final = "\0data "  # noqa: S105 - no secret
"""What a URI that was taken out leaves behind, before its number."""


@dataclass(frozen=True, slots=True, eq=False)
class Container:
    """A document before its JSON is parsed."""

    json: bytes
    """The JSON text, its long data URIs replaced by tokens."""
    data: memoryview
    """Where these are."""
    uris: dict[str, tuple[int, int]]
    """Their beginnings and ends, without quotes, as they stand in the JSON text (escapes included), by what stands in
    their place."""
    tail: int | None
    """Offset in the data where the text after the last URI that was taken out begins; None: a ``.glb``."""
    bin: memoryview | None
    """The binary chunk of a ``.glb``."""

    def uri(self, text: str) -> str | memoryview:
        """The URI that ``text`` of the parsed JSON stands for: itself, or one that was taken out."""
        place = self.uris.get(text)
        return text if place is None else self.data[place[0] : place[1]]


def open_container(data: bytes | memoryview) -> Container:
    """Splits ``data``.

    Raises:
        GltfError: a ``.glb`` whose header or chunks do not fit its length, or nothing that looks like a document.
    """
    view = memoryview(data).cast("B")
    start = bytes(view[:4])
    if start == _MAGIC:
        text, binary = _glb_chunks(view)
        json, uris, _ = _take_data_uris(text)
        return Container(json.rstrip(b"\0"), text, uris, None, binary)  # some writers pad the chunk with zeros
    if not bytes(view[:64]).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise GltfError(f"neither glTF JSON nor GLB: it starts with {start!r}" if start else "the document is empty")
    json, uris, tail = _take_data_uris(view)
    return Container(json, view, uris, tail, None)


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
        # Chunks should be padded to four bytes. Some writers pad them without counting it, others do not pad at all.
        if size % 4 and view[offset + 4 : offset + 8] != _BIN_CHUNK.to_bytes(4, "little"):
            offset += -offset % 4
    if text is None:
        raise GltfError("GLB: there is no JSON chunk")
    return text, binary


def _take_data_uris(view: memoryview) -> tuple[bytes, dict[str, tuple[int, int]], int]:
    """The JSON text without its long data URIs, where these are, and where the text after the last one begins.

    Parsing megabytes of base64 as JSON strings costs more than decoding them; shorter ones than ``long_strings`` finds
    stay in the JSON, where they cost less. A quote that no backslash precedes begins or ends a string, so a URI is what
    lies between ``"data:`` and the next quote. Text for which that is not so is not JSON and fails in the parser.

    Equal URIs are one: comparing them takes a fifth of the time of decoding, and Drake's scenes have many.
    """
    count = len(view)
    whole = view.obj if isinstance(view.obj, bytes) and len(view.obj) == count else None
    if count < 2 * _STRETCH:
        return whole or bytes(view), {}, 0
    if whole is not None:
        address = address_of_bytes(whole)
    else:
        address = np.frombuffer(view, np.uint8).__array_interface__["data"][0]
    to_places = bytearray(16 * (count // _STRETCH))
    found = long_strings(address, count, address_of_new(to_places))
    if found == 0:
        return whole or bytes(view), {}, 0
    pieces: list[bytes | memoryview] = []
    uris: dict[str, tuple[int, int]] = {}
    known: dict[bytes, tuple[int, int, bytes]] = {}
    done = 0
    places = iter(memoryview(to_places)[: 16 * found].cast("q"))
    for at, end in zip(places, places, strict=True):
        usual: object = at >= 7 and whole is not None and whole.startswith(_USUAL_KEY, at - 7)
        if not usual:
            before = bytes(view[max(0, at - 65) : at + 5])
            usual = before.endswith(_USUAL_KEY) or (before.endswith(b'"data:') and _URI_KEY.search(before[:-6]))
        if usual and view[end - 1] != 0x5C and view[at - 2] != 0x5C:
            last = bytes(view[end - _LAST : end]) if whole is None else whole[end - _LAST : end]
            same = known.get(last)
            if same is not None and equal_bytes(view[same[0] : same[1]], view[at:end]):
                token = same[2]
            else:
                token = b"\\u0000data %d" % len(uris)
                known[last] = at, end, token
                uris[f"{_TOKEN}{len(uris)}"] = at, end
            pieces += (view[done:at], token)
            done = end
    pieces.append(view[done:])
    return b"".join(pieces), uris, done
