"""The body of multipart/form-data (RFC 7578, RFC 2046) cut into its parts while it arrives; no I/O.

A megabyte of scene stands behind twenty fields of ten bytes, so that two things count: a part's head is looked at as a
whole, and data is searched for the boundary's first byte at the speed of memory. What is data is handed on where it
lies, without a copy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

MAX_BOUNDARY: Final = 256
"""Bytes. RFC 2046 allows 70; more is no reason to refuse, without a bound every piece might be held back."""
_TOKEN: Final = bytes(set(range(33, 127)) - set(b'()<>@,;:\\"/[]?={}'))
"""What a header's name consists of (RFC 9110, 5.6.2)."""
_FEW: Final = 8
"""Carriage returns that are looked at one by one; where there are more, as in text with lines or in binary data, the
whole boundary is searched for."""

Head = list[tuple[bytes, bytes]]
"""Header names in lower case and values."""

# What comes next.
_BEGIN, _PREAMBLE, _HEAD, _DATA, _PADDING, _EPILOGUE = range(6)


class MalformedBody(ValueError):  # noqa: N818 - it says what is the matter
    """It is not what RFC 2046 describes."""


class PartCutter:
    """Feed it the body, piece by piece; it calls back. However the body is cut, the same data comes in the same order,
    perhaps in other pieces."""

    def __init__(
        self,
        boundary: bytes,
        begin: Callable[[Head], None],
        data: Callable[[memoryview], None],
        end: Callable[[], None],
        *,
        max_headers: int,
        max_header_bytes: int,
    ) -> None:
        """
        Args:
            begin, data, end: told about each part; what ``data`` is handed is valid until it returns.
            max_headers: of a part.
            max_header_bytes: of one header's line.

        Raises:
            MalformedBody: the boundary cannot be used.
        """
        if not 1 <= len(boundary) <= MAX_BOUNDARY:
            raise MalformedBody(f"the boundary has {len(boundary)} bytes, it may have 1 to {MAX_BOUNDARY}")
        self._delimiter = b"\r\n--" + boundary
        self._begin = begin
        self._data = data
        self._end = end
        self._max_headers = max_headers
        self._max_header_bytes = max_header_bytes
        self._next = _BEGIN
        self._held = b""
        """The end of what was fed, as long as it cannot be told what it is."""

    @property
    def complete(self) -> bool:
        """Whether the closing boundary has come."""
        return self._next == _EPILOGUE

    def feed(self, piece: bytes | bytearray, count: int | None = None) -> None:
        """The next bytes: the first ``count`` of ``piece``, or all.

        Raises:
            MalformedBody: they cannot follow what came before.
        """
        if self._held:
            piece = self._held + (piece if count is None else piece[:count])
            self._held = b""
            count = None
        size = len(piece) if count is None else count
        whole = memoryview(piece)
        at = 0
        while at < size and self._next != _EPILOGUE:
            if self._next == _DATA:
                at = self._cut_data(piece, whole, at, size)
            elif self._next == _HEAD:
                at = self._cut_head(piece, at, size)
            elif self._next == _PADDING:
                at = self._cut_padding(piece, at, size)
            else:
                at = self._cut_preamble(piece, at, size)

    def _hold(self, piece: bytes | bytearray, at: int, size: int) -> int:
        self._held = bytes(piece[at:size])
        return size

    def _cut_preamble(self, piece: bytes | bytearray, at: int, size: int) -> int:
        """Line breaks before the first boundary, and what follows them, are nobody's."""
        if self._next == _PREAMBLE or piece[at] in b"\r\n":
            self._next = _PREAMBLE
            at = piece.find(b"-", at, size)
            if at < 0:
                return size
        first = self._delimiter[2:]
        after = at + len(first)
        if not first.startswith(piece[at : min(after, size)]):
            raise MalformedBody("it does not begin with the boundary")
        if after + 2 > size:
            self._next = _BEGIN
            return self._hold(piece, at, size)
        follows = piece[after : after + 2]
        if follows not in (b"\r\n", b"--"):
            raise MalformedBody("no line break follows the first boundary")
        self._next = _HEAD if follows == b"\r\n" else _EPILOGUE
        return after + 2

    def _cut_head(self, piece: bytes | bytearray, at: int, size: int) -> int:
        if piece.startswith(b"\r\n", at, size):
            self._open([])
            return at + 2
        stop = piece.find(b"\r\n\r\n", at, size)
        text = bytes(piece[at:stop] if stop >= 0 else piece[at:size].removesuffix(b"\r"))
        lines = text.split(b"\r\n")
        if len(lines) > self._max_headers + (stop < 0):  # without an end the last line may be the empty one
            raise MalformedBody("Maximum header count exceeded")
        if max(map(len, lines)) > self._max_header_bytes:
            raise MalformedBody("Maximum header size exceeded")
        if stop < 0:
            return self._hold(piece, at, size)
        self._open([self._header(line) for line in lines])
        return stop + 4

    def _header(self, line: bytes) -> tuple[bytes, bytes]:
        name, colon, value = line.partition(b":")
        if not colon or not name or name.translate(None, _TOKEN) or b"\r" in value:
            raise MalformedBody("a line of a part's head is no header")
        return name.lower(), value.lstrip(b" ")

    def _open(self, head: Head) -> None:
        self._next = _DATA
        self._begin(head)

    def _cut_data(self, piece: bytes | bytearray, whole: memoryview, at: int, size: int) -> int:
        delimiter = self._delimiter
        start = at
        while (found := self._find(piece, at, size)) >= 0:
            after = found + len(delimiter)
            follows = piece[after : min(after + 2, size)]
            if follows in (b"\r\n", b"--"):
                self._close(whole, start, found)
                self._next = _HEAD if follows == b"\r\n" else _EPILOGUE
                return after + 2
            if follows[:1] in (b" ", b"\t"):  # RFC 2046: white space that a gateway may have added
                self._close(whole, start, found)
                self._next = _PADDING
                return after + 1
            if follows in (b"", b"\r", b"-"):
                break
            at = found + 1
        if found < 0:
            found = self._begun(piece, max(at, size - len(delimiter) + 1), size)
        if found > start:
            self._data(whole[start:found])
        return self._hold(piece, found, size)

    def _close(self, whole: memoryview, start: int, stop: int) -> None:
        if stop > start:
            self._data(whole[start:stop])
        self._end()

    def _find(self, piece: bytes | bytearray, at: int, size: int) -> int:
        """Where the delimiter stands; negative: nowhere, as a whole."""
        for _ in range(_FEW):
            at = piece.find(b"\r", at, size)
            if at < 0 or piece.startswith(self._delimiter, at, size):
                return at
            at += 1
        return piece.find(self._delimiter, at, size)

    def _begun(self, piece: bytes | bytearray, at: int, size: int) -> int:
        """Where the delimiter may have begun; ``size``: nowhere."""
        while (at := piece.find(b"\r", at, size)) >= 0:
            if self._delimiter.startswith(piece[at:size]):
                return at
            at += 1
        return size

    def _cut_padding(self, piece: bytes | bytearray, at: int, size: int) -> int:
        rest = bytes(piece[at:size]).lstrip(b" \t")
        at = size - len(rest)
        if rest in (b"", b"\r"):
            return self._hold(piece, at, size)
        if not rest.startswith(b"\r\n"):
            raise MalformedBody("no line break follows the white space after a boundary")
        self._next = _HEAD
        return at + 2
