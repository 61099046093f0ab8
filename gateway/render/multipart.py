"""multipart/form-data (RFC 7578), parsed while its bytes arrive; no I/O.

The scene is written once, into the buffer that the glTF reader reads. A boundary begins with a carriage return: bytes
of the scene far from any carriage return are data, and are not searched for boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from gateway.render.config import RenderConfig
from gateway.render.errors import RequestError, quoted

SCENE = "scene"
"""Name of the part with the glTF file."""
_PLAIN_ENCODINGS = frozenset((b"", b"7bit", b"8bit", b"binary"))
"""Content-Transfer-Encodings that leave the bytes alone; RFC 7578 (4.7) deprecates the others."""
_BOUNDARY_ENDS = 8
"""Bytes that may stand beside a boundary and belong to it: ``\\r\\n--`` before, ``--\\r\\n`` behind."""
_STEP = 4096
"""Bytes given to the parser at a time before the scene: so much of it is searched with what is before it."""


@lru_cache(maxsize=64)  # a client sends the same twenty with every request
def _described(disposition: bytes) -> tuple[bytes, str, str]:
    """Kind, name and file name that a Content-Disposition says."""
    kind, options = parse_options_header(disposition)
    name, filename = (options.get(key, b"").decode("utf-8", "replace") for key in (b"name", b"filename"))
    return kind, name, filename


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """A complete form."""

    fields: dict[str, str]
    """The text parts by name, white space at the ends removed."""
    scene: bytearray | None
    """The glTF file; None: there is no such part. Must not be changed."""
    scene_filename: str
    """As the client calls it; for people only."""


class FormReader:
    """Feed it the body, chunk by chunk, then take the form. Every method raises ``RequestError``."""

    def __init__(self, content_type: str, config: RenderConfig) -> None:
        """
        Args:
            content_type: the request's header, with the boundary.
        """
        if len(content_type) > config.max_header_bytes:
            raise RequestError(
                400, f"Content-Type has {len(content_type)} characters, the limit is {config.max_header_bytes}"
            )
        kind, options = parse_options_header(content_type.encode("latin-1", "replace"))
        if kind != b"multipart/form-data":
            got = quoted(content_type) if content_type else "none"
            raise RequestError(400, f"Content-Type must be multipart/form-data, got {got}")
        boundary = options.get(b"boundary", b"")
        if not boundary:
            raise RequestError(400, f"Content-Type names no boundary: {quoted(content_type)}")
        try:
            self._parser = MultipartParser(
                boundary,
                {
                    "on_part_begin": self._part_begin,
                    "on_header_field": self._header_name_piece,
                    "on_header_value": self._header_value_piece,
                    "on_header_end": self._header_end,
                    "on_headers_finished": self._headers_finished,
                    "on_part_data": self._part_data,
                    "on_part_end": self._part_end,
                    "on_end": self._end,
                },
                max_header_count=config.max_part_headers,
                max_header_size=config.max_header_bytes,
            )
        except FormParserError as error:
            raise RequestError(400, f"Content-Type has an unusable boundary: {error}") from None
        self._config = config
        self._received = 0
        self._parts = 0
        self._complete = False
        self._names: set[str] = set()
        self._fields: dict[str, str] = {}
        self._scene: bytearray | None = None
        self._scene_filename = ""
        self._name = ""
        self._header_name = self._header_value = b""
        self._disposition = self._encoding = b""
        self._text = b""
        self._in_scene = False
        self._far = len(boundary) + _BOUNDARY_ENDS
        self._since_return = 0
        """Bytes fed since the last carriage return, or more than ``_far``: no boundary has begun then."""

    @property
    def received(self) -> int:
        """Bytes fed so far."""
        return self._received

    def feed(self, chunk: bytes | bytearray, count: int | None = None) -> None:
        """The next bytes of the body: the first ``count`` of ``chunk``, or all. They are not kept."""
        end = len(chunk) if count is None else count
        self._received += end
        if self._received > self._config.max_body_bytes:
            raise too_large(self._received, self._config)
        begin = 0
        while begin < end:
            if self._in_scene:
                if self._since_return >= self._far:
                    begin = self._take_data(chunk, begin, end)
                step = end
            else:
                step = min(end, begin + _STEP)
            if begin < step:
                self._parse(bytes(memoryview(chunk)[begin:step]))
            begin = step

    def _take_data(self, chunk: bytes | bytearray, begin: int, end: int) -> int:
        """Feeds the scene with what is before the next carriage return; gives where that is."""
        assert self._scene is not None
        found = chunk.find(b"\r", begin, end)
        until = found if found >= 0 else end
        if begin < until:
            with memoryview(chunk) as whole, whole[begin:until] as piece:
                self._scene += piece
        return until

    def _parse(self, piece: bytes) -> None:
        try:
            self._parser.write(piece)
        except FormParserError as error:
            raise RequestError(400, f"the multipart body is malformed: {error}") from None
        last = piece.rfind(b"\r", max(0, len(piece) - self._far))
        self._since_return = self._since_return + len(piece) if last < 0 else len(piece) - 1 - last

    def close(self) -> None:
        """Lets go of what has come, but for what ``form`` has given. The parser's callbacks are methods of this reader:
        without it a body would stay until the garbage collector comes, long after it was answered."""
        self._parser.callbacks = {}

    def form(self) -> Form:
        """The whole form, after the last byte."""
        if not self._complete:
            inside = f" inside the part {quoted(self._name)}" if self._name else ""
            raise RequestError(
                400,
                f"the multipart body ends{inside} after {self._received} bytes, before the closing boundary: "
                "the upload was cut short",
            )
        return Form(self._fields, self._scene, self._scene_filename)

    def _part_begin(self) -> None:
        self._parts += 1
        if self._parts > self._config.max_parts:
            raise RequestError(400, f"the form has more than {self._config.max_parts} parts")
        self._name = ""
        self._disposition = self._encoding = self._header_name = self._header_value = self._text = b""

    def _header_name_piece(self, data: bytes, start: int, end: int) -> None:
        self._header_name += data[start:end]

    def _header_value_piece(self, data: bytes, start: int, end: int) -> None:
        self._header_value += data[start:end]

    def _header_end(self) -> None:
        name = self._header_name.lower()
        if name == b"content-disposition":
            self._disposition = self._header_value
        elif name == b"content-transfer-encoding":
            self._encoding = self._header_value.strip().lower()
        self._header_name = self._header_value = b""

    def _headers_finished(self) -> None:
        kind, name, filename = _described(self._disposition)
        if kind != b"form-data" or not name:
            got = quoted(self._disposition) if self._disposition else "none"
            raise RequestError(
                400, f'part {self._parts} of the form needs Content-Disposition: form-data; name="…", got {got}'
            )
        self._name = name
        if name in self._names:
            raise RequestError(400, f"the field {quoted(name)} was sent twice")
        if self._encoding not in _PLAIN_ENCODINGS:
            raise RequestError(
                400,
                f"the field {quoted(name)} has Content-Transfer-Encoding {quoted(self._encoding)}; send it as it is",
            )
        self._names.add(name)
        if name == SCENE:
            self._scene = bytearray()
            self._scene_filename = filename
            self._in_scene = True

    def _part_data(self, data: bytes, start: int, end: int) -> None:
        if self._in_scene:
            assert self._scene is not None
            with memoryview(data) as whole, whole[start:end] as piece:
                self._scene += piece
            return
        if len(self._text) + end - start > self._config.max_field_bytes:
            raise RequestError(
                400, f"the field {quoted(self._name)} is longer than {self._config.max_field_bytes} bytes"
            )
        self._text += data[start:end]

    def _part_end(self) -> None:
        if self._in_scene:
            self._in_scene = False
        else:
            try:
                self._fields[self._name] = self._text.decode().strip()
            except UnicodeDecodeError:
                raise RequestError(
                    400, f"the field {quoted(self._name)} is not UTF-8 text: {quoted(self._text)}"
                ) from None
        self._name = ""

    def _end(self) -> None:
        self._complete = True


def too_large(size: int, config: RenderConfig) -> RequestError:
    """The answer to a body beyond the bound; ``size`` is what is known of it."""
    limit = config.max_body_bytes
    return RequestError(413, f"the request body has {size} bytes or more, the limit is {limit} (max_body_bytes)")
