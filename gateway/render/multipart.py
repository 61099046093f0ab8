"""Incremental parser of the multipart/form-data body (RFC 7578) of a render request; no I/O.

The bytes of the scene are copied only once, into the buffer that the glTF reader uses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from gateway.render.config import RenderConfig
from gateway.render.errors import RequestError, quoted

SCENE: Final = "scene"
"""Name of the part with the glTF file."""
_IDENTITY_ENCODINGS: Final = frozenset((b"", b"7bit", b"8bit", b"binary"))
"""Content-Transfer-Encodings that do not change the bytes. The others, which RFC 7578 (4.7) deprecates, are errors."""


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """A complete form."""

    fields: dict[str, str]
    """Text parts by name, stripped of white space."""
    scene: bytearray | None
    """The glTF file, which must not be modified; None: the form has no such part."""
    scene_filename: str
    """File name as sent by the client; empty if it was not sent."""


class FormReader:
    """Parses a body that is fed piece by piece. Every method may raise ``RequestError``."""

    def __init__(self, content_type: str, config: RenderConfig) -> None:
        """
        Args:
            content_type: Content-Type header of the request, with the boundary.
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
                    "on_header_field": self._on_header_name,
                    "on_header_value": self._on_header_value,
                    "on_header_end": self._on_header_end,
                    "on_headers_finished": self._on_headers_finished,
                    "on_part_data": self._on_part_data,
                    "on_part_end": self._on_part_end,
                    "on_end": self._on_end,
                },
                max_header_count=config.max_part_headers,
                max_header_size=config.max_header_bytes,
            )
        except FormParserError as error:
            raise RequestError(400, f"Content-Type has an unusable boundary: {error}") from None
        self._config = config
        self._received_bytes = 0
        self._part_count = 0
        self._is_complete = False
        self._part_names: set[str] = set()
        self._fields: dict[str, str] = {}
        self._scene: bytearray | None = None
        self._scene_filename = ""
        self._part_name = ""
        self._header_name = self._header_value = b""
        self._disposition = self._encoding = b""
        self._field_bytes = b""
        self._in_scene = False

    def feed(self, data: bytes) -> None:
        """Parse the next piece of the body."""
        self._received_bytes += len(data)
        if self._received_bytes > self._config.max_body_bytes:
            raise body_too_large(self._received_bytes, self._config)
        try:
            self._parser.write(data)
        except FormParserError as error:
            raise RequestError(400, f"the multipart body is malformed: {error}") from None

    def close(self) -> None:
        """Break the reference cycle with the parser, which would keep the body until the next garbage collection."""
        self._parser.callbacks = {}

    def form(self) -> Form:
        """Return the form after the whole body has been fed."""
        if not self._is_complete:
            location = f" inside the part {quoted(self._part_name)}" if self._part_name else ""
            raise RequestError(
                400,
                f"the multipart body ends{location} after {self._received_bytes} bytes, before the closing boundary: "
                "the upload was cut short",
            )
        return Form(self._fields, self._scene, self._scene_filename)

    def _on_header_name(self, data: bytes, start: int, end: int) -> None:
        self._header_name += data[start:end]

    def _on_header_value(self, data: bytes, start: int, end: int) -> None:
        self._header_value += data[start:end]

    def _on_header_end(self) -> None:
        name = self._header_name.lower()
        if name == b"content-disposition":
            self._disposition = self._header_value
        elif name == b"content-transfer-encoding":
            self._encoding = self._header_value.strip().lower()
        self._header_name = self._header_value = b""

    def _on_headers_finished(self) -> None:
        self._part_count += 1
        if self._part_count > self._config.max_parts:
            raise RequestError(400, f"the form has more than {self._config.max_parts} parts")
        kind, options = parse_options_header(self._disposition)
        name = options.get(b"name", b"").decode("utf-8", "replace")
        filename = options.get(b"filename", b"").decode("utf-8", "replace")
        if kind != b"form-data" or not name:
            got = quoted(self._disposition) if self._disposition else "none"
            raise RequestError(
                400, f'part {self._part_count} of the form needs Content-Disposition: form-data; name="…", got {got}'
            )
        self._part_name = name
        if name in self._part_names:
            raise RequestError(400, f"the field {quoted(name)} was sent twice")
        if self._encoding not in _IDENTITY_ENCODINGS:
            raise RequestError(
                400,
                f"the field {quoted(name)} has Content-Transfer-Encoding {quoted(self._encoding)}; send it as it is",
            )
        self._part_names.add(name)
        if name == SCENE:
            self._scene = bytearray()
            self._scene_filename = filename
            self._in_scene = True

    def _on_part_data(self, data: bytes, start: int, end: int) -> None:
        if self._in_scene:
            assert self._scene is not None
            with memoryview(data) as whole, whole[start:end] as piece:
                self._scene += piece
            return
        if len(self._field_bytes) + end - start > self._config.max_field_bytes:
            raise RequestError(
                400, f"the field {quoted(self._part_name)} is longer than {self._config.max_field_bytes} bytes"
            )
        self._field_bytes += data[start:end]

    def _on_part_end(self) -> None:
        if self._in_scene:
            self._in_scene = False
        else:
            try:
                self._fields[self._part_name] = self._field_bytes.decode().strip()
            except UnicodeDecodeError:
                raise RequestError(
                    400, f"the field {quoted(self._part_name)} is not UTF-8 text: {quoted(self._field_bytes)}"
                ) from None
        self._part_name = ""
        self._disposition = self._encoding = self._field_bytes = b""

    def _on_end(self) -> None:
        self._is_complete = True


def body_too_large(size: int, config: RenderConfig) -> RequestError:
    """Return the error for a body of at least ``size`` bytes."""
    limit = config.max_body_bytes
    return RequestError(413, f"the request body has {size} bytes or more, the limit is {limit} (max_body_bytes)")
