"""Documents while their bytes arrive: hashed, and compared with the texts that are kept instead of copied.

Drake's client sends the whole scene with every picture. As long as what comes is what came before, nothing but a
comparison is needed: no copy, and no hash, since the states of the kept text's hash are kept with it. A hash of what
differs goes on from there, so that it is the very hash of the bytes that came.
"""

from __future__ import annotations

import hashlib
from typing import Final

from gateway.scene.gltf.bytewise import equal_at
from gateway.scene.gltf.prefixes import HEAD, KeptText, Prefixes

_NOTHING: Final = memoryview(b"")


class Text:
    """A document that has arrived: the beginning of a kept text, which may be empty, and the rest. Immutable."""

    __slots__ = ("_lasting", "_rest", "_shared", "_source")

    def __init__(
        self,
        rest: bytes | bytearray | memoryview,
        source: KeptText | None = None,
        shared: int | None = None,
        *,
        lasting: bool = False,
    ) -> None:
        """
        Args:
            shared: bytes of ``source`` that it begins with; None: all of them.
            lasting: nobody changes ``rest`` any more.
        """
        self._lasting: Final = lasting or isinstance(rest, bytes)
        self._rest: Final = rest if isinstance(rest, bytes) else memoryview(rest).cast("B").toreadonly()
        self._source: Final = source
        self._shared: Final = (len(source.text) if shared is None else shared) if source is not None else 0

    def __len__(self) -> int:
        return self._shared + len(self._rest)

    def __bytes__(self) -> bytes:
        return bytes(self.whole())

    @property
    def known(self) -> KeptText | None:
        """The kept text that it begins with, whole."""
        return self._source if self._source is not None and self._shared == len(self._source.text) else None

    @property
    def rest(self) -> bytes | memoryview:
        """What follows the part of a kept text; read-only."""
        return self._rest

    @property
    def is_lasting(self) -> bool:
        """Whether what ``whole`` gives may be kept."""
        return self._lasting or self._shared > 0

    def whole(self) -> bytes | memoryview:
        """All of it in one piece, read-only; made anew when part of it is a kept text's."""
        if self._source is None or self._shared == 0:
            return self._rest
        return b"".join((memoryview(self._source.text)[: self._shared], self._rest))


class Arrival:
    """Feed it the document, piece by piece, then take the text and its hash."""

    def __init__(self, kept: Prefixes | None = None) -> None:
        """``kept``: texts that the document may begin with; None: there are none."""
        self._kept = kept
        self._held: bytearray | None = bytearray() if kept is not None else None
        """The first bytes, by which a text is looked up; None: it was."""
        self._source: KeptText | None = None
        self._others: list[KeptText] = []
        self._shared = 0
        self._following = False
        self._own = bytearray()
        self._hash = hashlib.sha256()

    def feed(self, piece: bytes | memoryview) -> None:
        """The next bytes; they are not kept."""
        piece = memoryview(piece)
        if self._held is not None:
            if len(self._held) + len(piece) < HEAD:
                self._held += piece
                return
            held, missing = self._held, HEAD - len(self._held)
            held += piece[:missing]
            piece = piece[missing:]
            self._look_up(bytes(held))
        if self._following:
            piece = self._follow(piece)
        self._take(piece)

    def text(self) -> Text:
        """What has come."""
        self._end()
        return Text(self._own, self._source, self._shared, lasting=True)

    def sha256(self) -> str:
        """64 hexadecimal digits, of the bytes that have come."""
        self._end()
        return self._hash.hexdigest()

    def _take(self, piece: memoryview) -> None:
        if piece:
            self._hash.update(piece)
            self._own += piece

    def _look_up(self, head: bytes) -> None:
        assert self._kept is not None
        self._held = None
        self._others = self._kept.beginning_with(head)
        if self._others:
            self._source, self._shared, self._following = self._others.pop(0), len(head), True
        else:
            self._take(memoryview(head))

    def _follow(self, piece: memoryview) -> memoryview:
        """What of the piece is not in the kept text."""
        while True:
            assert self._source is not None
            text, begin = self._source.text, self._shared
            count = min(len(piece), len(text) - begin)
            if equal_at(text, begin, piece[:count]):
                self._shared += count
                if count == len(piece):
                    return _NOTHING
                self._part(self._source)
                return piece[count:]
            # Pictures of other kinds differ late, in materials: which text it is turns out then.
            other = next((o for o in self._others if self._source.common(o) >= begin), None)
            if other is None:
                self._part(self._source)
                return piece
            self._others.remove(other)
            self._source = other

    def _part(self, source: KeptText) -> None:
        self._following = False
        self._hash = source.hash_until(self._shared)

    def _end(self) -> None:
        if self._held is not None:
            held, self._held = self._held, None
            self._take(memoryview(held))
        if self._following:
            assert self._source is not None
            self._part(self._source)
