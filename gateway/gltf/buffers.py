"""Bytes that a document refers to: data URIs, files by way of a resolver, the binary chunk, buffer views."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Final
from urllib.parse import unquote, unquote_to_bytes

import msgspec
import pybase64

from gateway.gltf.container import Container
from gateway.gltf.content_cache import Buffer, ContentKey, MeshCache
from gateway.gltf.document import Document
from gateway.gltf.errors import GltfError, element
from gateway.gltf.limits import GltfLimits
from renderers.contents import quick_key
from renderers.stop import check_stop

Resolver = Callable[[str], bytes]
"""Gives the bytes of a relative URI, percent-decoded. It must not leave the folder of the document."""

_SCHEME: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_USUAL: Final = "data:application/octet-stream;base64,"
_USUAL_BYTES: Final = _USUAL.encode()
_USUAL_LENGTH: Final = len(_USUAL)
_HEAD: Final = 64
"""Bytes among which the comma of a data URI is found at once."""
_BASE64_NOISE: Final = re.compile(rb"[\s=]+")
_URL_ALPHABET: Final = bytes.maketrans(b"-_", b"+/")


class Buffers:
    """The buffers of one document, loaded when first used; equal ones are one object."""

    def __init__(
        self,
        document: Document,
        container: Container,
        cache: MeshCache,
        limits: GltfLimits,
        resolve: Resolver | None,
    ) -> None:
        self._sources = document.buffers or []
        self._views = document.buffer_views
        self._container = container
        self._cache = cache
        self._limits = limits
        self._resolve = resolve
        self.loaded: Final[dict[int, Buffer]] = {}
        """By index."""
        self._texts: dict[str, Buffer] = {}
        """By what stands in the JSON."""
        self._held: dict[ContentKey, Buffer] = {}
        self.nbytes: int = 0

    def load(self, index: int, view: int) -> Buffer:
        """``buffers[index]``, which ``bufferViews[view]`` refers to.

        Raises:
            GltfError: out of range, unreadable, shorter than it says, or all together are beyond ``max_buffer_bytes``.
        """
        known = self.loaded.get(index)
        if known is not None:
            return known
        sources = self._sources
        buffer = sources[index] if 0 <= index < len(sources) else None
        if buffer is None:
            buffer = element(sources, index, "buffers", f"bufferViews[{view}].buffer")
        if buffer.uri is not None:
            loaded = self.of_uri(buffer.uri, "buffers", index)
        elif index == 0 and self._container.bin is not None:
            self.charge(len(self._container.bin), "the binary chunk")
            loaded = self._cache.buffer(self._container.bin, self._held)
        else:
            raise GltfError(f"buffers[{index}]: there is neither a uri nor a binary chunk")
        if buffer.byte_length is not None and buffer.byte_length > len(loaded.data):  # glTF 2.0, section 3.6.1.1
            raise GltfError(
                f"buffers[{index}].byteLength: {buffer.byte_length} is more than the {len(loaded.data)} bytes there"
            )
        self.loaded[index] = loaded
        return loaded

    def load_together(self, indices: Iterable[int]) -> None:
        """Loads those that are as nearly all are, data URIs of base64 without a fault. ``load`` finds out what the
        others are.

        Args:
            indices: none of them is loaded.
        """
        sources, limit = self._sources, self._limits.max_buffer_bytes
        count, nbytes = len(sources), self.nbytes
        found: list[tuple[int, int | None, int]] = []
        new: list[tuple[bytes, ContentKey]] = []
        places: dict[str, int] = {}
        content: str | memoryview
        decode, key_of = pybase64.b64decode, quick_key
        for index in indices:
            check_stop()
            source = sources[index] if 0 <= index < count else None
            if source is None or (text := source.uri) is None:
                continue
            place = places.get(text)
            if place is not None:
                charged = len(new[place][0])
            elif text.startswith(_USUAL):
                content, charged = text[_USUAL_LENGTH:], len(text) * 3 // 4
            elif (encoded := self._encoded(text)) is None:
                continue
            else:
                content, charged = encoded
            if nbytes + charged > limit:
                break
            if place is None:
                try:
                    data = decode(content, None, True)  # names take as long as decoding
                except ValueError:
                    continue
                place = places[text] = len(new)
                new.append((data, key_of(data)))  # while it is in the processor's cache
            nbytes += charged
            found.append((index, source.byte_length, place))
        self.nbytes = nbytes
        buffers, loaded = self._cache.buffers(new, self._held), self.loaded
        for index, length, place in found:
            buffer = buffers[place]
            if length is None or length <= len(buffer.data):
                loaded[index] = buffer

    def view(self, index: int, where: str) -> tuple[Buffer, int, int, int | None]:
        """Buffer, offset, length and stride of ``bufferViews[index]``, within the buffer."""
        view = element(self._views, index, "bufferViews", where)
        name = f"bufferViews[{index}]"
        compressed = [e for e in view.extensions or () if e.endswith("_meshopt_compression")]
        if compressed and view.buffer is None:
            raise GltfError(f"{name}: {compressed[0]} is not supported")
        if view.buffer is None:
            raise GltfError(f"{name}.buffer: missing")
        buffer = self.load(view.buffer, index)
        offset, length = view.byte_offset or 0, view.byte_length
        if length is None:
            raise GltfError(f"{name}.byteLength: missing")
        if offset < 0 or length < 0 or offset + length > len(buffer.data):
            raise GltfError(
                f"{name}: bytes {offset} .. {offset + length} are outside of buffers[{view.buffer}] "
                f"({len(buffer.data)} bytes)"
            )
        return buffer, offset, length, view.byte_stride

    def of_uri(self, text: str, kind: str, index: int) -> Buffer:
        """The bytes of a data URI or, by the resolver, of a file; ``kind[index]`` has it."""
        check_stop()
        buffer = self._texts.get(text)
        if buffer is not None:
            self.charge(len(buffer.data), kind, index)
            return buffer
        encoded = self._encoded(text)
        if encoded is not None:
            content, nbytes = encoded
            self.charge(nbytes, kind, index)
            try:
                data = pybase64.b64decode(content, None, True)  # names take as long as decoding
            except ValueError:
                self.nbytes -= nbytes
            else:
                buffer = self._texts[text] = self._cache.buffer(data, self._held)
                return buffer
        buffer = self._texts[text] = self._of_other(text, f"{kind}[{index}].uri")
        return buffer

    def _encoded(self, text: str) -> tuple[str | memoryview, int] | None:
        """What stands behind the head of a data URI of base64, and what it is charged; None: it is another one."""
        place = self._container.uris.get(text)
        if place is not None:
            begin, end = place
            data = self._container.data
            if bytes(data[begin : begin + _USUAL_LENGTH]) == _USUAL_BYTES:
                return data[begin + _USUAL_LENGTH : end], (end - begin) * 3 // 4
            head = bytes(data[begin : begin + _HEAD])
            comma = head.find(b",")
            if comma > 0 and head.endswith(b";base64", 0, comma):
                return data[begin + comma + 1 : end], (end - begin) * 3 // 4
        elif text.startswith("data:"):
            comma = text.find(",", 0, _HEAD)
            if comma > 0 and text.endswith(";base64", 0, comma):
                return text[comma + 1 :], len(text) * 3 // 4
        return None

    def _of_other(self, text: str, where: str) -> Buffer:
        uri = self._container.uri(text)
        if isinstance(uri, str) and uri[:5].lower() != "data:":
            return self._of_file(uri, where)
        raw = memoryview(uri.encode()) if isinstance(uri, str) else uri
        self.charge(len(raw) * 3 // 4, where)
        try:
            data = decode_data_uri(raw)
        except ValueError:
            try:
                # Escapes of JSON ("\/") are rare enough to be looked at only when the text is no base64 as it stands.
                unescaped = msgspec.json.decode(b'"%b"' % bytes(raw), type=str) if not isinstance(uri, str) else uri
                data = decode_data_uri(memoryview(unescaped.encode()))
            except (ValueError, msgspec.MsgspecError) as error:
                self.nbytes -= len(raw) * 3 // 4
                raise GltfError(f"{where}: not a valid data URI: {error}") from error
        return self._cache.buffer(data, self._held)

    def charge(self, nbytes: int, what: str, index: int = -1) -> None:
        """Counts bytes against ``max_buffer_bytes``, before they are made; ``what``, or the URI of ``what[index]``,
        needs them."""
        if self.nbytes + nbytes > self._limits.max_buffer_bytes:
            where = what if index < 0 else f"{what}[{index}].uri"
            raise GltfError(f"{where}: the buffers exceed max_buffer_bytes = {self._limits.max_buffer_bytes}")
        self.nbytes += nbytes

    def _of_file(self, uri: str, where: str) -> Buffer:
        shown = uri if len(uri) <= 80 else f"{uri[:77]}..."
        if _SCHEME.match(uri) or uri.startswith(("/", "\\")):
            raise GltfError(f"{where}: only data URIs and relative URIs are read, not '{shown}'")
        if self._resolve is None:
            raise GltfError(f"{where}: '{shown}' is a file, but only data URIs are allowed here")
        try:
            data = self._resolve(unquote(uri))
        except (OSError, ValueError, LookupError) as error:
            raise GltfError(f"{where}: cannot read '{shown}': {error}") from error
        self.charge(len(data), where)
        return self._cache.buffer(data, self._held)


def decode_data_uri(uri: memoryview) -> bytes:
    """The bytes of ``data:[mime][;parameter]...[;base64],text``. The mime type is not looked at: Drake's is wrong.

    Raises:
        ValueError: no comma, or no base64.
    """
    head, comma, _ = bytes(uri[:1024]).partition(b",")
    if not comma:
        raise ValueError("there is no comma within its first 1024 bytes")
    text = uri[len(head) + 1 :]
    if not head.lower().rstrip().endswith(b";base64"):
        return unquote_to_bytes(bytes(text))
    try:
        return pybase64.b64decode(text, validate=True)
    except ValueError:
        pass
    # Line breaks, missing padding and the URL alphabet are sloppy, but unambiguous.
    cleaned = _BASE64_NOISE.sub(b"", unquote_to_bytes(bytes(text))).translate(_URL_ALPHABET)
    return pybase64.b64decode(cleaned + b"=" * (-len(cleaned) % 4), validate=True)
