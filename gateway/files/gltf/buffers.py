"""Buffers and buffer views. Their bytes come from data URIs, a resolver of files, or the binary chunk of a ``.glb``."""

import hashlib
import re
from collections.abc import Callable
from typing import Final
from urllib.parse import unquote, unquote_to_bytes

import msgspec
import pybase64

from gateway.files.gltf import meshopt
from gateway.files.gltf.container import Container
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, GltfLimits, checked_item
from gateway.files.gltf.parser import extension
from gateway.files.gltf.schema import Document, GltfBuffer, GltfBufferView, MeshoptCompression
from scenegate.regular_files import reason_of

Resolver = Callable[[str], bytes]
"""Function that returns the bytes of a file, given its relative URI (percent-decoded).

It must not read files outside the document's folder.
"""

_SCHEME: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_MAX_HEADER_BYTES: Final = 1024
"""Maximum number of bytes of a data URI up to the comma before its data."""
_SPACE_AND_PADDING: Final = re.compile(rb"[\s=]+")
_STANDARD_FROM_URL_ALPHABET: Final = bytes.maketrans(b"-_", b"+/")


class Buffer(msgspec.Struct, frozen=True, gc=False, eq=False):
    """The bytes of a buffer or an image file."""

    data: bytes | memoryview
    digest: bytes
    """SHA-256."""


class BufferView(msgspec.Struct, frozen=True, gc=False, eq=False):
    """A part of a buffer after validation: it lies within the buffer."""

    buffer: Buffer
    offset: int
    """Bytes from the start of the buffer."""
    length: int
    """Bytes."""
    stride: int | None
    """``byteStride``, bytes from one value to the next; None: values are packed."""


class Buffers:
    """The buffers of one document, loaded at their first use."""

    def __init__(
        self,
        document: Document,
        container: Container,
        limits: GltfLimits,
        resolve: Resolver | None,
        warnings: list[str],
    ) -> None:
        self._sources = document.buffers
        self._views = document.buffer_views
        self._container = container
        self._limits = limits
        self._resolve = resolve
        self._warnings = warnings
        self.merged_by_drake: Final = document.merged_by_drake
        self._buffers: dict[int, Buffer] = {}
        self._decompressed: dict[int, BufferView] = {}
        """Buffer views of ``meshopt.EXTENSIONS``, by index."""
        self._nbytes = 0
        """Bytes counted towards ``max_buffer_bytes``."""

    def view(self, index: int, path: str) -> BufferView:
        """Return ``bufferViews[index]``, named by ``path``. Raises GltfError: no such view, or unreadable."""
        if (decompressed := self._decompressed.get(index)) is not None:
            return decompressed
        source = checked_item(self._views, index, "bufferViews", path)
        name = f"bufferViews[{index}]"
        # Drake's merge does not adapt the index of the compressed buffer.
        if source.extensions and not self.merged_by_drake:
            for compressed in meshopt.EXTENSIONS:
                compression = extension(source.extensions, compressed, MeshoptCompression, name, self._warnings)
                if compression is not None:
                    view = self._decompress(compression, f"{name}.extensions.{compressed}")
                    self._decompressed[index] = view
                    return view
        return self._uncompressed(source, name)

    def _uncompressed(self, source: GltfBufferView | MeshoptCompression, name: str) -> BufferView:
        """Return the part of a buffer that an object in the document refers to; ``name`` is that of the object."""
        index, offset, length = source.buffer, source.byte_offset or 0, source.byte_length
        if index is None:
            raise GltfError(f"{name}.buffer: missing")
        buffer = self._buffer(index, f"{name}.buffer")
        if length is None:
            raise GltfError(f"{name}.byteLength: missing")
        if offset < 0 or length < 0 or offset + length > len(buffer.data):
            raise GltfError(
                f"{name}: bytes {offset} .. {offset + length} are outside of buffers[{index}] "
                f"({len(buffer.data)} bytes)"
            )
        return BufferView(buffer, offset, length, source.byte_stride)

    def _decompress(self, source: MeshoptCompression, name: str) -> BufferView:
        count, stride = meshopt.checked_layout(source, name)
        self.count_bytes(count * stride, name)
        view = self._uncompressed(source, name)
        compressed = memoryview(view.buffer.data)[view.offset : view.offset + view.length]
        data = meshopt.decompress(source, compressed, name)
        return BufferView(_hashed(data), 0, len(data), stride)

    def _buffer(self, index: int, path: str) -> Buffer:
        if (loaded := self._buffers.get(index)) is not None:
            return loaded
        source = checked_item(self._sources, index, "buffers", path)
        if source.uri is not None:
            buffer = self.from_uri(source.uri, f"buffers[{index}].uri")
        elif index == 0 and self._container.binary_chunk is not None:
            self.count_bytes(len(self._container.binary_chunk), "the binary chunk")
            buffer = _hashed(self._container.binary_chunk)
        else:
            raise GltfError(f"buffers[{index}]: there is neither a uri nor a binary chunk")
        if source.byte_length is not None and source.byte_length > len(buffer.data):  # glTF 2.0, section 3.6.1.1
            self._warnings.append(
                f"buffers[{index}].byteLength: {source.byte_length} is more than the {len(buffer.data)} bytes there; "
                "these are used"
            )
        self._buffers[index] = buffer
        return buffer

    def check_posted(self) -> None:
        """Raise GltfError if all buffers of a posted document are files, instead of a warning for each mesh."""
        uris = [source.uri if isinstance(source, GltfBuffer) else None for source in self._sources or ()]
        if uris and all(uri and uri[:5].lower() != "data:" and uri[0] != "\0" for uri in uris):
            self.from_uri(uris[0] or "", "buffers[0].uri")

    def from_uri(self, json_uri: str, path: str) -> Buffer:
        """Return the bytes of a data URI or, through the resolver, of a file.

        ``json_uri``: a URI, or the placeholder of one in ``Container.data_uris``.
        """
        uri = self._container.data_uris.get(json_uri, json_uri)
        if isinstance(uri, str) and uri[:5].lower() != "data:":
            return self._from_file(uri, path)
        self.count_bytes(len(uri) * 3 // 4, path)
        try:
            return _hashed(decode_data_uri(uri))
        except ValueError:
            pass
        try:
            # A URI in Container.data_uris may have JSON escapes such as "\/".
            unescaped = uri if isinstance(uri, str) else msgspec.json.decode(b'"%b"' % bytes(uri), type=str)
            return _hashed(decode_data_uri(unescaped))
        except (ValueError, msgspec.MsgspecError) as error:
            raise GltfError(f"{path}: not a valid data URI: {error}") from error

    def count_bytes(self, nbytes: int, path: str) -> None:
        """Count bytes towards ``max_buffer_bytes`` before they are allocated. Raises GltfLimitError above it."""
        if self._nbytes + nbytes > self._limits.max_buffer_bytes:
            raise GltfLimitError(f"{path}: the buffers exceed max_buffer_bytes = {self._limits.max_buffer_bytes}")
        self._nbytes += nbytes

    def _from_file(self, uri: str, path: str) -> Buffer:
        """Return a file. One that is missing, or named by its path on another machine, may lie beside."""
        short_uri = uri if len(uri) <= 80 else f"{uri[:77]}..."
        error: Exception | None = None
        if _SCHEME.match(uri) or uri.startswith(("/", "\\")):
            error = GltfError(f"{path}: only data URIs and relative URIs are read, not '{short_uri}'")
        if self._resolve is None:
            not_posted = f"{path}: '{short_uri}' is a file that was not posted: post a .glb, which has it inside"
            raise error or GltfError(not_posted)
        *folders, name = re.split(r"[/\\]", unquote(uri))
        places = [name] if error else [unquote(uri), "/".join((*folders, name)), name]
        for file in dict.fromkeys(places):
            try:
                data = self._resolve(file)
            except (OSError, ValueError, LookupError) as reason:
                error = error or GltfError(f"{path}: cannot read '{short_uri}': {reason_of(reason)}")
                continue
            self.count_bytes(len(data), path)
            if error:
                self._warnings.append(f"{path}: '{short_uri}' is missing, {file[:80]!r} beside the file is used")
            return _hashed(data)
        assert error is not None
        raise error


def _hashed(data: bytes | memoryview) -> Buffer:
    return Buffer(data, hashlib.sha256(data).digest())


def decode_data_uri(uri: str | memoryview) -> bytes:
    """Return the data of ``data:[mime][;parameter]...[;base64],text``. The MIME type is ignored: Drake's is wrong.

    Raises ValueError without a comma, or if the text is not base64.
    """
    beginning = uri[:_MAX_HEADER_BYTES] if isinstance(uri, str) else bytes(uri[:_MAX_HEADER_BYTES]).decode("latin-1")
    header, comma, _ = beginning.partition(",")
    if not comma:
        raise ValueError(f"there is no comma within its first {_MAX_HEADER_BYTES} bytes")
    text = uri[len(header) + 1 :]
    if not header.rstrip().lower().endswith(";base64"):
        return unquote_to_bytes(text if isinstance(text, str) else bytes(text))
    try:
        return pybase64.b64decode(text, None, True)  # positional: keyword arguments double the time for a small buffer
    except ValueError:
        pass
    # Line breaks, missing padding and the URL alphabet violate the specification, but are unambiguous.
    unquoted = unquote_to_bytes(text if isinstance(text, str) else bytes(text))
    cleaned = _SPACE_AND_PADDING.sub(b"", unquoted).translate(_STANDARD_FROM_URL_ALPHABET)
    return pybase64.b64decode(cleaned + b"=" * (-len(cleaned) % 4), validate=True)
